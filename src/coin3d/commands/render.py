"""``coin3d render``: a built scene through any rig."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg


def render(
    scene: Annotated[Positional[Path], arg(metavar="SCENE")],
    out: Path,
    rig: Annotated[str | None, arg(metavar="RIG", help_behavior_hint="(default: the rig of the recording)")] = None,
    width: int = 704,
    threads: int = 2,
    rerun: bool = False,
) -> None:
    """Render a built scene through a rig: as it is, with full overlap, 1 m higher and 1 m lower, on one sheet.

    What no source camera saw stays black. The pictures of every camera are written beside the sheet.

    Try:
      coin3d build-scenes data/train --out data/gaussians
      coin3d render data/gaussians/town-0000 --out out/views
      coin3d render data/gaussians/town-0000 --rig waymo --out out/views_waymo

    Args:
        scene: the folder of a scene that build-scenes wrote (its middle frame), or the file of one frame.
        out: folder for result.json and the pictures.
        rig: a preset (nuscenes, lyft1, lyft2, waymo) or a rig.yaml.
        width: images are rendered at this width, as high as the rig's images are in proportion.
        threads: of the renderer.
        rerun: also write views.rrd, the point cloud and the rendered cameras of each setting, for the Rerun viewer.
    """
    from coin3d.commands.outcome import finish
    from coin3d.drawing.sheet import save_png
    from coin3d.geometry import fit_width
    from coin3d.rendering import load_gaussians, prepare
    from coin3d.rendering.gaussian_folder import find_frame, recorded_rig
    from coin3d.rendering.settings import paper_settings, render_rig, settings_sheet
    from coin3d.report.rerun_file import RerunFile
    from coin3d.rig_report import find_rig

    path = find_frame(scene)
    source = find_rig(rig) if rig is not None else recorded_rig(path)
    cameras = {}
    for name, camera in source.items():
        height = round(camera.height_px * width / camera.width_px)
        cameras[name] = fit_width(camera, width, height).camera(camera)
    gaussians = load_gaussians(path)
    prepared = prepare(gaussians)
    views = {
        setting: render_rig(prepared, one, threads) for setting, one in paper_settings(source.with_cameras(cameras)).items()
    }
    pictures = [
        save_png(settings_sheet(views, f"{path.parent.name} / {path.stem} through rig '{source.name}'"), out / "sheet.png")
    ]
    for setting, view in views.items():
        folder = out / "_".join(re.findall(r"[\w+-]+", setting))
        pictures += [save_png(image.rgb, folder / f"{name}.png") for name, image in view.renderings.items()]
    if rerun:
        with RerunFile(out / "views.rrd") as viewer:
            for view in views.values():
                viewer.log(view.rig, {name: image.rgb for name, image in view.renderings.items()}, gaussians)
    empty = {setting: round(view.empty_below_horizon, 4) for setting, view in views.items()}
    for setting, share in empty.items():
        print(f"{setting:<28} {share:6.1%} of the pixels below the horizon are empty")
    finish(out, {"scene": str(path), "rig": source.name, "empty_below_horizon": empty}, pictures)
