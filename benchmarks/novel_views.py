"""How true are rendered views? The town's scenes, built from one rig, against what other rigs really saw there.

    python benchmarks/novel_views.py --work out/novel_views

records a few worlds through a nuScenes-like rig (the builder sees its images, sweeps, boxes and poses, nothing else) and the
same worlds through other rigs with true depth, builds the Gaussians, renders every key frame through every rig, and compares.
Writes results/novel_views.json and a sheet of pairs of pictures per setting. Steps whose products exist are skipped.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np

from coin3d.datasets.frame import Frame
from coin3d.datasets.open import open_recording
from coin3d.drawing.sheet import Panel, save_png, sheet
from coin3d.geometry import Rig, preset_rig
from coin3d.geometry.rig_changes import full_overlap, raised
from coin3d.records import write_json
from coin3d.rendering import prepare
from coin3d.rendering.gaussian_folder import GaussianFolder
from coin3d.rendering.settings import RenderedRig, render_rig
from coin3d.scenes.build import build_scenes
from coin3d.scenes.options import BuildOptions
from coin3d.scenes.seen_view import FROM_COMPLETION, FROM_MESH
from coin3d.scenes.work_files import SceneFiles, read_views
from coin3d.town import record
from coin3d.training.run_dir import environment

ROOT = Path(__file__).resolve().parents[1]
WIDTH_PX = 400
SEEDS = range(2000, 2004)
KEY_FRAMES = 8
SKY_M = 150.0


def target_rigs() -> dict[str, Rig]:
    """Setting -> rig; the first is the one the scenes are built from."""
    source = preset_rig("nuscenes", WIDTH_PX)
    return {
        "raw": source,
        "full overlap": full_overlap(source),
        "height +1 m": raised(source, 1.0),
        "height -1 m": raised(source, -1.0),
        "waymo-like": preset_rig("waymo", WIDTH_PX),
    }


def recording(work: Path, setting: str, rig: Rig) -> Path:
    out = work / f"true_{setting.replace(' ', '_')}"
    record(rig, out, list(SEEDS), key_frames=KEY_FRAMES, sweeps=setting == "raw", true_depth=True, workers=2)
    return out


def true_depth(out: Path, frame: Frame, name: str) -> np.ndarray:
    """Metres, infinite in the sky."""
    path = out / "truth" / "depth" / name / f"{Path(str(frame.images[name])).stem}.png"
    centimetres = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if centimetres is None:
        raise FileNotFoundError(path)
    return np.where(centimetres > 0, centimetres * 0.01, np.inf)


def ssim(a: np.ndarray, b: np.ndarray) -> float:
    """Structural similarity of two grey images (Wang et al. 2004: Gaussian window of 11 pixels, sigma 1.5)."""
    a, b = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float64) for image in (a, b))

    def mean(x: np.ndarray) -> np.ndarray:
        return np.asarray(cv2.GaussianBlur(x, (11, 11), 1.5))

    ma, mb = mean(a), mean(b)
    va, vb, cab = mean(a * a) - ma * ma, mean(b * b) - mb * mb, mean(a * b) - ma * mb
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    return float((((2 * ma * mb + c1) * (2 * cab + c2)) / ((ma**2 + mb**2 + c1) * (va + vb + c2))).mean())


def score_image(
    rgb: np.ndarray, true_rgb: np.ndarray, alpha: np.ndarray, depth_m: np.ndarray, true_m: np.ndarray
) -> dict[str, float]:
    """One image: PSNR over all and over covered pixels, SSIM, relative depth error where both have a depth."""
    square = ((rgb.astype(np.float64) - true_rgb) ** 2).mean(-1)
    covered = alpha > 0.5
    known = covered & (true_m < SKY_M)
    error = np.abs(depth_m[known] / alpha[known] - true_m[known]) / true_m[known]
    return {
        "psnr_db": 10 * float(np.log10(255**2 / max(square.mean(), 1e-3))),
        "psnr_covered_db": 10 * float(np.log10(255**2 / max(square[covered].mean() if covered.any() else 255**2, 1e-3))),
        "ssim": ssim(rgb, true_rgb),
        "depth_error": float(np.median(error)) if known.any() else 0.0,
    }


def score_setting(out: Path, gaussians: GaussianFolder, pictures: Path, setting: str) -> dict[str, float]:
    """Medians over images, and the mean share of empty pixels below the horizon."""
    images: list[dict[str, float]] = []
    empty: list[float] = []
    panels: list[Panel] = []
    frames = list(open_recording(out))
    source = {(f.scene, i): f for f, i in _numbered(frames)}
    tokens = _tokens(gaussians.root)
    for (scene, number), frame in source.items():
        scene_gaussians = gaussians.load(scene, tokens[scene][number])
        if scene_gaussians is None:
            continue
        view: RenderedRig = render_rig(prepare(scene_gaussians), frame.rig, threads=2)
        empty.append(view.empty_below_horizon)
        for name, image in view.renderings.items():
            true_rgb = frame.image(name)
            images.append(score_image(image.rgb, true_rgb, image.alpha, image.depth_m, true_depth(out, frame, name)))
            if number == KEY_FRAMES // 2 and len(panels) < 24:
                panels += [
                    Panel(true_rgb, f"{scene} {name}: true"),
                    Panel(image.rgb, f"rendered, {images[-1]['psnr_db']:.1f} dB"),
                ]
    save_png(sheet(panels, 4, WIDTH_PX, setting), pictures / f"{setting.replace(' ', '_')}.png")
    row = {key: round(median(image[key] for image in images), 4) for key in images[0]}
    return {**row, "empty_below_horizon": round(sum(empty) / len(empty), 4), "images": len(images)}


def score_depth(out: Path, built: Path) -> dict[str, float]:
    """Depth of the meshes, and of what was completed, against the truth at the source cameras."""
    mesh: list[np.ndarray] = []
    holes: list[np.ndarray] = []
    for frame in open_recording(out):
        files = SceneFiles(built / frame.scene)
        for view in read_views(files.depth(frame.token), frame, WIDTH_PX):
            true_m = true_depth(out, frame, view.name)
            near = true_m < SKY_M
            error = np.abs(view.depth_m - np.where(near, true_m, 0))
            mesh.append(error[near & (view.source == FROM_MESH)])
            holes.append((error / np.where(near, true_m, 1))[near & (view.source == FROM_COMPLETION)])
    in_mesh, in_holes = np.concatenate(mesh), np.concatenate(holes)
    return {
        "mesh_error_median_m": round(float(np.median(in_mesh)), 4),
        "mesh_error_p90_m": round(float(np.quantile(in_mesh, 0.9)), 4),
        "hole_error_median_relative": round(float(np.median(in_holes)), 4),
        "hole_error_p90_relative": round(float(np.quantile(in_holes, 0.9)), 4),
    }


def _numbered(frames: Sequence[Frame]) -> list[tuple[Frame, int]]:
    seen: dict[str, int] = {}
    numbered = []
    for frame in frames:
        number = seen.get(frame.scene, 0)
        seen[frame.scene] = number + 1
        numbered.append((frame, number))
    return numbered


def _tokens(built: Path) -> dict[str, list[str]]:
    """Frame tokens of each scene in time order, as the builder wrote them."""
    scenes = json.loads((built / "scenes.json").read_text())["scenes"]
    return {scene["name"]: [frame["token"] for frame in scene["frames"]] for scene in scenes}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, default=Path("out/novel_views"))
    parser.add_argument("--settings", nargs="+", choices=[*target_rigs()], default=[*target_rigs()])
    arguments = parser.parse_args()
    rigs = target_rigs()
    source = recording(arguments.work, "raw", rigs["raw"])
    built = arguments.work / "scenes"
    outcome = build_scenes(open_recording(source), built, BuildOptions(keep_depth=True), workers=2)
    table: dict[str, Any] = {}
    for setting in arguments.settings:
        out = recording(arguments.work, setting, rigs[setting])
        table[setting] = score_setting(out, GaussianFolder.open(built), arguments.work / "pictures", setting)
        print(setting, table[setting], flush=True)
    depth = score_depth(source, built)
    print(depth)
    facts = {"raw_only": outcome.raw_only, "scenes": len(SEEDS), "key_frames": KEY_FRAMES, "width_px": WIDTH_PX}
    write_json(ROOT / "results" / "novel_views.json", {"settings": table, "depth": depth, **facts, **environment()})


if __name__ == "__main__":
    main()
