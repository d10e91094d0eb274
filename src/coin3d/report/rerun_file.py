"""A recording for the Rerun viewer: point cloud, cameras with their images, boxes, on one time line. Extra ``rerun``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import UInt8

from coin3d.drawing.colours import PREDICTION, RGB, TRUTH
from coin3d.geometry import Boxes3D, Rig
from coin3d.rendering import Gaussians

_TIMELINE = "frame"
_MIN_RADIUS_M = 0.01


class RerunFile:
    """Writes an ``.rrd`` file; it appears under its name when the block ends without an error.

    Everything is logged in the ego frame of its frame, below ``ego``.

    Args:
        path: the file.

    Raises:
        ImportError: rerun is not installed.
    """

    def __init__(self, path: Path) -> None:
        try:
            import rerun
        except ImportError as error:
            raise ImportError("recordings for Rerun need its library: pip install 'coin3d[rerun]'") from error
        self._rr: Any = rerun
        self.path = path
        self._partial = path.with_name(path.name + ".part")
        self._frames = 0
        path.parent.mkdir(parents=True, exist_ok=True)
        self._stream = rerun.RecordingStream("coin3d", recording_id=path.stem)
        self._stream.save(self._partial)
        self._stream.log("ego", rerun.ViewCoordinates.FLU, static=True)

    def __enter__(self) -> RerunFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stream.flush()
        self._stream.disconnect()
        if kind is None:
            self._partial.replace(self.path)
        else:
            self._partial.unlink(missing_ok=True)

    def log(
        self,
        rig: Rig,
        images: Mapping[str, UInt8[np.ndarray, "h w 3"]],
        gaussians: Gaussians | None = None,
        predictions: Boxes3D | None = None,
        truth: Boxes3D | None = None,
    ) -> None:
        """Append a frame.

        Args:
            rig: pinhole cameras.
            images: by camera, of the camera's size.
            gaussians: the frame's cloud, if it has one.
            predictions: boxes in the ego frame, green.
            truth: boxes in the ego frame, red.
        """
        rr, stream = self._rr, self._stream
        stream.set_time(_TIMELINE, sequence=self._frames)
        self._frames += 1
        for name, image in images.items():
            camera, where = rig[name], f"ego/{name}"
            pose = camera.ego_from_cam
            stream.log(where, rr.Transform3D(translation=pose.translation, mat3x3=pose.rotation))
            pinhole = rr.Pinhole(
                image_from_camera=camera.K, resolution=(camera.width_px, camera.height_px), camera_xyz=rr.ViewCoordinates.RDF
            )
            stream.log(where, pinhole)
            stream.log(where, rr.Image(image).compress(jpeg_quality=90))
        # a frame without a cloud gets an empty one: the viewer would go on showing that of the frame before
        cloud = Gaussians.empty() if gaussians is None else gaussians
        radii = np.maximum(cloud.std_m, _MIN_RADIUS_M)
        stream.log("ego/cloud", rr.Points3D(cloud.centre_m, colors=cloud.rgb, radii=radii))
        for name, boxes, colour in (("predictions", predictions, PREDICTION), ("truth", truth, TRUTH)):
            if boxes is not None:
                stream.log(f"ego/{name}", self._boxes(boxes, colour))

    def _boxes(self, boxes: Boxes3D, colour: RGB) -> Any:
        half = boxes.yaw_rad / 2
        nothing = np.zeros_like(half)
        return self._rr.Boxes3D(
            centers=boxes.centre_m,
            half_sizes=boxes.size_m / 2,
            quaternions=np.stack([nothing, nothing, np.sin(half), np.cos(half)], axis=1),  # x, y, z, w
            labels=[str(label) for label in boxes.labels],
            show_labels=False,
            colors=[colour] * len(boxes),
        )
