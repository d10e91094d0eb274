"""Head of several tasks: which map is whose, losses by hand, and boxes that survive encoding and decoding."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from coin3d.detectors.center_targets import CenterTargets, center_targets, focal_loss
from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.task_decode import TaskDecodeOptions, decode_tasks
from coin3d.detectors.task_heads import TASK_REGRESSIONS, TaskHeads, class_range, task_maps
from coin3d.detectors.task_losses import TaskLossWeights, task_losses
from coin3d.geometry import Boxes3D

GRID = BevGrid(half_extent_m=12.8, cell_m=0.8)
TASKS = (("car",), ("pedestrian", "cone"))
CLASSES = ("car", "pedestrian", "cone")
OPTIONS = TaskDecodeOptions(squared_distance_m2=(4.0, 0.175), min_score=0.5)


def boxes(*rows: tuple[str, float, float], velocity: tuple[float, float] = (1.5, -0.5)) -> Boxes3D:
    """One box per (class, x, y)."""
    n = len(rows)
    centre = np.array([[x, y, 0.5] for _, x, y in rows]).reshape(-1, 3)
    size, yaw = np.tile([4.0, 1.6, 1.5], (n, 1)), np.full(n, 0.5)
    return Boxes3D.create(centre, size, yaw, [name for name, _, _ in rows], velocity_mps=np.tile(velocity, (n, 1)))


def ideal_outputs(targets: CenterTargets) -> dict[str, Tensor]:
    """Maps that say exactly what the targets want."""
    samples, classes, side, _ = targets.heatmap.shape
    outputs = {"heatmap": torch.logit(targets.heatmap.clamp(1e-4, 1 - 1e-4))}
    task_of_class = torch.tensor([t for t, names in enumerate(TASKS) for _ in names])
    values, start = torch.cat([targets.values, targets.velocity_mps], dim=1), 0
    for name, channels in TASK_REGRESSIONS.items():
        flat = torch.zeros(samples, len(TASKS), channels, side * side)
        flat[targets.sample, task_of_class[targets.label], :, targets.cell] = values[:, start : start + channels]
        outputs[name] = flat.reshape(samples, -1, side, side)
        start += channels
    assert classes == len(CLASSES)
    return outputs


def test_maps_of_a_task() -> None:
    torch.manual_seed(0)
    head = TaskHeads(8, TASKS, 16).eval()
    bev = torch.randn(2, 8, 16, 16)
    with torch.no_grad():
        outputs = head(bev)
        shared = head.shared_conv(bev)
        alone = {name: head.tasks[1][name](shared) for name in outputs}
    assert {name: values.shape[1] for name, values in outputs.items()} == {
        **{name: 2 * channels for name, channels in TASK_REGRESSIONS.items()},
        "heatmap": 3,
    }
    second = task_maps(outputs, TASKS, 1)
    assert second.keys() == alone.keys() and all(torch.equal(second[name], alone[name]) for name in alone)
    assert [class_range(TASKS, task) for task in (0, 1)] == [(0, 1), (1, 3)]
    assert float(outputs["heatmap"].sigmoid().mean()) == pytest.approx(0.1, abs=0.03)


def test_losses_by_hand() -> None:
    table = Boxes3D.concatenate([boxes(("car", 1.0, 2.0), ("cone", -4.0, 0.0)), boxes(("cone", 5.0, 5.0))])
    targets = center_targets([Boxes3D.empty(), table], CLASSES, GRID)
    assert targets.label.tolist() == [0, 2, 2]
    outputs = ideal_outputs(targets)
    weights = TaskLossWeights(heatmap=2.0, box=0.25, velocity=0.5)
    perfect = task_losses(outputs, targets, TASKS, weights)
    assert all(float(perfect[name]) == pytest.approx(0, abs=1e-6) for name in TASK_REGRESSIONS)
    expected = focal_loss(outputs["heatmap"][:, :1], targets.heatmap[:, :1])
    expected = expected + focal_loss(outputs["heatmap"][:, 1:], targets.heatmap[:, 1:])
    assert float(perfect["heatmap"]) == pytest.approx(2 * float(expected), rel=1e-6)
    outputs["height"][1] += 0.5  # at the one car and at both cones: 0.5 per object of each task
    outputs["velocity"][1, 2:] += 1.0  # of the second task, both components
    losses = {name: float(value) for name, value in task_losses(outputs, targets, TASKS, weights).items()}
    assert losses["height"] == pytest.approx(0.25 * (0.5 + 0.5), rel=1e-5)
    assert losses["velocity"] == pytest.approx(0.25 * 0.5 * 2.0, rel=1e-5)


def test_unknown_velocities_and_empty_frames_cost_nothing() -> None:
    known, unknown = boxes(("car", 1.0, 2.0)), boxes(("car", -5.0, 2.0), velocity=(np.nan, np.nan))
    targets = center_targets([Boxes3D.concatenate([known, unknown])], CLASSES, GRID)
    outputs = {name: values.requires_grad_() for name, values in ideal_outputs(targets).items()}
    losses = task_losses({**outputs, "velocity": outputs["velocity"].nan_to_num() + 1}, targets, TASKS, TaskLossWeights())
    assert float(losses["velocity"].detach()) == pytest.approx(0.25 * 2 / 2, rel=1e-5)  # two components of one of two cars
    torch.stack(list(losses.values())).sum().backward()
    assert all(values.grad is not None and values.grad.isfinite().all() for values in outputs.values())
    nothing = center_targets([Boxes3D.empty()], CLASSES, GRID)
    assert nothing.label.shape == (0,) and nothing.velocity_mps.shape == (0, 2)
    empty = task_losses(ideal_outputs(nothing), nothing, TASKS, TaskLossWeights())
    assert all(float(empty[name]) == 0 for name in TASK_REGRESSIONS) and empty["heatmap"].isfinite()


def test_gradients_of_the_losses() -> None:
    small = BevGrid(half_extent_m=1.6, cell_m=0.8)
    targets = center_targets([boxes(("car", 0.3, 0.5), ("cone", -1.0, -1.0))], CLASSES, small)
    generator = torch.Generator().manual_seed(0)
    channels = {**{name: 2 * c for name, c in TASK_REGRESSIONS.items()}, "heatmap": 3}
    inputs = [torch.randn(1, c, 4, 4, dtype=torch.float64, generator=generator).requires_grad_() for c in channels.values()]

    def total(*maps: Tensor) -> Tensor:
        losses = task_losses(dict(zip(channels, maps, strict=True)), targets, TASKS, TaskLossWeights())
        return torch.stack(list(losses.values())).sum()

    assert torch.autograd.gradcheck(total, inputs, fast_mode=True)


def test_encoding_then_decoding_gives_the_boxes_back() -> None:
    truth = boxes(("car", 1.0, 2.0), ("cone", -4.0, 0.0), ("pedestrian", 5.0, 5.0), ("car", 1.0, 5.0), ("cone", 1.1, 2.1))
    found, none = decode_tasks(
        ideal_outputs(center_targets([truth, Boxes3D.empty()], CLASSES, GRID, min_radius_cells=1)), TASKS, GRID, OPTIONS
    )
    assert len(none) == 0 and len(found) == len(truth)
    order, of_truth = (np.lexsort((np.round(t.centre_m[:, 0], 3), t.labels)) for t in (found, truth))
    assert found.labels[order].tolist() == truth.labels[of_truth].tolist()
    for name in ("centre_m", "size_m", "yaw_rad", "velocity_mps"):
        np.testing.assert_allclose(getattr(found, name)[order], getattr(truth, name)[of_truth], atol=1e-5)


def test_classes_of_a_task_suppress_each_other_tasks_do_not() -> None:
    targets = center_targets([boxes(("car", 0.1, 0.1), ("cone", 0.1, 0.1), ("pedestrian", 0.3, 0.1))], CLASSES, GRID)
    outputs = ideal_outputs(targets)
    outputs["heatmap"][0, 1] -= 0.5  # the pedestrian is the less certain of the two
    (found,) = decode_tasks(outputs, TASKS, GRID, OPTIONS)
    assert sorted(found.labels.tolist()) == ["car", "cone"]


def test_what_is_off_the_map_or_no_number_is_left_out() -> None:
    targets = center_targets([boxes(("car", 1.0, 2.0), ("car", -8.0, 2.0), ("car", 8.0, -8.0))], CLASSES, GRID)
    for name, value in (("height", 11.0), ("velocity", np.nan), ("offset", np.inf), ("size", np.nan), ("heatmap", np.nan)):
        outputs = ideal_outputs(targets)
        row, column = divmod(int(targets.cell[0]), GRID.side)
        outputs[name][0, 0, row, column] = value
        (found,) = decode_tasks(outputs, TASKS, GRID, OPTIONS)
        kept = [b for b in found.centre_m.tolist() if np.hypot(b[0] - 1.0, b[1] - 2.0) < 0.1]
        assert not kept and len(found) >= 2, name
    (fewer,) = decode_tasks(ideal_outputs(targets), TASKS, GRID, TaskDecodeOptions((4.0, 0.175), min_score=0.5, max_kept=2))
    assert len(fewer) == 2
