"""BEVFormer at its smallest: rigs may be mixed, history follows the vehicle, and it can learn a frame by heart."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from torch import Tensor

from coin3d.detectors import Batch, Sample, collate, frame_sample
from coin3d.detectors.bev_history import align_history
from coin3d.detectors.bevformer import BEVFormer
from coin3d.detectors.bevformer_config import BEVFormerConfig
from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.pillar_projection import image_from_bev, pillar_anchors, project_pillars
from coin3d.detectors.query_boxes import QueryDecodeOptions
from coin3d.detectors.released_bevformer import ReleasedBevFormer, ReleasedParts
from coin3d.detectors.spatial_cross_attention import SpatialCrossAttention, VisibleQueries
from coin3d.geometry import Pose, preset_rig
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.methods import METHODS
from small_world import CLASSES, SIZE_PX, batch, frame, ring_rig, sample, settled

CONFIG = BEVFormerConfig(
    image_width_px=SIZE_PX[0],
    image_height_px=SIZE_PX[1],
    backbone="resnet18",
    backbone_blocks=(1, 1, 1, 1),
    strides=(8, 16),
    channels=32,
    heads=4,
    grid=BevGrid(25.6, 3.2, (-3.0, 5.0)),
    encoder_layers=2,
    decoder_layers=2,
    queries=14,
    seeds=6,
    hidden=32,
    dropout=0.0,
    perspective_weight=1.0,
    decode=QueryDecodeOptions(max_boxes=50),
)
TURNED = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])


def detector(method: str = "none", config: BEVFormerConfig = CONFIG) -> BEVFormer:
    kind, make = METHODS[method]
    torch.manual_seed(0)
    return BEVFormer(config, CLASSES, make(kind()))


def opened(method: str) -> BEVFormer:
    """A detector whose sampling depends on the queries and whose residuals are open, as after training."""
    made = detector(method)
    for name, weight in made.named_parameters():
        if "plan.offsets.weight" in name or "plan.weights.weight" in name:
            torch.nn.init.normal_(weight, std=0.1)
    return settled(made, mixed()[0])


@cache
def model(method: str) -> BEVFormer:
    """One detector for all tests that do not change it."""
    return opened(method)


def mixed() -> tuple[Batch, list[Sample]]:
    """Rigs of five and six cameras with other lenses and heights, one of them in a turned BEV."""
    samples = [sample(0, ring_rig(5)), sample(1, ring_rig(6, focal_px=90.0, height_m=2.1), bev_from_ego=TURNED)]
    return collate(samples), samples


def run(method: str, batch_: Batch, **history: Tensor) -> dict[str, Tensor]:
    with torch.no_grad():
        outputs: dict[str, Tensor] = model(method)(batch_, **history)
    return outputs


@pytest.mark.parametrize("method", ["none", "coin3d"])
def test_mixed_rigs_equal_the_samples_alone(method: str) -> None:
    both, samples = mixed()
    together, alone = run(method, both), [run(method, collate([s])) for s in samples]
    assert together["class_logits"].shape == (2, 2, 20, len(CLASSES)) and together["boxes"].shape == (2, 2, 20, 10)
    for name, batch_axis in (("class_logits", 1), ("boxes", 1), ("bev", 0)):
        expected = torch.cat([a[name] for a in alone], dim=batch_axis)
        torch.testing.assert_close(together[name], expected, rtol=1e-4, atol=1e-4)
    assert (together["bev"][0] - together["bev"][1]).abs().max() > 0.1


def test_order_of_cameras_does_not_matter() -> None:
    whole, order = sample(0, ring_rig(5)), [2, 0, 4, 3, 1]
    shuffled = replace(whole, images=whole.images[order], cameras=tuple(whole.cameras[i] for i in order), depth_m=None)
    outputs, expected = run("coin3d", collate([shuffled])), run("coin3d", collate([whole]))
    for name, value in outputs.items():
        torch.testing.assert_close(value, expected[name], rtol=1e-4, atol=1e-4)
    other_images = replace(shuffled, images=whole.images)
    assert (run("coin3d", collate([other_images]))["bev"] - expected["bev"]).abs().max() > 0.1


def test_pillars_are_projected_like_points() -> None:
    """Against the double-precision camera, through a turned BEV."""
    one = sample(0, ring_rig(3), bev_from_ego=TURNED)
    cameras = CameraTensors.from_cameras(one.cameras, [one.ground] * 3)
    bev_from_ego = torch.eye(4)[None].clone()
    bev_from_ego[0, :3, :3] = torch.from_numpy(TURNED)
    anchors = pillar_anchors(CONFIG.grid, CONFIG.anchor_heights_m)
    views = project_pillars(anchors, image_from_bev(cameras, bev_from_ego, torch.zeros(3, dtype=torch.long)), SIZE_PX[::-1])
    for i, camera in enumerate(one.cameras):
        pixels, depth_m = camera.project(anchors.double().numpy() @ TURNED)  # the inverse of a rotation is its transpose
        with np.errstate(invalid="ignore"):
            inside = (depth_m > 0) & (pixels > 0).all(-1) & (pixels < SIZE_PX).all(-1)
        assert 0 < inside.sum() < inside.size
        np.testing.assert_array_equal(views.visible[i].numpy(), inside)
        np.testing.assert_allclose(views.references[i].numpy()[inside], pixels[inside] / SIZE_PX, atol=1e-5)


def test_cameras_that_see_nothing_change_nothing() -> None:
    """Queries no camera sees keep their residual and the output's bias."""
    views = project_pillars(torch.tensor([[[-5.0, 0, 0]]]), torch.eye(3, 4)[None], (64, 96))
    visible = VisibleQueries.of(views, torch.zeros(1, dtype=torch.long), 1)
    attention, query = SpatialCrossAttention(8, 2, 4, 0.0), torch.randn(1, 1, 8)
    out = attention(query, torch.randn(1, 8, 4, 6), visible)
    torch.testing.assert_close(out, query + attention.output.bias)


def test_losses_reach_every_weight() -> None:
    both, _ = mixed()
    for method in METHODS:
        fresh = opened(method).train()
        losses = fresh.losses(both)
        assert set(losses) == {
            *("class_1", "class_2", "box_1", "box_2", "perspective"),
            *("heatmap", "offset", "height", "size", "heading"),
        }
        torch.stack(list(losses.values())).sum().backward()
        unmoved = [name for name, p in fresh.named_parameters() if p.grad is None or not p.grad.any()]
        assert unmoved == [], method
        assert all(bool(p.grad.isfinite().all()) for p in fresh.parameters() if p.grad is not None), method


def test_batches_that_cannot_be_trained_on() -> None:
    both, _ = mixed()
    with pytest.raises(ValueError, match="0 tables of them for 2 samples"):
        detector().losses(replace(both, boxes=()))
    empty = replace(both, boxes=tuple(boxes[:0] for boxes in both.boxes), depth_m=None)
    assert all(bool(loss.isfinite()) for loss in detector().train().losses(empty).values())


def test_detections_are_in_the_ego_frame_best_first() -> None:
    both, _ = mixed()
    found = model("coin3d").detect(both)
    assert len(found) == 2
    for boxes in found:
        assert 0 < len(boxes) <= 50 and set(boxes.labels) <= set(CLASSES)
        assert (np.diff(boxes.scores) <= 0).all()
        assert (np.abs(boxes.centre_m[:, :2]) <= 25.6).all()


def row_by_row(grid: BevGrid, seed: int = 0) -> Tensor:
    return torch.randn(1, grid.side**2, 4, generator=torch.Generator().manual_seed(seed))


def test_history_moves_against_the_vehicle() -> None:
    """One cell forward, then a quarter turn to the left: where each cell was before."""
    grid = BevGrid(25.6, 3.2)
    previous = row_by_row(grid)
    maps = previous.reshape(grid.side, grid.side, 4)
    forward = torch.from_numpy(Pose(np.eye(3), np.array([3.2, 0, 0])).matrix.copy())[None]
    aligned = align_history(previous, forward, grid).bev.reshape(grid.side, grid.side, 4)
    torch.testing.assert_close(aligned[:, :-1], maps[:, 1:], atol=1e-5, rtol=0)
    assert (aligned[:, -1] == 0).all()
    left = torch.from_numpy(Pose.from_euler(np.pi / 2, 0, 0, np.zeros(3)).matrix.copy())[None]
    aligned = align_history(previous, left, grid).bev.reshape(grid.side, grid.side, 4)
    # what lies ahead now (large x, last column) lay to the left (large y, last row) before
    torch.testing.assert_close(aligned[:, -1], maps[-1].flip(0), atol=1e-5, rtol=0)


def test_history_enters_through_poses_only() -> None:
    both, samples = mixed()
    first = run("none", both)["bev"]
    motion = torch.eye(4).repeat(2, 1, 1)
    motion[:, 0, 3] = torch.tensor([1.0, 4.0])
    second = run("none", both, previous_bev=first, previous_from_current=motion)
    assert (second["bev"] - first).abs().max() > 0.1
    for i, one in enumerate(samples):
        alone = run("none", collate([one]), previous_bev=first[i : i + 1], previous_from_current=motion[i : i + 1])
        torch.testing.assert_close(second["bev"][i : i + 1], alone["bev"], rtol=1e-4, atol=1e-4)
    with pytest.raises(ValueError, match="previous_from_current"):
        run("none", both, previous_bev=first)
    with pytest.raises(ValueError, match="bus"):
        run("none", both, bus=torch.zeros(2, 18))


def test_frames_before_in_a_batch_are_the_history() -> None:
    frames = [frame(0, ring_rig(5)), replace(frame(1, ring_rig(5)), world_from_ego=Pose.from_euler(0.3, 0, 0, (4.0, 0, 0)))]
    now = collate([frame_sample(frames[1], *SIZE_PX, [frames[0]])])
    before = run("none", collate([frame_sample(frames[0], *SIZE_PX)]))["bev"]
    motion = torch.from_numpy((frames[0].world_from_ego.inverse() @ frames[1].world_from_ego).matrix).float()[None]
    expected = run("none", replace(now, previous=None), previous_bev=before, previous_from_current=motion)
    torch.testing.assert_close(run("none", now)["bev"], expected["bev"], rtol=1e-5, atol=1e-5)
    assert (run("none", replace(now, previous=None))["bev"] - expected["bev"]).abs().max() > 0.1


def test_frames_before_are_not_learned_from() -> None:
    one = sample(0, ring_rig(5))
    alone = collate([one])
    before = replace(collate([sample(1, ring_rig(5))]), key_from_ego=torch.eye(4).repeat(5, 1, 1), depth_m=None, boxes=())
    statistics = []
    for given in (alone, replace(alone, previous=before)):
        made = detector().train()
        torch.stack(list(made.losses(given).values())).sum().backward()
        assert made.training and made.backbone.training
        statistics.append({name: value for name, value in made.backbone.named_buffers() if "running_" in name})
        assert all(value == 1 for name, value in made.named_buffers() if "num_batches" in name)
    assert statistics[0]
    assert all(torch.equal(value, statistics[1][name]) for name, value in statistics[0].items())


def test_released_parts_see_the_same_motion() -> None:
    """3.2 m (a cell) forward is a cell along y in the released LiDAR frame; a turn is told in degrees."""
    grid = BevGrid(25.6, 3.2)
    parts = ReleasedParts(ReleasedBevFormer(turn_centre_cells=(8.0, 8.0)), grid, 4)
    forward = torch.from_numpy(Pose.from_euler(0.2, 0, 0, np.array([3.2, 0, 0])).matrix.copy()).float()[None]
    forward[:, :3, 3] = forward[:, :3, :3] @ torch.tensor([3.2, 0, 0])  # along its heading of now
    bus = parts.bus_from_motion(forward)
    assert float(bus[0, -1]) == pytest.approx(np.rad2deg(0.2), rel=1e-5)
    history = parts.history(row_by_row(grid), bus)
    present = parts.history(row_by_row(grid), torch.zeros(1, 18))
    shift = history.references - present.references
    torch.testing.assert_close(shift, torch.tensor([0, 1 / grid.side]).expand_as(shift), atol=1e-6, rtol=0)
    assert torch.equal(present.bev, row_by_row(grid))  # no turn, no change


def test_released_embeddings_go_by_where_a_camera_looks() -> None:
    """Not by its place in the list, which is another in every recording."""
    config = replace(CONFIG, seeds=0, released=BEVFormerConfig.released_nuscenes().released)
    both, _ = mixed()
    assert len(detector(config=config).eval().detect(both)) == 2  # 5 and 6 cameras
    parts = ReleasedParts(ReleasedBevFormer(), config.grid, 8)
    rig = preset_rig("nuscenes")
    cameras = CameraTensors.from_cameras(list(rig.values()), [rig.ground] * 6)
    with torch.no_grad():
        added = parts.features(torch.zeros(6, 8, 1, 1), cameras.ego_from_cam)[:, :, 0, 0] - parts.level_embedding[0]
        # ours come as front, front left, front right, back, back left, back right
        torch.testing.assert_close(added, parts.camera_embedding[[0, 2, 1, 3, 4, 5]])


def test_bfloat16_stays_near_float32() -> None:
    both, _ = mixed()
    exact = run("coin3d", both)["class_logits"]
    with torch.autocast("cpu", dtype=torch.bfloat16):
        rounded = run("coin3d", both)["class_logits"]
    assert rounded.dtype == torch.float32
    assert (rounded - exact).abs().median() < 0.1 * exact.std() + 0.02


@pytest.mark.parametrize(
    "preset", [BEVFormerConfig.tiny, BEVFormerConfig.small, BEVFormerConfig.paper, BEVFormerConfig.released_nuscenes]
)
def test_presets_are_consistent(preset: type) -> None:
    with torch.device("meta"):
        built = detector("coin3d", preset())
    assert sum(p.numel() for p in built.parameters()) > 1e6


def test_sizes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="multiple of 16"):
        replace(CONFIG, image_width_px=90)
    with pytest.raises(ValueError, match="4 heads"):
        replace(CONFIG, channels=36)
    with pytest.raises(ValueError, match="8 points do not share out over 3"):
        replace(CONFIG, anchor_heights_m=(0.0, 1.0, 2.0))


def test_one_frame_is_learned_by_heart() -> None:
    one = batch(sample(3, ring_rig(3)))
    learner = detector("coin3d").train()
    optimizer = torch.optim.AdamW(learner.parameters(), lr=2e-3)
    totals = []
    for _ in range(30):
        total = torch.stack(list(learner.losses(one).values())).sum()
        optimizer.zero_grad()
        total.backward()
        torch.nn.utils.clip_grad_norm_(learner.parameters(), 5.0)
        optimizer.step()
        totals.append(float(total.detach()))
    assert np.mean(totals[-3:]) < 0.6 * totals[0], totals
