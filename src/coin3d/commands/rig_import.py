"""``coin3d rig import``: a rig file from the calibration of another tool."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

if TYPE_CHECKING:
    from coin3d.geometry import Camera


def rig_import(
    source: Annotated[Positional[Path], arg(metavar="SOURCE")],
    out: Path,
    base_pose: tuple[float, float, float, float, float, float] | None = None,
    base_matrix: Path | None = None,
    base: str | None = None,
    scale: float | None = None,
    camera_axes: Literal["auto", "optical", "x-forward"] = "auto",
    rectified: bool = False,
    format: Literal["auto", "kalibr", "ros", "colmap"] = "auto",
) -> None:
    """Write a rig file from a calibration by Kalibr, ROS (CameraInfo and tf, as YAML) or COLMAP (text model).

    Look at the result before trusting it: coin3d check draws it into your images.

    Try:
      coin3d rig import camchain.yaml --base-pose 1.7 0 1.4 0 0 0 --out recordings/van/rig.yaml
      coin3d rig import camchain-imucam.yaml --base imu --base-pose 1.0 0 0.6 0 0 0 --out recordings/van/rig.yaml
      coin3d rig import ros_dumps --base-pose 0 0 0.35 0 0 0 --out recordings/van/rig.yaml
      coin3d rig import colmap/text --base front --base-pose 1.7 0 1.4 0 2 0 --scale 0.83 --out recordings/van/rig.yaml

    Args:
        source: Kalibr's camchain YAML; a folder (or one file) of ROS dumps; or the folder of a COLMAP text model.
        out: the rig file; a file that is there already is kept.
        base_pose: where the base is: X Y Z in metres (forward, left, up from the ground under the rear axle), yaw, pitch and
            roll in degrees. Of a camera, 0 0 0 looks forward, as in rig.yaml; of another frame, 0 0 0 has x forward, z up.
        base_matrix: a YAML file with the 4 x 4 matrix from base to vehicle coordinates instead.
        base: the frame that base-pose is about. Kalibr: a camera (default: cam0) or imu. ROS: a frame (default: base_link, on
            the ground unless base-pose says otherwise). COLMAP: a camera (default: the first by name).
        scale: metres per unit of a COLMAP model.
        camera_axes: what the frames of ROS cameras mean: z forward (optical) or x forward; auto complains where the first makes
            no sense.
        rectified: ROS: the images are rectified ones.
        format: of the source, if it is not recognised.
    """
    from coin3d.geometry import save_rig
    from coin3d.rig_import import Base, import_rig
    from coin3d.rig_import.fields import pose_matrix, read_documents

    if out.exists():
        raise ValueError(f"{out} exists already: remove it, or choose another name")
    matrix = None
    if base_matrix is not None:
        if not base_matrix.is_file():
            raise FileNotFoundError(f"{base_matrix}: no such file")
        documents = read_documents(base_matrix)
        matrix = pose_matrix(documents[0] if documents else None, str(base_matrix)).matrix
    known = Base(base, base_pose, matrix)
    rig, remarks = import_rig(source, known, format=format, scale=scale, camera_axes=camera_axes, rectified=rectified)
    save_rig(rig, out)
    print("\n".join([*(_line(name, camera) for name, camera in rig.items()), *remarks, f"rig:     {out}"]))


def _line(name: str, camera: Camera) -> str:
    import math

    from coin3d.geometry import Pinhole

    x, y, z = camera.ego_from_cam.translation.tolist()
    pitch_deg = math.degrees(-math.asin(max(-1.0, min(1.0, float(camera.ego_from_cam.rotation[2, 2])))))
    lens = "" if isinstance(camera.lens, Pinhole) else f", {type(camera.lens).__name__} lens"
    return (
        f"{name}: {camera.width_px} x {camera.height_px}, f {camera.focal_px:.0f} px{lens}, at {x:+.2f} {y:+.2f} {z:+.2f} m, "
        f"yaw {round(math.degrees(camera.yaw_rad)):+d} pitch {round(pitch_deg):+d} deg"
    )
