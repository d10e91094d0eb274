"""The tree of frames that ROS publishes as tf messages."""

from __future__ import annotations

from reprlib import repr as short
from typing import Any

from coin3d.geometry import Pose
from coin3d.rig_import.fields import entry, numbers


class TfTree:
    """Frames and the transforms between them; ``add`` fills it.

    A transform says where a child frame sits in its parent: it maps coordinates of the child to those of the parent.
    """

    def __init__(self) -> None:
        self._parents: dict[str, str] = {}
        self._poses: dict[str, Pose] = {}
        self._moving: set[str] = set()

    @property
    def frames(self) -> list[str]:
        """All frames that a transform names."""
        return sorted({*self._parents, *self._parents.values()})

    def add(self, data: Any, where: str) -> None:
        """Take in one TransformStamped. The same transform again changes nothing.

        Raises:
            ValueError: a missing or broken field, or a second parent of a frame.
        """
        parent = _frame(entry(entry(data, "header", where), "frame_id", f"{where}: header"), where)
        child = _frame(entry(data, "child_frame_id", where), where)
        transform = entry(data, "transform", where)
        translation, rotation = entry(transform, "translation", where), entry(transform, "rotation", where)
        x, y, z = numbers([entry(translation, axis, where) for axis in "xyz"], f"{where}: translation")
        wxyz = numbers([entry(rotation, axis, where) for axis in "wxyz"], f"{where}: rotation")
        try:
            pose = Pose.from_quaternion(wxyz, (x, y, z))
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from error
        before = self._parents.setdefault(child, parent)
        if before != parent:
            raise ValueError(f"{where}: the frame '{child}' has two parents, '{before}' and '{parent}': a tf tree allows one")
        if child in self._poses and not self._poses[child].allclose(pose, atol=1e-6):
            self._moving.add(child)
        self._poses[child] = pose

    def target_from_source(self, target: str, source: str, where: str) -> Pose:
        """The pose of one frame in another.

        Raises:
            ValueError: a frame that is not there, no link between the two, a loop, or a link that moves.
        """
        up_source, up_target = self._way_up(source, where), self._way_up(target, where)
        common = next((frame for frame in up_source if frame in up_target), None)
        if common is None:
            raise ValueError(
                f"{where}: no transform links '{source}' to '{target}': from '{source}' the tree ends at '{up_source[-1]}', "
                f"from '{target}' at '{up_target[-1]}'; record /tf_static from its first message on, and /tf if a link is there"
            )
        poses = []
        for way in (up_target, up_source):
            pose = Pose.identity()
            for frame in way[: way.index(common)]:
                if frame in self._moving:
                    raise ValueError(
                        f"{where}: the link from '{self._parents[frame]}' to '{frame}' moves; keep one message of it, with the "
                        "vehicle at rest"
                    )
                pose = self._poses[frame] @ pose
            poses.append(pose)
        return poses[0].inverse() @ poses[1]

    def _way_up(self, frame: str, where: str) -> list[str]:
        if frame not in self._parents and frame not in self._parents.values():
            raise ValueError(f"{where}: no frame '{frame}' in the tf messages, only {', '.join(self.frames[:20]) or 'none'}")
        way = [frame]
        seen = {frame}
        while (parent := self._parents.get(way[-1])) is not None:
            if parent in seen:
                raise ValueError(f"{where}: the tf tree runs in a loop: {' -> '.join([*way[way.index(parent) :], parent])}")
            way.append(parent)
            seen.add(parent)
        return way


def _frame(value: Any, where: str) -> str:
    if not isinstance(value, str) or not value.strip("/"):
        raise ValueError(f"{where}: a frame name is text, got {short(value)}")
    return value.lstrip("/")
