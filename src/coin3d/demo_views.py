"""The demo's novel views: one world rebuilt as Gaussians from one rig, rendered through others, with detections on top."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from coin3d.datasets.frame import Frame
from coin3d.datasets.open import open_recording
from coin3d.drawing.sheet import Panel, save_png, sheet
from coin3d.geometry import Boxes3D
from coin3d.rendering import prepare
from coin3d.rendering.gaussian_folder import GaussianFolder
from coin3d.rendering.settings import paper_settings, render_rig, settings_sheet
from coin3d.report.demo_page import NovelViewPictures
from coin3d.report.overview import overview
from coin3d.report.pictures import as_seen
from coin3d.scenes.build import build_scenes
from coin3d.scenes.options import BuildOptions

_CELL_PX = 400


def novel_view_pictures(
    source: Path,
    target: Sequence[Frame],
    found: Mapping[str, Mapping[str, Boxes3D]],
    truth: Callable[[Frame], Boxes3D],
    out: Path,
    *,
    width_px: int,
    workers: int,
    progress: Callable[[str], None],
) -> NovelViewPictures:
    """Build the Gaussians of the first scene of a recording and look at them in three ways.

    Args:
        source: recording with LiDAR sweeps, through the source rig.
        target: frames of the same world at the same times, through the target rig.
        found: name of a detector -> frame token of the target -> boxes worth drawing, in the ego frame.
        truth: boxes of a target frame as scored, in the ego frame.
        out: folder; ``gaussians`` and ``pictures`` appear in it.
        width_px: of the images the Gaussians are built from.
        workers: processes.
        progress: called with a line now and then.
    """
    recording = open_recording(source)
    build_scenes(recording, out / "gaussians", BuildOptions(width_px=width_px), workers=workers, progress=progress)
    scene = [frame for frame in recording if frame.scene == recording[0].scene]
    same = [frame for frame in target if frame.scene == scene[0].scene]
    place = min(len(scene), len(same)) // 2
    before, after = scene[place], same[place]
    gaussians = GaussianFolder(out / "gaussians").load(before.scene, before.token)
    if gaussians is None:
        raise FileNotFoundError(f"{out / 'gaussians'}: no Gaussians of frame {before.token}; delete the folder to build again")
    cloud = prepare(gaussians)

    settings = {setting: render_rig(cloud, rig) for setting, rig in paper_settings(before.rig).items()}
    rendered = render_rig(cloud, after.rig).renderings
    names = as_seen(after.rig)
    panels = [Panel(after.image(name), f"{name}: recorded") for name in names]
    panels += [Panel(rendered[name].rgb, f"{name}: rendered from the {before.rig.name} rig's images") for name in names]
    boxes = {name: found[name][after.token] for name in found}
    title = f"boxes found through the {after.rig.name} rig, {after.scene}"
    pictures = out / "pictures"
    return NovelViewPictures(
        save_png(settings_sheet(settings, f"{before.scene} through the {before.rig.name} rig"), pictures / "novel_views.png"),
        save_png(
            sheet(panels, len(names), _CELL_PX, f"{after.scene} through the {after.rig.name} rig"), pictures / "compared.png"
        ),
        save_png(overview(gaussians, boxes, truth(after), title=title), pictures / "overview.png"),
    )
