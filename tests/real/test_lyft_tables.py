"""Lyft's variant of the tables: nested version folder, decimal timestamps, no LiDAR counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from coin3d.datasets.classes import PLAIN_CAR
from coin3d.datasets.nuscenes_format import NuScenesRecording


def test_tables_of_one_sample(lyft_tables: Path) -> None:
    recording = NuScenesRecording(lyft_tables)
    frame = recording[0]
    assert frame.timestamp_ns == 1556675185903083 * 1000
    assert "CAM_FRONT" in frame.rig and (frame.rig["CAM_FRONT"].width_px, frame.rig["CAM_FRONT"].height_px) == (1920, 1080)
    assert (frame.boxes.num_lidar_points == -1).all()
    assert np.abs(frame.boxes.centre_m).max() < 120  # world coordinates are kilometres, ego coordinates are not
    assert len(PLAIN_CAR.apply(frame.boxes)) == len(frame.boxes)
    assert frame.lidar.path.parent.name == "lidar"
