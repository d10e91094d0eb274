"""Target-aware ranges of the released code: they bracket a known rig, so results made with them use target knowledge.

Both sets surround the rig of nuScenes; the released Lyft -> nuScenes and Waymo -> nuScenes numbers were made with them
(spec official_code 3.3). The paper does not mention them.
"""

from __future__ import annotations

from dataclasses import dataclass

from coin3d.geometry import Camera

Range = tuple[float, float]
Mixture = tuple[tuple[float, float, float], ...]

REFERENCE_WIDTH_PX = 704
"""Width of the images that focal lengths and rows below count in."""


@dataclass(frozen=True)
class MountRanges:
    """Where one camera of a known source rig is drawn anew. ``None`` leaves a quantity as it is.

    Args:
        camera: its name in the source rig.
        focal_px: (weight, low, high) triples, one of which is chosen by weight; pixels of an image 704 wide.
        x_m: absolute, ego frame.
        y_m: absolute, ego frame.
        yaw_deg: absolute, ego frame.
        centre_v_px: row of the principal point; pixels of an image 704 wide.
    """

    camera: str
    focal_px: Mixture
    x_m: Range | None = None
    y_m: Range | None = None
    yaw_deg: Range | None = None
    centre_v_px: Range | None = None

    def __post_init__(self) -> None:
        if not self.focal_px or any(weight <= 0 or not 0 < low <= high for weight, low, high in self.focal_px):
            raise ValueError(f"ranges of {self.camera}: focal_px holds (weight > 0, 0 < low <= high), got {self.focal_px}")

    def scale(self, camera: Camera) -> float:
        """Pixels of the camera per pixel of an image 704 wide."""
        return camera.width_px / REFERENCE_WIDTH_PX


def lyft_mounts() -> tuple[MountRanges, ...]:
    """Lyft's six cameras, moved towards those of nuScenes."""
    usual, back = ((1.0, 450.0, 560.0),), ((1.0, 350.0, 560.0),)
    return (
        MountRanges("CAM_FRONT", usual, x_m=(1.5, 1.7)),
        MountRanges("CAM_FRONT_LEFT", usual, (1.25, 1.55), (0.3, 0.5), (45.0, 65.0)),
        MountRanges("CAM_FRONT_RIGHT", usual, (1.25, 1.55), (-0.5, -0.3), (-65.0, -45.0)),
        MountRanges("CAM_BACK", back, x_m=(0.0, 0.25)),
        MountRanges("CAM_BACK_LEFT", usual, y_m=(0.3, 0.5), yaw_deg=(100.0, 120.0)),
        MountRanges("CAM_BACK_RIGHT", usual, y_m=(-0.5, -0.3), yaw_deg=(-120.0, -100.0)),
    )


def waymo_mounts() -> tuple[MountRanges, ...]:
    """Waymo's five cameras, moved towards those of nuScenes.

    The released code draws x of SIDE_RIGHT from -0.6..-0.5 where SIDE_LEFT has 0.5..0.6, a slip of the sign that puts the
    right camera behind the rear axle. Corrected here: both are 0.5..0.6.
    """
    front, side = ((1.0, 350.0, 550.0), (5.0, 500.0, 700.0)), ((1.0, 500.0, 700.0),)
    low_row = (85.0, 95.0)
    return (
        MountRanges("FRONT", front, x_m=(1.5, 1.7)),
        MountRanges("FRONT_LEFT", front, (1.0, 1.55), (0.1, 0.5), (45.0, 65.0)),
        MountRanges("FRONT_RIGHT", front, (1.0, 1.55), (-0.5, -0.1), (-65.0, -45.0)),
        MountRanges("SIDE_LEFT", side, (0.5, 0.6), (0.1, 0.5), (60.0, 80.0), low_row),
        MountRanges("SIDE_RIGHT", side, (0.5, 0.6), (-0.5, -0.1), (-80.0, -60.0), low_row),
    )
