"""PETR at its smallest: cameras are a set, samples of a batch do not meet, and a frame can be learned by heart."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from coin3d.detectors import Batch, collate
from coin3d.detectors.petr import PETR
from coin3d.detectors.petr_config import PETRConfig
from coin3d.detectors.position_embedding_3d import RayPoints
from coin3d.detectors.query_boxes import QueryDecodeOptions
from coin3d.detectors.query_conventions import ReleasedQueryConventions
from coin3d.detectors.query_losses import QueryLossWeights
from coin3d.detectors.released_lidar import ReleasedLidar
from coin3d.detectors.space_range import SpaceRange
from coin3d.geometry import Boxes3D
from coin3d.methods import METHODS
from small_world import CLASSES, SIZE_PX, batch, ring_rig, sample, settled

CONFIG = PETRConfig(
    image_width_px=SIZE_PX[0],
    image_height_px=SIZE_PX[1],
    backbone="resnet18",
    backbone_blocks=(1, 1, 1, 1),
    strides=(16,),
    neck_channels=16,
    channels=32,
    queries=14,
    seeds=6,
    layers=2,
    heads=4,
    hidden=32,
    dropout=0.0,
    rays=RayPoints(count=8, last_m=30.0),
    ray_space=SpaceRange((-30.0, -30.0, -5.0), (30.0, 30.0, 5.0)),
    box_space=SpaceRange((-25.6, -25.6, -3.0), (25.6, 25.6, 5.0)),
    perspective_weight=1.0,
    decode=QueryDecodeOptions(max_boxes=15),
)
TURNED = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])


def petr(method: str = "none", config: PETRConfig = CONFIG) -> PETR:
    kind, make = METHODS[method]
    torch.manual_seed(0)
    built = PETR(config, CLASSES, make(kind()))
    with torch.no_grad():  # as after training, queries look at some cells more than at others
        for embedding in (built.rays, built.camera_sine):
            if embedding is not None:
                embedding.mlp[2].weight *= 10
    return built


@cache
def model(method: str) -> PETR:
    """One detector for all tests that do not change it."""
    built = petr(method)
    settled(built, batch(sample(7, ring_rig(4)), sample(8, ring_rig(4, focal_px=80.0, height_m=2.0))))
    return built


def run(method: str, batch_: Batch) -> dict[str, torch.Tensor]:
    with torch.no_grad():
        outputs: dict[str, torch.Tensor] = model(method)(batch_)
    return outputs


def test_long_image_cells_do_not_drown_the_queries() -> None:
    """Image cells are as long as a trunk makes them; as released, that outweighs what the queries are."""
    both = batch(sample(0, ring_rig(3)), sample(1, ring_rig(3)))

    def spread(normalised: bool, length: float) -> float:
        built = settled(petr(config=replace(CONFIG, normalised_cells=normalised)), both)
        with torch.no_grad():
            built.input_proj.weight *= length
            assert built.input_proj.bias is not None
            built.input_proj.bias *= length
            return float(built(both)["boxes"][-1, ..., 2:4].std(1).mean())

    assert spread(normalised=True, length=1000.0) == pytest.approx(spread(normalised=True, length=10.0), rel=1e-2)
    assert spread(normalised=False, length=1000.0) != pytest.approx(spread(normalised=False, length=10.0), rel=0.1)


@pytest.mark.parametrize("method", list(METHODS))
def test_rigs_of_five_and_six_cameras_equal_the_samples_alone(method: str) -> None:
    samples = [sample(0, ring_rig(5)), sample(1, ring_rig(6, focal_px=90.0, height_m=2.1), bev_from_ego=TURNED)]
    together = run(method, collate(samples))
    alone = [run(method, collate([s])) for s in samples]
    assert together["boxes"].shape == (2, 2, 20, 10) and together["class_logits"].shape == (2, 2, 20, len(CLASSES))
    for name, outputs in together.items():
        torch.testing.assert_close(outputs, torch.cat([a[name] for a in alone], dim=1), rtol=1e-4, atol=1e-4)
    assert (together["boxes"][:, 0] - together["boxes"][:, 1]).abs().max() > 0.01


@pytest.mark.parametrize("method", list(METHODS))
def test_order_of_cameras_does_not_matter(method: str) -> None:
    whole, order = sample(0, ring_rig(4)), [2, 0, 3, 1]
    shuffled = replace(whole, images=whole.images[order], cameras=tuple(whole.cameras[i] for i in order), depth_m=None)
    for name, outputs in run(method, collate([whole])).items():
        torch.testing.assert_close(outputs, run(method, collate([shuffled]))[name], rtol=1e-4, atol=1e-4)


def test_a_camera_more_is_seen() -> None:
    """The padding of a smaller rig hides nothing but itself."""
    whole = sample(0, ring_rig(4))
    less = replace(whole, images=whole.images[:3], cameras=whole.cameras[:3], depth_m=None)
    assert (run("none", collate([whole]))["boxes"] - run("none", collate([less]))["boxes"]).abs().max() > 1e-3


def test_poses_of_cameras_matter() -> None:
    """The same pixels through other lenses, or from elsewhere, stand for other boxes."""
    here = sample(0, ring_rig(3))
    for rig in (ring_rig(3, focal_px=110.0), ring_rig(3, height_m=2.5)):
        there = replace(sample(0, rig), images=here.images)
        assert (run("none", collate([here]))["boxes"] - run("none", collate([there]))["boxes"]).abs().max() > 1e-3


def test_losses_reach_every_weight_and_are_finite() -> None:
    both = batch(sample(0, ring_rig(3)), sample(1, ring_rig(2)))
    for method in METHODS:
        fresh = settled(petr(method), both)
        losses = fresh.train().losses(both)
        assert set(losses) == {"class_1", "box_1", "class_2", "box_2", "perspective"}
        torch.stack(list(losses.values())).sum().backward()
        grads = {name: p.grad for name, p in fresh.named_parameters()}
        assert all(g is not None and g.isfinite().all() for g in grads.values()), method
        still = {name for name, g in grads.items() if g is not None and not g.any()}
        first = "decoder.layers.0."  # its queries are zeros still: among them there is nothing to find
        passive = ("among_queries.in_proj_weight", "among_queries.out_proj.weight", "norms.0.weight")
        assert still <= {first + name for name in passive}, method


def test_frames_without_boxes_and_boxes_out_of_range_train() -> None:
    both = batch(sample(0, ring_rig(3)), sample(1, ring_rig(2)))
    far = Boxes3D.create([[300.0, 0, 0], [10.0, 0, 40.0], [-60.0, -60.0, 0]], np.ones((3, 3)), np.zeros(3), ["car"] * 3)
    strange = Boxes3D.create([[10.0, 0, 1.0]], np.ones((1, 3)), [0.0], ["unicorn"])
    for tables in ((Boxes3D.empty(), Boxes3D.empty()), (far, strange), (both.boxes[0], Boxes3D.empty())):
        fresh = petr().train()
        losses = fresh.losses(replace(both, boxes=tables))
        torch.stack(list(losses.values())).sum().backward()
        assert all(loss.isfinite() for loss in losses.values())
        assert all(p.grad is None or p.grad.isfinite().all() for p in fresh.parameters())
        assert (float(losses["box_2"].detach()) == 0.0) == (tables[0] is not both.boxes[0])


def test_velocity_is_given_only_where_it_was_trained() -> None:
    one = batch(sample(0, ring_rig(2)))
    assert np.isfinite(petr().eval().detect(one)[0].velocity_mps).all()
    silent = replace(CONFIG, weights=QueryLossWeights(velocity=0.0))
    assert np.isnan(petr(config=silent).eval().detect(one)[0].velocity_mps).all()


def test_detections_are_sorted_boxes_in_range() -> None:
    found = model("coin3d").detect(batch(sample(0, ring_rig(3)), sample(1, ring_rig(2))))
    assert [len(boxes) for boxes in found] == [15, 15]
    for boxes in found:
        assert (np.diff(boxes.scores) <= 0).all() and set(boxes.labels) <= set(CLASSES)
        assert (np.abs(boxes.centre_m[:, :2]) <= 25.6).all()


def test_released_weights_predict_in_the_lidar_frame() -> None:
    """The same network there: its boxes and its rays move with the frame."""
    lidar = ReleasedQueryConventions(lidar=ReleasedLidar((1.0, 0.0, 1.8)), point_in_cell_px=8.0, camera_sine=False)
    theirs = petr(config=replace(CONFIG, seeds=0, released=lidar)).eval()
    ours, one = petr().eval(), batch(sample(0, ring_rig(3)))
    cell, camera = (0, 2, 3), lidar.lidar.ego_from_lidar
    ego = ours.rays.points_m(one.cameras, ours._target_from_ego(one)[one.sample_index])[cell].detach().numpy()
    moved = theirs.rays.points_m(one.cameras, theirs._target_from_ego(one)[one.sample_index])[cell].detach().numpy()
    np.testing.assert_allclose(camera.apply(moved.astype(np.float64)), ego, atol=1e-4)
    assert np.allclose(moved[0, 0], -(ego[0, 1]), atol=1e-5)  # x to the right
    with torch.no_grad():
        place = theirs(one)["boxes"][-1, 0, :, [0, 1, 4]].double().numpy()
    found = theirs.detect(one)[0].centre_m
    gap = np.linalg.norm(camera.apply(place)[None] - found[:, None], axis=-1).min(1)
    assert gap.max() < 1e-4


def test_camera_sine_goes_by_where_a_camera_looks() -> None:
    """Not by its place in the list of its rig or batch, yet cameras are told apart."""
    whole, order = sample(0, ring_rig(3)), [1, 2, 0]
    tied = petr(config=replace(CONFIG, seeds=0, released=ReleasedQueryConventions()))
    settled(tied, collate([whole]))
    shuffled = replace(whole, images=whole.images[order], cameras=tuple(whole.cameras[i] for i in order), depth_m=None)
    with torch.no_grad():
        one, other = (tied(collate([s]))["boxes"] for s in (whole, shuffled))
        both = tied(collate([whole, sample(1, ring_rig(5))]))["boxes"]
        assert tied.camera_sine is not None
        pose = torch.from_numpy(np.stack([c.ego_from_cam.matrix for c in whole.cameras])).float()
        codes = tied.camera_sine(pose, 2, 3)
    torch.testing.assert_close(other, one, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(both[:, :1], one, rtol=1e-4, atol=1e-4)
    assert (codes[0] - codes[1]).abs().max() > 1e-3


def test_batches_that_cannot_be_used_are_refused() -> None:
    whole = batch(sample(0, ring_rig(2)))
    with pytest.raises(ValueError, match="0 tables of them for 1 samples"):
        petr().train().losses(replace(whole, boxes=()))
    with pytest.raises(ValueError, match="sample 1 of the batch has no camera"):
        petr()(replace(whole, bev_from_ego=torch.eye(3).repeat(2, 1, 1)))
    with pytest.raises(ValueError, match="not a multiple of 16"):
        replace(CONFIG, image_width_px=100)
    with pytest.raises(ValueError, match="attention heads"):
        replace(CONFIG, heads=5)
    with pytest.raises(ValueError, match="v2-99"):
        PETRConfig(pretrained=True)


def test_bfloat16_stays_near_float32() -> None:
    both = batch(sample(0, ring_rig(3)))
    exact = {k: float(v.detach()) for k, v in model("coin3d").losses(both).items()}
    with torch.autocast("cpu", dtype=torch.bfloat16):
        rounded = {k: float(v.detach()) for k, v in model("coin3d").losses(both).items()}
    assert rounded == pytest.approx(exact, rel=0.1)


@pytest.mark.parametrize("preset", [PETRConfig.tiny, PETRConfig.small, PETRConfig.paper, PETRConfig.released_nuscenes])
def test_presets_are_consistent(preset: type) -> None:
    with torch.device("meta"):
        built = petr("coin3d", config=preset())
    assert sum(p.numel() for p in built.parameters()) > 1e6


def test_one_frame_is_learned_by_heart() -> None:
    one, learner = batch(sample(3, ring_rig(3))), petr("coin3d").train()
    optimizer, totals = torch.optim.AdamW(learner.parameters(), lr=3e-3), []
    for _ in range(30):
        total = torch.stack(list(learner.losses(one).values())).sum()
        optimizer.zero_grad()
        total.backward()
        torch.nn.utils.clip_grad_norm_(learner.parameters(), 5.0)
        optimizer.step()
        totals.append(float(total.detach()))
    assert np.mean(totals[-3:]) < 0.5 * totals[0], totals
