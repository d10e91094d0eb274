"""Megvii's released BEVDepth, stage by stage, on weights and images generated from names: one and two frames, aggregation."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
from megvii_released import FIXTURE_SIZE_PX, VARIANTS, released_weights
from parity_files import filler, fixture
from torch import Tensor, nn

from coin3d.detectors import Batch, BEVDepth, BEVDepthConfig
from coin3d.detectors.bevdepth_config import NUSCENES_TASKS
from coin3d.detectors.center_targets import CenterTargets, center_targets
from coin3d.detectors.released_image import swapped
from coin3d.detectors.released_lift import ReleasedLiftSplat
from coin3d.detectors.task_decode import decode_tasks
from coin3d.detectors.task_heads import class_range, task_maps
from coin3d.detectors.task_losses import task_losses
from coin3d.geometry import Boxes3D
from coin3d.geometry.camera_tensors import CameraTensors
from coin3d.methods import Direct
from coin3d.training.released.megvii_keys import MEGVII_KEYS, megvii_options

Stored = dict[str, np.ndarray]
BRANCHES = {"reg": "offset", "height": "height", "dim": "size", "rot": "heading", "vel": "velocity", "heatmap": "heatmap"}
WITH_HEADS = ["1key", "2key"]
"""Fixtures that hold head outputs."""


def stored_of(variant: str) -> Stored:
    return fixture(f"bevdepth_{variant}_64x192.npz")


def detector(variant: str) -> BEVDepth:
    weights = released_weights(*VARIANTS[variant])
    width, height = FIXTURE_SIZE_PX
    config = replace(BEVDepthConfig.released_megvii(*VARIANTS[variant]), image_width_px=width, image_height_px=height)
    assert config.megvii is not None
    with torch.device("meta"):  # its own random weights would take longer than all that is tested here
        model = BEVDepth(config, config.megvii.classes, Direct(megvii_options())).eval()
    model.load_state_dict(MEGVII_KEYS.convert(weights, model.state_dict()), assign=True)
    return model


def frame(stored: Stored, images: Tensor, which: int, previous: Batch | None = None) -> Batch:
    """Key frame (0) or the one before (1) as our batch; cameras of both are given in the key frame's ego."""
    ida = stored["ida"][0, which].astype(np.float64)
    augment = np.tile(np.eye(3), (len(ida), 1, 1))
    augment[:, :2, :2], augment[:, :2, 2] = ida[:, :2, :2], ida[:, :2, 3]
    half = np.eye(3)
    half[:2, 2] = 0.5  # their pixels are whole numbers
    K = half @ augment @ stored["intrin"][0, which, :, :3, :3]
    ground = np.tile([0.0, 0.0, 1.0, 0.0], (len(K), 1))
    K, ego_from_cam, planes = (torch.from_numpy(v).float() for v in (K, stored["sensor2ego"][0, which], ground))
    width, height = FIXTURE_SIZE_PX
    return Batch(
        swapped(images[0, which]),  # swapping again gives the stored input back
        CameraTensors(K, ego_from_cam, planes, height, width),
        torch.zeros(len(K), dtype=torch.long),
        torch.from_numpy(stored["bda"][:, :3, :3]).float(),
        previous=previous,
    )


def batch(stored: Stored) -> Batch:
    frames = stored["intrin"].shape[1]
    width, height = FIXTURE_SIZE_PX
    images = filler().randn("bevdepth_img", 1, frames, 6, 3, height, width)
    return frame(stored, images, 0, frame(stored, images, 1) if frames == 2 else None)


def truth(stored: Stored, classes: tuple[str, ...]) -> Boxes3D:
    gt = stored["gt"]
    return Boxes3D.create(gt[:, :3], gt[:, 3:6], gt[:, 6], [classes[i] for i in stored["labels"]], velocity_mps=gt[:, 7:])


def error(ours: Tensor, theirs: np.ndarray) -> Tensor:
    expected = torch.from_numpy(theirs)
    assert ours.shape == expected.shape
    return (ours - expected).abs() / expected.abs().max()


def head_outputs(stored: Stored) -> dict[str, Tensor]:
    """Stored maps of all tasks in our order."""
    return {
        ours: torch.cat([torch.from_numpy(stored[f"task{task}_{theirs}"]) for task in range(6)], dim=1)
        for theirs, ours in BRANCHES.items()
    }


def rows(boxes: Boxes3D) -> np.ndarray:
    """One row per box with classes and places in an order that ties between scores cannot change."""
    # the generated weights ask for boxes longer than the planet and thinner than an atom; ours end at exp(-5) and exp(5) m
    size = np.clip(np.log(boxes.size_m), -5, 5)
    columns = [boxes.centre_m, size, np.cos(boxes.yaw_rad), np.sin(boxes.yaw_rad), boxes.velocity_mps, boxes.scores]
    table = np.column_stack(columns)
    return table[np.lexsort((np.round(table[:, 0], 2), np.round(table[:, 1], 2), boxes.labels))]


def expected_boxes(stored: Stored) -> Boxes3D:
    found = stored["boxes"].astype(np.float64)
    found[:, 3:6] = np.clip(found[:, 3:6], 1e-9, None)  # underflow to zero metres
    labels = np.array([name for task in NUSCENES_TASKS for name in task])[stored["box_labels"]]
    return Boxes3D.create(found[:, :3], found[:, 3:6], found[:, 6], labels, scores=stored["scores"], velocity_mps=found[:, 7:])


def targets_of(stored: Stored, model_config: BEVDepthConfig) -> CenterTargets:
    assert model_config.megvii is not None
    classes = model_config.megvii.classes
    return center_targets([truth(stored, classes)], classes, model_config.grid, single_precision=True)


class Stages:
    """What modules first return and read: that of the key frame, which comes before the other."""

    def __init__(self, model: BEVDepth) -> None:
        self.outputs: dict[str, Any] = {}
        self.inputs: dict[str, Any] = {}
        for name in ("neck", "depth_net", "bev_encoder"):
            getattr(model, name).register_forward_hook(partial(self._keep, name))

    def _keep(self, name: str, module: nn.Module, inputs: Any, output: Any) -> None:
        self.outputs.setdefault(name, output)
        self.inputs.setdefault(name, inputs[0])


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_stage(variant: str) -> None:
    stored, model = stored_of(variant), detector(variant)
    megvii = model.config.megvii
    assert megvii is not None
    stages, key = Stages(model), batch(stored)
    with torch.inference_mode():
        outputs = model(key)
    assert error(stages.outputs["neck"][:, ::8], stored["feat"]).max() < 2e-5
    assert error(torch.cat(stages.outputs["depth_net"], dim=1), stored["depthnet"]).max() < 2e-5
    lift = model.lift_splat
    assert isinstance(lift, ReleasedLiftSplat)
    points = lift.points(key.lift_cameras, key.sample_index, key.bev_from_ego)[:, :, :, ::16]
    assert error(points.permute(0, 3, 1, 2, 4)[None], stored["geom"]).max() < 1e-6
    off = error(stages.inputs["bev_encoder"][:, ::8], stored["bev"])
    assert off.max() < 5e-3 and (off > 1e-4).float().mean() < 1e-3
    if variant in WITH_HEADS:
        for name, theirs in head_outputs(stored).items():
            assert error(outputs[name], theirs.numpy()).max() < 5e-4, name
    losses = task_losses(outputs, targets_of(stored, model.config), megvii.tasks, megvii.weights)
    assert float(sum(losses.values())) == pytest.approx(float(stored["loss"]), rel=5e-4)
    if variant not in WITH_HEADS:
        check_boxes(outputs, model.config, expected_boxes(stored))


def check_boxes(outputs: dict[str, Tensor], config: BEVDepthConfig, expected: Boxes3D) -> None:
    """Boxes of our own maps. In some tasks a hundred cells and more have a score that rounds to 1: which of them suppress the
    others is chance there, so for these tasks every stored box only has to be among those before suppression."""
    assert config.megvii is not None
    tasks, options = config.megvii.tasks, config.megvii.decode
    every = replace(options, squared_distance_m2=(-1.0,) * len(tasks), max_boxes=1000, max_kept=1000)
    (found,), (candidates,) = (decode_tasks(outputs, tasks, config.grid, o) for o in (options, every))
    far = np.linalg.norm(expected.centre_m[:, None] - candidates.centre_m[None], axis=2)
    far[expected.labels[:, None] != candidates.labels[None]] = np.inf
    np.testing.assert_allclose(rows(candidates[far.argmin(1)]), rows(expected), atol=1e-3)
    clear = 0
    for task, names in enumerate(tasks):
        if (task_maps(outputs, tasks, task)["heatmap"].sigmoid() == 1).sum() < 10:
            ours, theirs = (rows(table[np.isin(table.labels, names)]) for table in (found, expected))
            np.testing.assert_allclose(ours, theirs, atol=1e-3)
            clear += 1
    assert clear >= 2


@pytest.mark.parametrize("variant", VARIANTS)
def test_targets(variant: str) -> None:
    stored, config = stored_of(variant), BEVDepthConfig.released_megvii()
    targets = targets_of(stored, config)
    values = torch.cat([targets.values, targets.velocity_mps], dim=1)
    for task in range(len(NUSCENES_TASKS)):
        first, end = class_range(NUSCENES_TASKS, task)
        np.testing.assert_array_equal(targets.heatmap[:, first:end].numpy(), stored[f"hm{task}"])
        mine = values[(targets.label >= first) & (targets.label < end)].numpy()
        expected = stored[f"anno{task}"][0]
        assert len(mine) == int(expected.any(1).sum())
        np.testing.assert_allclose(mine, expected[: len(mine)], atol=1e-6)
    assert len(values) == 3


@pytest.mark.parametrize("variant", WITH_HEADS)
def test_loss_and_boxes_of_stored_maps(variant: str) -> None:
    stored, config = stored_of(variant), BEVDepthConfig.released_megvii(VARIANTS[variant][0])
    assert config.megvii is not None
    outputs = head_outputs(stored)
    losses = task_losses(outputs, targets_of(stored, config), config.megvii.tasks, config.megvii.weights)
    assert float(sum(losses.values())) == pytest.approx(float(stored["loss"]), rel=2e-7)
    (found,) = decode_tasks(outputs, config.megvii.tasks, config.grid, config.megvii.decode)
    expected = expected_boxes(stored)
    assert (np.diff(found.scores) <= 0).all()
    np.testing.assert_array_equal(np.sort(found.labels), np.sort(expected.labels))
    np.testing.assert_allclose(rows(found), rows(expected), atol=1e-6)
