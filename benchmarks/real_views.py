"""Gaussians of real frames: sheets to look at, and for DDAD how well one frame predicts the images of the next.

    python benchmarks/real_views.py --data ../shared/data --work out/real_views

builds the one frame of nuScenes and the three of DDAD that the tests use, from their few sweeps, renders the paper's four
settings of the middle frame of each, and renders every DDAD frame at the poses of the next one, a second later. PSNR there is
over covered pixels; whatever moved meanwhile counts as an error. Writes results/real_views.json, pictures into the work folder.
"""

from __future__ import annotations

import argparse
import os
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from coin3d.datasets.frame import Frame, Recording
from coin3d.datasets.open import open_recording
from coin3d.drawing.sheet import Panel, save_png, sheet
from coin3d.records import write_json
from coin3d.rendering import Gaussians, prepare
from coin3d.rendering.cpu import render_cpu
from coin3d.rendering.gaussian_folder import GaussianFolder
from coin3d.rendering.settings import paper_settings, render_rig, settings_sheet
from coin3d.scenes.build import build_scenes
from coin3d.scenes.options import BuildOptions
from coin3d.scenes.views import load_views
from coin3d.training.run_dir import environment

RESULT = Path(__file__).resolve().parents[1] / "results" / "real_views.json"
DATA = Path(os.environ.get("COIN3D_TEST_DATA", "../shared/data"))
RECORDINGS = ("nuscenes_one_frame", "ddad_three_frames")
WIDTH_PX = 800


def of_frame(folder: GaussianFolder, frame: Frame) -> Gaussians:
    gaussians = folder.load(frame.scene, frame.token)
    if gaussians is None:
        raise FileNotFoundError(f"{folder.root}: no Gaussians of frame {frame.token}")
    return gaussians


def next_frame(folder: GaussianFolder, frames: Recording, pictures: Path) -> dict[str, Any]:
    """Every frame at the poses of the next."""
    psnr_db, covered_share, panels = [], [], []
    for now, later in pairwise(frames):
        now_from_later = now.world_from_ego.inverse() @ later.world_from_ego
        cloud = prepare(of_frame(folder, now))
        for view in load_views(later, WIDTH_PX):
            camera = view.camera.moved(now_from_later @ view.camera.ego_from_cam)
            (image,) = render_cpu(cloud, [camera], threads=2)
            covered = image.alpha > 0.5
            square = ((image.rgb.astype(np.float64) - view.rgb) ** 2).mean(-1)
            psnr_db.append(10 * float(np.log10(255**2 / square[covered].mean())))
            covered_share.append(float(covered.mean()))
            panels.append(Panel(view.rgb, f"{later.token[:12]} {view.name}: recorded"))
            panels.append(Panel(image.rgb, f"rendered from the frame before, {psnr_db[-1]:.1f} dB"))
    save_png(sheet(panels, 4, 480, "each frame at the poses of the next"), pictures / "ddad_next_frame.png")
    return {
        "psnr_covered_db_median": round(median(psnr_db), 2),
        "psnr_covered_db": [round(value, 2) for value in psnr_db],
        "covered_share_median": round(median(covered_share), 4),
        "images": len(psnr_db),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--work", type=Path, default=Path("out/real_views"))
    arguments = parser.parse_args()
    facts: dict[str, Any] = {}
    for name in RECORDINGS:
        recording = open_recording(arguments.data / name)
        built = arguments.work / name
        outcome = build_scenes(recording, built, BuildOptions(width_px=WIDTH_PX), workers=2)
        folder = GaussianFolder.open(built)
        middle = recording[len(recording) // 2]
        views = load_views(middle, WIDTH_PX)
        rig = middle.rig.with_cameras({view.name: view.camera for view in views})
        cloud = prepare(of_frame(folder, middle))
        rendered = {setting: render_rig(cloud, one, threads=2) for setting, one in paper_settings(rig).items()}
        save_png(settings_sheet(rendered, f"{name}, frame {middle.token}"), arguments.work / f"{name}.png")
        facts[name] = {
            "frames": len(outcome.frames),
            "psnr_db": [frame.psnr_db for frame in outcome.frames],
            "empty_below_horizon": {setting: round(one.empty_below_horizon, 4) for setting, one in rendered.items()},
        }
        if len(recording) > 1:
            facts[name]["next_frame"] = next_frame(folder, recording, arguments.work)
        print(name, facts[name], flush=True)
    write_json(RESULT, {"width_px": WIDTH_PX, **facts, **environment()})


if __name__ == "__main__":
    main()
