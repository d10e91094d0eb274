"""Seeds of object queries: the boxes a dense head sees come back as the decoder's first boxes."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from coin3d.detectors.center_targets import center_targets
from coin3d.detectors.lift_splat import BevGrid
from coin3d.detectors.object_queries import PRIOR_LOGIT, ObjectQueries
from coin3d.detectors.object_seeds import FirstBoxes, ObjectSeeds, centre_boxes, check_seeds
from coin3d.detectors.query_boxes import encode_boxes, place_boxes
from coin3d.detectors.space_range import SpaceRange
from coin3d.geometry import Boxes3D

SPACE = SpaceRange((-25.6, -25.6, -3.0), (25.6, 25.6, 5.0))


def cars(*places: tuple[float, float, float]) -> Boxes3D:
    """Cars at (x, y) with a yaw."""
    return Boxes3D.create(
        [(x, y, 0.8) for x, y, _ in places],
        [(4.2, 1.8, 1.6)] * len(places),
        [yaw for _, _, yaw in places],
        ["car"] * len(places),
    )


def test_centre_boxes_are_the_targets_of_the_head() -> None:
    grid, classes = BevGrid(25.6, 1.6), ("car", "pedestrian")
    boxes = cars((9.3, 1.1, 0.4), (-3.2, -12.7, -2.0))
    targets = center_targets([boxes], classes, grid, min_radius_cells=1)
    maps = {"heatmap": 20 * (targets.heatmap - 0.5)}
    start = 0
    for name, channels in {"offset": 2, "height": 1, "size": 3, "heading": 2}.items():
        maps[name] = torch.zeros(1, channels, grid.side, grid.side)
        maps[name].flatten(2)[0][:, targets.cell] = targets.values[:, start : start + channels].T
        start += channels
    bev = torch.randn(1, 5, grid.side, grid.side)
    found = centre_boxes(maps, bev, grid, 12)
    assert found.code.shape == (1, 12, 10)
    order = np.argsort(found.code[0, :2, 0].numpy())[::-1].copy()
    wanted = encode_boxes(boxes)
    torch.testing.assert_close(found.code[0, :2][order][:, :8], wanted[:, :8], atol=1e-5, rtol=0)
    assert (found.score[0, :2, 0] > 0.99).all() and (found.score[0, :, 1] < 0.01).all()
    assert (found.score[0, 2:, 0] < 0.02).all()  # what is beside a peak is put back
    torch.testing.assert_close(found.feature[0, 0], bev[0].flatten(1)[:, targets.cell[order[0]]])


def test_a_decoder_that_corrects_nothing_gives_the_first_boxes() -> None:
    boxes = cars((9.3, 1.1, 0.4), (-3.2, -12.7, -2.0))
    code = encode_boxes(boxes).nan_to_num(0.0)[None]
    first = FirstBoxes(code, torch.tensor([[[0.7], [0.2]]]), torch.randn(1, 2, 5, requires_grad=True))
    torch.manual_seed(0)
    seeds = ObjectSeeds(5, 16, 1)(first, SPACE)
    learned = ObjectQueries.learned(torch.rand(1, 3, 3), torch.zeros(1, 3, 16), torch.zeros(1, 3, 16), classes=1)
    queries = learned.joined(seeds)
    nothing = torch.zeros(1, 5, 10)
    torch.testing.assert_close(place_boxes(nothing, queries.place, SPACE, queries.code)[:, 3:], code, atol=1e-4, rtol=0)
    scores = (queries.logits + PRIOR_LOGIT).sigmoid()[0, :, 0]
    torch.testing.assert_close(scores, torch.tensor([0.01, 0.01, 0.01, 0.7, 0.2]), atol=1e-4, rtol=0)
    assert seeds.content.requires_grad


def test_configurations_that_cannot_be() -> None:
    for arguments, message in (((-1, 1.0, False), "at least 0"), ((5, 0.0, False), "dense head"), ((5, 1.0, True), "released")):
        with pytest.raises(ValueError, match=message):
            check_seeds(*arguments)
