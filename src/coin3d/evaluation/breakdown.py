"""The metric of parts of the data: by range, camera, length, LiDAR points, visibility.

Matching is done once, on everything; a breakdown only sorts its outcome into groups.

* A hit belongs to the group of its object, wherever the detection lies.
* A false positive belongs to the group of its own place. That needs a property that a wrong detection has as well: range and
  camera are such, and give AP.
* Length, LiDAR points and visibility are properties of annotated objects alone (a wrong length is an error, and nobody counts
  points in boxes that are not there or judges how much of them is hidden): false positives have no group, and there is recall
  and no AP.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from coin3d.evaluation.box_table import BoxTable
from coin3d.evaluation.curves import RankedClass, average_precision, mean_errors
from coin3d.evaluation.matching import Matches
from coin3d.evaluation.visibility import seen_by_camera
from coin3d.geometry import VISIBILITY_PERCENT, Rig

RANGE_EDGES_M = (0.0, 20.0, 35.0, np.inf)
LENGTH_EDGES_M = (0.0, 2.0, 4.0, 5.0, 8.0, np.inf)
LIDAR_EDGES = (0.0, 1.0, 6.0, 21.0, 101.0, np.inf)


@dataclass(frozen=True)
class GroupMetrics:
    """One class in one group.

    Args:
        num_truth: objects of the group, at least one.
        ap: mean over the distance thresholds; None where false positives have no group.
        recall: share of the objects that a detection of any score found at ``tp_threshold_m``.
        ate: translation error in metres, averaged as for the whole class.
        ase: scale error.
        aoe: orientation error in radians.
    """

    num_truth: int
    ap: float | None
    recall: float
    ate: float
    ase: float
    aoe: float


@dataclass(frozen=True)
class Breakdown:
    """A property, and the metric of each of its groups.

    Args:
        name: the property.
        groups: group -> class -> numbers; classes without objects in the group are left out.
    """

    name: str
    groups: Mapping[str, Mapping[str, GroupMetrics]]

    def row(self) -> dict[str, Any]:
        """Plain numbers for ``result.json``."""
        return {group: {name: asdict(m) for name, m in classes.items()} for group, classes in self.groups.items()}

    def table(self) -> str:
        """Plain text, one line per group and class."""
        width = max([20, *(len(group) + 2 for group in self.groups)])
        head = "".join(f"{cell:>8}" for cell in ("truth", "AP", "recall", "ATE", "ASE", "AOE"))
        lines = [f"{'by ' + self.name:<{width}}{'class':<12}{head}"]
        for group, classes in self.groups.items():
            for name, m in classes.items():
                ap = "-" if m.ap is None else f"{m.ap:.3f}"
                numbers = "".join(f"{x:>8.3f}" for x in (m.recall, m.ate, m.ase, m.aoe))
                lines.append(f"{group:<{width}}{name:<12}{m.num_truth:>8}{ap:>8}{numbers}")
        return "\n".join(lines)


def breakdowns(matches: Matches, rigs: Mapping[str, Rig]) -> list[Breakdown]:
    """All of them."""
    return [
        by_range(matches),
        by_camera(matches, rigs),
        by_length(matches),
        by_lidar_points(matches),
        by_visibility(matches),
    ]


def by_range(matches: Matches) -> Breakdown:
    """By radial distance from the ego origin (tables in the ego frame)."""

    def distance_m(table: BoxTable) -> Float[np.ndarray, "n"]:
        return np.asarray(np.hypot(table.centre_m[:, 0], table.centre_m[:, 1]))

    groups, objects = _between(distance_m(matches.truth), RANGE_EDGES_M, _metres)
    return _break_down(matches, "range", groups, objects, _between(distance_m(matches.predictions), RANGE_EDGES_M, _metres)[1])


def by_camera(matches: Matches, rigs: Mapping[str, Rig]) -> Breakdown:
    """By the camera whose image the centre lies in (tables in the ego frame); what two cameras see counts for both."""
    objects = dict(seen_by_camera(matches.truth, rigs))
    detections = dict(seen_by_camera(matches.predictions, rigs))
    everything = list(dict.fromkeys([*objects, *detections]))
    nowhere = [np.zeros(len(matches.truth), dtype=bool), np.zeros(len(matches.predictions), dtype=bool)]
    masks = [[seen.get(name, none) for name in everything] for seen, none in zip((objects, detections), nowhere, strict=True)]
    for seen, none in zip(masks, nowhere, strict=True):
        seen.append(~np.logical_or.reduce([none, *seen]))
    return _break_down(matches, "camera", [*everything, "no camera"], *masks)


def by_length(matches: Matches) -> Breakdown:
    """By length of the object; recall and no AP."""
    return _break_down(matches, "length", *_between(matches.truth.size_m[:, 0], LENGTH_EDGES_M, _metres))


def by_lidar_points(matches: Matches) -> Breakdown:
    """By annotated number of LiDAR points in the object; recall and no AP."""
    points = matches.truth.num_lidar_points
    known = np.full(len(matches.truth), -1) if points is None else points
    groups, objects = _between(known, LIDAR_EDGES, _counts)
    return _break_down(matches, "LiDAR points", ["unknown", *groups], [known < 0, *objects])


def by_visibility(matches: Matches) -> Breakdown:
    """By annotated visible share of the object; recall and no AP."""
    level = matches.truth.visibility
    known = np.zeros(len(matches.truth), dtype=np.int8) if level is None else level
    groups = ["unknown", *(f"{low} - {high} %" for low, high in pairwise(VISIBILITY_PERCENT))]
    return _break_down(matches, "visibility", groups, [known == k for k in range(len(groups))])


def _break_down(
    matches: Matches,
    name: str,
    groups: Sequence[str],
    objects: Sequence[Bool[np.ndarray, "m"]],
    detections: Sequence[Bool[np.ndarray, "n"]] | None = None,
) -> Breakdown:
    """Numbers of every group that has objects; masks say which rows of truth and predictions are in which group."""
    found: dict[str, dict[str, GroupMetrics]] = {}
    for g, group in enumerate(groups):
        in_group = {
            c: int(np.count_nonzero(objects[g][matches.truth.label == i])) for i, c in enumerate(matches.protocol.classes)
        }
        found[group] = {
            c: _group_metrics(matches, c, count, objects[g], None if detections is None else detections[g])
            for c, count in in_group.items()
            if count
        }
    return Breakdown(name, {group: classes for group, classes in found.items() if classes})


def _group_metrics(
    matches: Matches,
    class_name: str,
    num_truth: int,
    objects: Bool[np.ndarray, "m"],
    detections: Bool[np.ndarray, "n"] | None,
) -> GroupMetrics:
    protocol = matches.protocol
    c = protocol.classes.index(class_name)
    rows, scores = matches.ranked_rows[c], matches.ranked_scores[c]
    ap, recall = [], 0.0
    errors: tuple[float, ...] = (1.0, 1.0, 1.0)
    for t, threshold_m in enumerate(protocol.distance_thresholds_m):
        taken = matches.object_row[t, rows]
        hit = taken >= 0
        hit[hit] = objects[taken[hit]]
        listed = hit if detections is None else hit | ((taken < 0) & detections[rows])
        ranked = RankedClass(scores[listed], hit[listed], num_truth)
        ap.append(average_precision(ranked, protocol))
        if threshold_m == protocol.tp_threshold_m:
            recall = int(np.count_nonzero(hit)) / num_truth
            errors = mean_errors(ranked, matches.errors_of(rows[hit], taken[hit]), protocol)
    return GroupMetrics(num_truth, None if detections is None else float(np.mean(ap)), recall, *errors)


def _between(
    values: np.ndarray, edges: tuple[float, ...], label: Callable[[float, float], str]
) -> tuple[list[str], list[Bool[np.ndarray, "n"]]]:
    """A group for each pair of neighbouring edges, the lower one included."""
    pairs = list(pairwise(edges))
    return [label(low, high) for low, high in pairs], [(values >= low) & (values < high) for low, high in pairs]


def _metres(low: float, high: float) -> str:
    return f"{low:g} m and more" if np.isinf(high) else f"{low:g} - {high:g} m"


def _counts(low: float, high: float) -> str:
    if np.isinf(high):
        return f"{low:g} and more"
    return f"{low:g}" if high == low + 1 else f"{low:g} - {high - 1:g}"
