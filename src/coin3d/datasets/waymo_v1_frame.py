"""One frame of the Waymo Open Dataset, version 1: a protocol buffer, read by the numbers of its fields (spec: Frame, Label)."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from coin3d.datasets.file_span import EncodedImage, FileSpan
from coin3d.datasets.protobuf_wire import Message
from coin3d.datasets.waymo_parts import (
    CAMERA_NAMES,
    LABEL_NAMES,
    LASER_NAMES,
    CameraCalibration,
    WaymoImage,
    WaymoInstant,
    WaymoLabels,
    checked_segment,
    checked_timestamp,
    number_of,
    pose_of,
)
from coin3d.datasets.waymo_range_image import LaserCalibration, LaserImages
from coin3d.geometry import Boxes3D, Pose

CONTEXT, TIMESTAMP, _POSE, _IMAGES, _LASERS, LABELS = 1, 2, 3, 4, 5, 6
"""Fields of a frame."""

CONTEXT_NAME = 1
_MAX_MATRIX_BYTES = 1 << 25
"""Of one range image when unpacked; that of the top laser with its poses has 4 MB."""


@dataclass(frozen=True)
class PackedLaser:
    """Where the range images of one laser lie in the file.

    Args:
        returns: those there are, first return first.
        pixel_poses: of the top laser.
    """

    returns: tuple[FileSpan, ...]
    pixel_poses: FileSpan | None


@dataclass(frozen=True, eq=False)
class PackedLasers:
    """Range images inside a record, read when asked for.

    Args:
        lasers: laser name -> place.
        where: names the frame in errors.
    """

    lasers: Mapping[str, PackedLaser]
    where: str

    def load(self, second_return: bool) -> Mapping[str, LaserImages]:
        """Unpack the range images.

        Raises:
            FileNotFoundError: the file is gone.
            ValueError: the file was changed, or a range image is damaged.
        """
        found = {}
        for name, laser in self.lasers.items():
            where = f"{self.where}: laser {name}"
            chosen = laser.returns if second_return else laser.returns[:1]
            poses = None if laser.pixel_poses is None else read_matrix(laser.pixel_poses.read(), f"{where}: pixel poses")
            returns = tuple(read_matrix(span.read(), f"{where}: return {i + 1}") for i, span in enumerate(chosen))
            found[name] = LaserImages(returns, poses)
        return found


def read_frame(payload: bytes, span: FileSpan, labelled: bool, where: str) -> WaymoInstant:
    """Everything of a frame but pixels and points, whose places are kept.

    Args:
        payload: the record.
        span: where it lies in its file.
        labelled: whether its segment has annotations: a frame without boxes in one that has is an empty street.
        where: names file and record in errors.

    Raises:
        ValueError: what is no frame, or a frame with a part that makes no sense.
    """
    message = Message(payload, where)
    context = message.message(CONTEXT, "context")
    if context is None:
        raise ValueError(f"{where}: has no context, so it is no frame of the Waymo Open Dataset")
    lasers = _packed_lasers(message, span)
    return WaymoInstant(
        segment=checked_segment(context.text(CONTEXT_NAME, "name of the segment"), where),
        timestamp_us=checked_timestamp(message.whole(TIMESTAMP, "timestamp"), where),
        world_from_vehicle=_transform(message, _POSE, "pose"),
        calibrations=_cameras(context),
        images=_images(message, span),
        labels=_labels(message.messages(LABELS, "label")) if labelled else None,
        lasers=_laser_calibrations(context),
        range_images=PackedLasers(lasers, where) if lasers else None,
        where=where,
    )


def read_matrix(packed: bytes, where: str) -> Float[np.ndarray, "h w c"]:
    """A zlib-compressed matrix of three dimensions in single precision.

    Raises:
        ValueError: not whole, unpacked larger than any range image, or numbers that do not fill its shape.
    """
    unpacker = zlib.decompressobj()
    try:
        data = unpacker.decompress(packed, _MAX_MATRIX_BYTES)
    except zlib.error as error:
        raise ValueError(f"{where}: cannot be unpacked ({error}); the record is damaged") from error
    if not unpacker.eof:
        raise ValueError(f"{where}: is cut short, or has more than {_MAX_MATRIX_BYTES} bytes; the record is damaged")
    message = Message(data, where)
    values, shape = message.singles(1, "values"), message.message(2, "shape")
    dims = [] if shape is None else shape.wholes(1, "sizes")
    if len(dims) != 3 or int(np.prod(dims, dtype=object)) != len(values):
        raise ValueError(f"{where}: {len(values)} numbers for the shape {dims}; the record is damaged")
    return values.reshape(dims)


def _transform(message: Message, number: int, name: str) -> Pose:
    nested = message.message(number, name)
    if nested is None:
        raise ValueError(f"{message.where}: has no {name}")
    return pose_of(nested.reals(1, "transform"), nested.where)


def _cameras(context: Message) -> dict[int, CameraCalibration]:
    found = {}
    for row in context.messages(2, "camera calibration"):
        number = number_of(row.whole(1, "name"), CAMERA_NAMES, row.where)
        intrinsic = row.reals(2, "intrinsic")
        if intrinsic.shape != (9,) or not np.isfinite(intrinsic).all():
            raise ValueError(f"{row.where}: the intrinsic has 9 finite numbers, got {intrinsic.tolist()[:12]}")
        if number in found:
            raise ValueError(f"{row.where}: a second calibration of {CAMERA_NAMES[number]}")
        size = [row.whole(4, "width") or 0, row.whole(5, "height") or 0]
        found[number] = CameraCalibration(intrinsic, _transform(row, 3, "extrinsic"), *size)
    return found


def _images(message: Message, span: FileSpan) -> dict[int, WaymoImage]:
    found = {}
    for row in message.messages(_IMAGES, "image"):
        number = number_of(row.whole(1, "name"), CAMERA_NAMES, row.where)
        place = row.span(2, "image")
        if place is None or number in found:
            raise ValueError(f"{row.where}: {'no' if place is None else 'a second'} image of {CAMERA_NAMES[number]}")
        source = EncodedImage(span.within(*place), f"image {CAMERA_NAMES[number]} at byte {span.start + place[0]}")
        found[number] = WaymoImage(source, _transform(row, 3, "pose"))
    return found


def _laser_calibrations(context: Message) -> dict[str, LaserCalibration]:
    found = {}
    for row in context.messages(3, "laser calibration"):
        name = LASER_NAMES[number_of(row.whole(1, "name"), LASER_NAMES, row.where)]
        lowest, highest = row.real(3, "lowest inclination"), row.real(4, "highest inclination")
        inclinations = row.reals(2, "inclinations")
        if not len(inclinations) and (lowest is None or highest is None):
            raise ValueError(f"{row.where}: {name} has neither inclinations nor their range")
        try:
            found[name] = LaserCalibration(_transform(row, 5, "extrinsic"), lowest or 0.0, highest or 0.0, inclinations)
        except ValueError as error:
            raise ValueError(f"{row.where}: {name}: {error}") from error
    return found


def _packed_lasers(message: Message, span: FileSpan) -> dict[str, PackedLaser]:
    found = {}
    for row in message.messages(_LASERS, "laser"):
        returns, poses = [], None
        for number in (2, 3):
            image = row.message(number, f"return {number - 1}")
            place = None if image is None else image.span(2, "range image")
            if image is not None and place is not None and place[1] > place[0]:
                returns.append(span.within(*place))
                at = image.span(4, "pixel poses")
                poses = span.within(*at) if at is not None and at[1] > at[0] else poses
        if returns:  # recordings made smaller keep empty lasers
            name = LASER_NAMES[number_of(row.whole(1, "name"), LASER_NAMES, row.where)]
            found[name] = PackedLaser(tuple(returns), poses)
    return found


def _labels(rows: list[Message]) -> WaymoLabels:
    boxes = [_box(row) for row in rows]
    speeds = [row.message(2, "metadata") for row in rows]
    velocity = [[_or_nan(s, 1, "speed in x"), _or_nan(s, 2, "speed in y")] for s in speeds]
    numbers = [number_of(row.whole(3, "type") or 0, LABEL_NAMES, row.where) for row in rows]
    counts = [row.whole(7, "number of LiDAR points") for row in rows]
    for row, box, count in zip(rows, boxes, counts, strict=True):
        if not (np.isfinite(box).all() and min(box[3:6]) > 0 and (count or 0) < 1 << 31):
            raise ValueError(f"{row.where}: a box of {box} with {count} LiDAR points; sizes are positive metres")
    table = np.array(boxes, dtype=np.float64).reshape(-1, 7)
    return WaymoLabels(
        Boxes3D.create(
            table[:, :3],
            table[:, [4, 3, 5]],  # the fields are in the order width, length, height
            table[:, 6],
            [LABEL_NAMES[n] for n in numbers],
            instance_ids=[row.text(4, "id") or "" for row in rows],
            num_lidar_points=[-1 if count is None else count for count in counts],
        ),
        np.array(velocity, dtype=np.float64).reshape(-1, 2),
    )


def _box(label: Message) -> list[float]:
    box = label.message(1, "box")
    if box is None:
        raise ValueError(f"{label.where}: has no box")
    return [box.real(n, f"number {n}") or 0.0 for n in range(1, 8)]


def _or_nan(message: Message | None, number: int, name: str) -> float:
    value = None if message is None else message.real(number, name)
    return float("nan") if value is None else value
