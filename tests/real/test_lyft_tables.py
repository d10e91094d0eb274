"""Lyft's variant of the tables: nested version folder, decimal timestamps, no LiDAR counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coin3d.datasets.classes import PLAIN_CAR
from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.datasets.open import open_recording


def test_tables_of_one_sample(lyft_tables: Path) -> None:
    recording = NuScenesRecording(lyft_tables)
    frame = recording[0]
    assert frame.timestamp_ns == 1556675185903083 * 1000
    assert "CAM_FRONT" in frame.rig and (frame.rig["CAM_FRONT"].width_px, frame.rig["CAM_FRONT"].height_px) == (1920, 1080)
    assert (frame.boxes.num_lidar_points == -1).all()
    assert np.abs(frame.boxes.centre_m).max() < 120  # world coordinates are kilometres, ego coordinates are not
    assert len(PLAIN_CAR.apply(frame.boxes)) == len(frame.boxes)
    assert frame.lidar.path.parent.name == "lidar"


def test_what_is_particular_about_lyft(lyft_tables: Path) -> None:
    recording = NuScenesRecording(lyft_tables)
    frame = recording[0]
    assert "CAM_FRONT_ZOOMED" not in frame.rig and len(frame.rig) == 6
    assert len(NuScenesRecording(lyft_tables, cameras=["CAM_FRONT_ZOOMED"])[0].rig) == 1
    assert frame.world_from_ego.translation[2] < -15, "the world's z = 0 is not the road"
    assert all(1.3 < camera.height_m < 1.9 for camera in frame.rig.values())
    # of the three LiDARs the one on the roof; its folder lies beside the outer table folder
    assert frame.lidar.path == lyft_tables / "lidar" / "host-a101_lidar1_1240710385903083166.bin"


def test_the_scene_belongs_to_val(lyft_tables: Path) -> None:
    assert len(open_recording(lyft_tables, "val")) == 1
    with pytest.raises(ValueError, match="is in the split train"):
        open_recording(lyft_tables, "train")
