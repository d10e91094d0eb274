"""Frames per second that one process reads, images and LiDAR included, against nuscenes-devkit and PIL.

    python benchmarks/reading_speed.py data/nuscenes data/waymo --out results/benchmarks/reading.json

takes recordings of any format. Of each, frames are read in order until ``--seconds`` are over, five times: annotations, all
images, the sweep. ``whole``: images as recorded; ``input``: images as network input (704 pixels wide), which is what training
and detection ask for. For recordings in nuScenes format the plain way is measured in the same run, turn about: nuscenes-devkit
gives paths, boxes with velocities and points, PIL decodes (and resizes). It runs in the Python that COIN3D_DEVKIT_PYTHON names,
in which nuscenes-devkit with its requirements is installed. One thread each; opening a recording is not counted; files come
from the page cache: what is measured is the work, not the disk.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

BUSY_LOAD = 0.5
ROUNDS = 5
WIDTH_PX, HEIGHT_PX = 704, 256
SIZES = ("whole", "input")


def ours(path: Path, size: str, seconds: float) -> dict[str, Any]:
    """Frames per second of this project's reader."""
    import cv2
    import numpy as np

    from coin3d.augmentation import RecordedImage, View
    from coin3d.datasets.open import open_recording
    from coin3d.geometry import fit_width

    cv2.setNumThreads(1)
    recording = open_recording(path)

    def read(i: int) -> int:
        frame = recording[i % len(recording)]
        boxes = frame.boxes
        for name, camera in frame.rig.items():
            if size == "whole":
                frame.image(name)
            else:
                View(RecordedImage(frame, name), camera, fit_width(camera, WIDTH_PX, HEIGHT_PX)).network_image()
        points = np.zeros((0, 3)) if frame.lidar is None else frame.lidar.load().points_ego
        return (0 if boxes is None else len(boxes)) + len(points)

    first = recording[0]
    return {
        "frames_per_second": rate(read, seconds),
        "cameras": len(first.rig),
        "image_px": [max(c.width_px for c in first.rig.values()), max(c.height_px for c in first.rig.values())],
        "boxes": 0 if first.boxes is None else len(first.boxes),
        "points": 0 if first.lidar is None else len(first.lidar.load().points_ego),
    }


def plain(path: Path, size: str, seconds: float) -> dict[str, Any]:
    """Frames per second of nuscenes-devkit and PIL, in whichever Python this runs."""
    import numpy as np
    from nuscenes.nuscenes import NuScenes
    from nuscenes.utils.data_classes import LidarPointCloud
    from PIL import Image

    version = next(p.parent.name for p in sorted(path.glob("*/sample.json")))
    devkit = NuScenes(version=version, dataroot=str(path), verbose=False)

    def read(i: int) -> int:
        sample = devkit.sample[i % len(devkit.sample)]
        for token in sample["data"].values():
            row = devkit.get("sample_data", token)
            if row["sensor_modality"] == "camera":
                devkit.get("calibrated_sensor", row["calibrated_sensor_token"])
                devkit.get("ego_pose", row["ego_pose_token"])
                image = Image.open(devkit.get_sample_data_path(token))
                if size == "input":
                    image = image.resize((WIDTH_PX, round(image.height * WIDTH_PX / image.width)))
                    image = image.crop((0, image.height - HEIGHT_PX, WIDTH_PX, image.height))
                np.asarray(image)
        lidar = sample["data"]["LIDAR_TOP"]
        boxes = devkit.get_boxes(lidar)
        for token in sample["anns"]:
            devkit.box_velocity(token)
        points = LidarPointCloud.from_file(devkit.get_sample_data_path(lidar))
        row = devkit.get("sample_data", lidar)
        calibration = devkit.get("calibrated_sensor", row["calibrated_sensor_token"])
        points.transform(transform_of(calibration["rotation"], calibration["translation"]))
        return len(boxes) + points.nbr_points()

    return {"frames_per_second": rate(read, seconds)}


def transform_of(rotation: list[float], translation: list[float]) -> Any:
    from nuscenes.utils.geometry_utils import transform_matrix
    from pyquaternion import Quaternion

    return transform_matrix(translation, Quaternion(rotation))


def rate(read: Any, seconds: float) -> float:
    """Reads per second, after one that is not counted."""
    read(0)
    began, count = time.perf_counter(), 0
    while time.perf_counter() - began < seconds:
        read(count)
        count += 1
    return count / (time.perf_counter() - began)


def in_a_process(python: str, way: str, path: Path, size: str, seconds: float) -> dict[str, Any]:
    command = [python, __file__, "--one", way, str(path), size, "--seconds", str(seconds)]
    one_thread = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=one_thread, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stderr}")
    return dict(json.loads(done.stdout.splitlines()[-1]))


def measure(path: Path, devkit_python: str | None, seconds: float) -> dict[str, Any]:
    """One recording: rates at both sizes, and those of the plain way where it knows the format."""
    is_nuscenes = any(path.glob("*/sample.json"))
    row: dict[str, Any] = {"recording": path.name}
    for size in SIZES:
        own, peer = [], []
        for _ in range(ROUNDS):
            found = in_a_process(sys.executable, "ours", path, size, seconds)
            own.append(found.pop("frames_per_second"))
            row |= found
            if is_nuscenes and devkit_python:
                peer.append(in_a_process(devkit_python, "plain", path, size, seconds)["frames_per_second"])
        row[size] = round(statistics.median(own), 2)
        if peer:
            row[f"{size}_plain"] = round(statistics.median(peer), 2)
            row[f"{size}_ratio"] = round(statistics.median(a / b for a, b in zip(own, peer, strict=True)), 2)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="*")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each of five rounds")
    parser.add_argument("--out", type=Path, help="write the figures to this JSON file")
    parser.add_argument("--one", nargs=3, metavar=("WAY", "RECORDING", "SIZE"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        way, path, size = options.one
        print(json.dumps((ours if way == "ours" else plain)(Path(path), size, options.seconds)))
        return
    if not options.recordings:
        parser.error("name at least one recording")
    load = os.getloadavg()[0]
    if load > BUSY_LOAD:
        print(f"WARNING: the machine is busy (load average {load:.2f}): rates below are too low")
    devkit_python, rows = os.environ.get("COIN3D_DEVKIT_PYTHON"), []
    print("recording                    cameras  images       frames/s: whole   plain  ratio   input   plain  ratio")
    for path in options.recordings:
        row = measure(path, devkit_python, options.seconds)
        rows.append(row)
        cells = [f"{row.get(key, float('nan')):7.2f}" for size in SIZES for key in (size, f"{size}_plain", f"{size}_ratio")]
        width, height = row["image_px"]
        print(f"{row['recording'][:28]:28} {row['cameras']:7}  {width:5} x {height:<5}    {' '.join(cells)}", flush=True)
    if options.out:
        from coin3d.records import write_json

        write_json(options.out, {"load_before": round(load, 2), "seconds": options.seconds, "rows": rows})


if __name__ == "__main__":
    main()
