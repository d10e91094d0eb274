"""What the released query detectors assume and detectors trained here do not: in one record, for converted weights only."""

from __future__ import annotations

from dataclasses import dataclass, field

from coin3d.detectors.camera_seats import NUSCENES_HEADINGS_DEG
from coin3d.detectors.released_lidar import ReleasedLidar


@dataclass(frozen=True)
class ReleasedQueryConventions:
    """The released conventions that no rearrangement of weights can undo (those are undone when weights are converted).

    Args:
        lidar: the frame of its boxes.
        point_in_cell_px: the pixel whose ray stands for a feature cell, from the cell's upper left corner. The released code
            takes corners in pixels whose first centre is 0; after its resize by 0.5 that is 0.25 here.
        camera_sine: add an embedding of which camera of the rig it is, which ties the weights to nuScenes' rig.
        camera_headings_deg: where the cameras of that rig look, in their order (see ``camera_seats``).
    """

    lidar: ReleasedLidar = field(default_factory=ReleasedLidar)
    point_in_cell_px: float = 0.25
    camera_sine: bool = True
    camera_headings_deg: tuple[float, ...] = NUSCENES_HEADINGS_DEG
