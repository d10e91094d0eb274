"""Codes, decoding and matching of queries by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from coin3d.detectors.query_boxes import QueryDecodeOptions, decode_queries, encode_boxes, place_boxes
from coin3d.detectors.query_losses import (
    QueryLossWeights,
    QueryTargets,
    match,
    query_losses,
    query_targets,
    sigmoid_focal_loss,
)
from coin3d.detectors.space_range import SpaceRange
from coin3d.geometry import Boxes3D
from small_world import scattered_boxes

CLASSES = ("car", "pedestrian")
SPACE = SpaceRange((-50.0, -50.0, -5.0), (50.0, 50.0, 5.0))
WEIGHTS = QueryLossWeights()


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20)
def test_boxes_survive_their_code(seed: int) -> None:
    boxes = scattered_boxes(seed)
    codes = encode_boxes(boxes)
    assert codes[:, 8:].isnan().all()  # velocities are not known
    logits = torch.tensor([[9.0, -9.0] if label == "car" else [-9.0, 9.0] for label in boxes.labels])
    logits -= torch.linspace(0, 1, len(boxes))[:, None]  # best first in the order given
    (found,) = decode_queries(logits[None], codes[None], CLASSES, QueryDecodeOptions(max_boxes=len(boxes)), with_velocity=False)
    np.testing.assert_array_equal(found.labels, boxes.labels)
    np.testing.assert_allclose(found.centre_m, boxes.centre_m, atol=1e-4)
    np.testing.assert_allclose(found.size_m, boxes.size_m, atol=1e-4)
    np.testing.assert_allclose(np.cos(found.yaw_rad - boxes.yaw_rad), 1, atol=1e-6)


def test_code_of_one_box() -> None:
    box = Boxes3D.create([[1.0, 2.0, 3.0]], [[math.e, 1.0, math.e**2]], [math.pi / 6], ["car"], velocity_mps=[[4.0, 5.0]])
    expected = [1, 2, 1, 0, 3, 2, 0.5, math.sqrt(3) / 2, 4, 5]
    torch.testing.assert_close(encode_boxes(box)[0], torch.tensor(expected))


def test_a_query_shifts_its_reference_point() -> None:
    raw = torch.tensor([math.log(3), 0.0, 7.0, 8.0, -40.0, 9.0, 1.0, 2.0, 3.0, 4.0])
    code = place_boxes(raw, torch.tensor([0.5, 0.25, 0.5]), SPACE)
    torch.testing.assert_close(code, torch.tensor([25.0, -25.0, 7, 8, -5, 9, 1, 2, 3, 4]))


def test_decoding_takes_the_best_pairs_of_query_and_class() -> None:
    logits = torch.tensor([[[2.0, 1.0], [-1.0, 3.0], [5.0, -9.0]]])
    codes = torch.zeros(1, 3, 10)
    codes[0, :, 0] = torch.tensor([10.0, 20.0, 70.0])  # the last lies out of range
    codes[0, 0, 3] = 88.0  # a width that would overflow
    (found,) = decode_queries(logits, codes, CLASSES, QueryDecodeOptions(max_boxes=4))
    assert found.labels.tolist() == ["pedestrian", "car", "pedestrian"]
    assert found.centre_m[:, 0].tolist() == [20, 10, 10]
    np.testing.assert_allclose(found.scores, torch.tensor([3.0, 2.0, 1.0]).sigmoid(), rtol=1e-6)
    assert np.isfinite(found.size_m).all()
    (strong,) = decode_queries(logits, codes, CLASSES, QueryDecodeOptions(min_score=0.9))
    assert strong.centre_m[:, 0].tolist() == [20]


def targets(places: list[float], labels: list[int]) -> QueryTargets:
    codes = torch.zeros(len(places), 10)
    codes[:, 0] = torch.tensor(places)
    return QueryTargets(torch.tensor(labels, dtype=torch.long), codes)


def test_matching_is_the_cheapest_in_total() -> None:
    """Greedily the first object would take the query at 1 m; in total it must leave it to the second."""
    codes = torch.zeros(3, 10)
    codes[:, 0] = torch.tensor([1.0, -3.0, 100.0])
    query, target = match(torch.zeros(3, 2), codes, targets([0.0, 4.0], [0, 0]), WEIGHTS)
    assert query.tolist() == [0, 1] and target.tolist() == [1, 0]


def test_scores_take_part_in_matching_and_velocities_do_not() -> None:
    codes, wanted = torch.zeros(2, 10), targets([0.0], [1])
    codes[0, 8:] = 1000.0
    query, _ = match(torch.tensor([[0.0, 4.0], [4.0, 0.0]]), codes, wanted, WEIGHTS)
    assert query.tolist() == [0]


def test_losses_by_hand() -> None:
    """Two queries, one object: one query is its own, the other stands for nothing."""
    logits = torch.zeros(1, 1, 2, 1)
    codes = torch.zeros(1, 1, 2, 10)
    codes[..., 1, 0] = 50.0
    codes[..., 0, 8] = 3.0
    truth = targets([2.0], [0])
    truth.codes[0, 9] = math.nan  # an unknown velocity asks for nothing
    losses = query_losses(logits, codes, [truth], WEIGHTS)
    assert float(losses["box_1"]) == pytest.approx(0.25 * (2.0 + 0.2 * 3.0))
    assert float(losses["class_1"]) == pytest.approx(2.0 * (0.25 + 0.75) * 0.25 * math.log(2))


def test_each_layer_is_matched_by_itself_and_all_objects_of_the_batch_count() -> None:
    codes = torch.zeros(2, 2, 3, 10)
    codes[0, :, 0, 0], codes[1, :, 2, 0] = 7.0, 7.0
    codes[:, :, 1, 0] = -90.0
    codes[0, :, 2, 0], codes[1, :, 0, 0] = 90.0, 90.0
    losses = query_losses(torch.zeros(2, 2, 3, 2), codes, [targets([8.0], [0]), targets([8.0], [1])], WEIGHTS)
    assert float(losses["box_1"]) == float(losses["box_2"]) == pytest.approx(0.25)


def test_more_objects_than_queries_and_numbers_that_are_not() -> None:
    losses = query_losses(torch.zeros(1, 1, 2, 2), torch.zeros(1, 1, 2, 10), [targets([1.0, 2.0, 3.0], [0, 1, 0])], WEIGHTS)
    assert all(loss.isfinite() for loss in losses.values())
    broken = query_losses(torch.full((1, 1, 2, 2), math.nan), torch.zeros(1, 1, 2, 10), [targets([1.0], [0])], WEIGHTS)
    assert broken["class_1"].isnan()  # the training loop names it


def test_targets_within_reach() -> None:
    boxes = Boxes3D.create(
        [[0.0, 0, 0], [49, 0, 0], [51, 0, 0], [0, 0, 6], [1, 1, 1]],
        np.ones((5, 3)),
        np.zeros(5),
        ["pedestrian", "car", "car", "car", "tram"],
    )
    found = query_targets(boxes, CLASSES, SPACE)
    assert found.labels.tolist() == [1, 0]
    assert found.codes[:, 0].tolist() == [0, 49]
    assert len(query_targets(Boxes3D.empty(), CLASSES, SPACE).labels) == 0


def test_focal_loss_gradient() -> None:
    logits = torch.linspace(-6, 6, 7, dtype=torch.float64, requires_grad=True)
    wanted = torch.tensor([0.0, 1, 0, 1, 0, 1, 0], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda x: sigmoid_focal_loss(x, wanted), logits)
    easy = sigmoid_focal_loss(torch.tensor([8.0]), torch.tensor([1.0]))
    assert float(easy) < 1e-8
