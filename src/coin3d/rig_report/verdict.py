"""The distance of a rig to a training in words: what is new about each camera, and what usually follows from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from coin3d.rig_report.prior_distance import (
    HEIGHT_TOLERANCE_M,
    PITCH_TOLERANCE_DEG,
    ROLL_TOLERANCE_DEG,
    CameraDistance,
    RigDistance,
    Span,
)
from coin3d.rig_report.row_ranges import RELATIVE_TOLERANCE

Level = Literal["as in training", "beyond training", "far beyond training"]

_FAR_RATIO = 1.25
_SEEN_SHARE = 0.1
_FAR_SHARE = 0.5
_FAR_HEIGHT_M, _FAR_PITCH_DEG, _FAR_ROLL_DEG = 0.5, 8.0, 30.0
_TURN_DEG = 5.0
_OFFSET_M, _FAR_OFFSET_M = 0.5, 1.5


@dataclass(frozen=True)
class Verdict:
    """One camera in words.

    Args:
        name: the camera.
        level: of the largest difference. The limits are rules of thumb about geometry; no accuracy was measured for them.
        findings: what is new, the largest kinds of difference first; one sentence that nothing is where that is so.
    """

    name: str
    level: Level
    findings: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.name}: {self.level}. " + " ".join(self.findings)


def verdicts(distance: RigDistance) -> tuple[Verdict, ...]:
    """One for each camera, against everything that training showed."""
    return tuple(_verdict(camera) for camera in distance.shown)


def advice(found: Sequence[Verdict], method: str | None) -> str:
    """What to do about it, for the rig as a whole.

    Args:
        found: of all cameras.
        method: with which the checkpoint was trained; None where no checkpoint was given.
    """
    new = [v.name for v in found if v.level != "as in training"]
    if not new:
        return (
            "All cameras lie within what training showed. That says that nothing is new about the geometry, not that streets, "
            "weather or images resemble those of the training."
        )
    count = "All cameras go" if len(new) == len(found) else f"{len(new)} of {len(found)} cameras go ({', '.join(new)})"
    if len(new) == 1 < len(found):
        count = f"One of {len(found)} cameras goes ({new[0]})"
    reads = {
        "coin3d": "This checkpoint reads the four prior maps (method coin3d), which is meant for new cameras, but it has not "
        "read values as far out as these.",
        None: "A network that does not read the prior maps (any method but coin3d) has no way to know of the difference.",
    }.get(method, f"This checkpoint (method {method}) does not read the prior maps: expect its distances to be off on them.")
    return (
        f"{count} beyond what training showed. {reads} Score it on labelled frames of this rig before you rely on it, or train "
        "with coin3d and novel views whose ranges hold these cameras."
    )


def _verdict(camera: CameraDistance) -> Verdict:
    notes: list[tuple[bool, str]] = []
    notes += _focal(camera.focal_px)
    notes += _ground(camera)
    notes += _tilt(camera)
    notes += _looks(camera)
    if not notes:
        return Verdict(camera.name, "as in training", ("Focal length, ground and rays lie within what training showed.",))
    far = any(is_far for is_far, _ in notes)
    findings = [words for is_far, words in notes if is_far] + [words for is_far, words in notes if not is_far]
    return Verdict(camera.name, "far beyond training" if far else "beyond training", tuple(findings))


def _focal(focal: Span) -> list[tuple[bool, str]]:
    ratio = focal.ratio or 1.0
    if 1 / (1 + RELATIVE_TOLERANCE) <= ratio <= 1 + RELATIVE_TOLERANCE:
        return []
    which, seems = ("longest", "larger and so nearer") if ratio > 1 else ("shortest", "smaller and so farther")
    words = (
        f"Focal {ratio:.2f}x the {which} in training ({focal.value:.0f} against {focal.nearest:.0f} px at network input): "
        f"objects look {seems} than they are to a network that is not told."
    )
    return [(_is_far(ratio), words)]


def _ground(camera: CameraDistance) -> list[tuple[bool, str]]:
    notes = []
    rise_m = camera.height_m.beyond or 0.0
    if abs(rise_m) > HEIGHT_TOLERANCE_M:
        word, which = ("higher", "highest") if rise_m > 0 else ("lower", "lowest")
        words = (
            f"{abs(rise_m):.2f} m {word} than the {which} camera in training ({camera.height_m.value:.2f} m above the ground)."
        )
        notes.append((abs(rise_m) > _FAR_HEIGHT_M, words))
    ratio = camera.depth_ratio
    if ratio is None and camera.depth_outside > _SEEN_SHARE:
        notes.append((True, "No image row shows ground where training showed some."))
    elif ratio is not None and camera.depth_outside > _SEEN_SHARE:
        where = f"In {camera.depth_outside:.0%} of the image the ground lies where training never had it in these rows"
        typical = f": typically {ratio:.2f}x as deep, {20 * ratio:.0f} m instead of 20 m" if abs(ratio - 1) > 0.01 else ""
        notes.append((camera.depth_outside > _FAR_SHARE or _is_far(ratio), f"{where}{typical}."))
    return notes


def _tilt(camera: CameraDistance) -> list[tuple[bool, str]]:
    notes = []
    pitch, roll = camera.pitch_deg.beyond or 0.0, camera.roll_deg.beyond or 0.0
    if abs(pitch) > PITCH_TOLERANCE_DEG:
        words = f"Looks {abs(pitch):.0f} degrees farther {'down' if pitch > 0 else 'up'} than any camera in training."
        notes.append((abs(pitch) > _FAR_PITCH_DEG, words))
    if abs(roll) > 120:
        words = "Hangs upside down, as no camera in training did: turn its images and its calibration by 180 degrees first."
        notes.append((True, words))
    elif abs(roll) > ROLL_TOLERANCE_DEG:
        notes.append((abs(roll) > _FAR_ROLL_DEG, f"Leans {abs(roll):.0f} degrees more than any camera in training."))
    return notes


def _looks(camera: CameraDistance) -> list[tuple[bool, str]]:
    notes = []
    share = camera.direction_outside
    if share > _SEEN_SHARE:
        turn_deg = abs(camera.nearest_yaw_deg)
        nearest = f" (the nearest looks {turn_deg:.0f} degrees to the side)" if turn_deg > _TURN_DEG else ""
        away = f"up to {camera.direction_deg:.0f} degrees away"
        words = f"{share:.0%} of its rays point where no training camera looked, {away}{nearest}."
        notes.append((share > _FAR_SHARE, words))
    if camera.offset_m is not None and camera.offset_m > _OFFSET_M:
        words = f"Its rays pass {camera.offset_m:.1f} m from those of training cameras which look the same way."
        notes.append((camera.offset_m > _FAR_OFFSET_M, words))
    return notes


def _is_far(ratio: float) -> bool:
    return max(ratio, 1 / ratio) > _FAR_RATIO
