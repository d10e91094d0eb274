"""Meshes of one real key frame: a single sweep, the poorest recording there is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from coin3d.datasets.nuscenes_format import NuScenesRecording
from coin3d.scenes.meshes import build_meshes


def test_one_real_sweep_gives_ground_and_closed_vehicles(one_real_frame: Path) -> None:
    recording = NuScenesRecording(one_real_frame)
    frame = recording[0]
    meshes = build_meshes([frame], recording.sweeps)
    ego = frame.world_from_ego.inverse().apply(meshes.background.vertices_m)
    near = (np.linalg.norm(ego[:, :2], axis=1) < 10) & (np.abs(ego[:, 2]) < 0.5)
    assert near.sum() > 5000
    assert np.median(np.abs(ego[near, 2])) < 0.1
    closed = [o for o in meshes.objects.values() if o.mesh is not None]
    assert len(meshes.objects) == 68 and len(closed) >= 5
    assert all(o.watertight and o.mesh is not None and o.mesh.volume_m3 > 0 for o in closed)
