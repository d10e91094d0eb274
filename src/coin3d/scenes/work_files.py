"""Products of the steps of a scene on disk: what a later step, or a continued build, reads back."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from coin3d.datasets.frame import Frame
from coin3d.datasets.inside import plain_name
from coin3d.geometry.mesh import TriangleMesh
from coin3d.geometry.mesh_file import load_mesh, save_mesh
from coin3d.records import write_bytes, write_json
from coin3d.scenes.meshes import SceneMeshes
from coin3d.scenes.object_points import ObjectPoints
from coin3d.scenes.seen_view import SeenView
from coin3d.scenes.views import load_views


@dataclass(frozen=True)
class SceneFiles:
    """Where everything of a scene is.

    Args:
        folder: of the scene.
    """

    folder: Path

    def gaussians(self, token: str) -> Path:
        """The Gaussians of a key frame."""
        return self.folder / f"{token}.safetensors"

    def quality(self, token: str) -> Path:
        """Figures of a key frame; written last, so it marks the frame as finished."""
        return self.folder / "quality" / f"{token}.json"

    def depth(self, token: str) -> Path:
        """Images with depth of a key frame, without the images."""
        return self.folder / "depth" / f"{token}.safetensors"

    @property
    def models(self) -> Path:
        """Textured point models of the objects."""
        return self.folder / "objects.safetensors"

    @property
    def picture(self) -> Path:
        """One key frame, step by step."""
        return self.folder / "sheet.png"

    @property
    def meshes(self) -> Path:
        """Folder of PLY files, with ``objects.json``, written last, that says which file is which instance."""
        return self.folder / "meshes"

    @property
    def mesh_index(self) -> Path:
        return self.meshes / "objects.json"

    def drop_depth(self) -> None:
        """Delete what only the build itself needs."""
        shutil.rmtree(self.folder / "depth", ignore_errors=True)


def write_meshes(files: SceneFiles, meshes: SceneMeshes) -> None:
    """Write the meshes of a scene."""
    save_mesh(files.meshes / "background.ply", meshes.background)
    index = {}
    for number, (name, entry) in enumerate(meshes.objects.items()):
        file = f"{number:04d}.ply" if entry.mesh is not None else ""
        if entry.mesh is not None:
            save_mesh(files.meshes / file, entry.mesh)
        index[name] = {"file": file, "points": entry.num_points, "watertight": entry.watertight, "reason": entry.reason}
    write_json(files.mesh_index, {"sweeps": meshes.num_sweeps, "objects": index})


def read_meshes(files: SceneFiles) -> tuple[TriangleMesh, dict[str, TriangleMesh]]:
    """Background (world frame) and objects (box frames) of a scene.

    Raises:
        FileNotFoundError: a mesh is missing.
        ValueError: a file is damaged.
    """
    where = str(files.mesh_index)
    try:
        index = json.loads(files.mesh_index.read_text())["objects"]
        names = {name: plain_name(entry["file"], f"{where}: {name}") for name, entry in index.items() if entry["file"]}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        message = str(error)
        raise ValueError(
            message if message.startswith(where) else f"{where}: damaged ({error}); build the scene again"
        ) from error
    objects = {name: load_mesh(files.meshes / file) for name, file in names.items()}
    return load_mesh(files.meshes / "background.ply"), objects


def write_views(path: Path, views: Sequence[SeenView]) -> None:
    """Write the depth of all views of a frame; the images are read from the recording again."""
    tensors = {}
    for view in views:
        tensors[f"{view.name}/depth_m"] = view.depth_m.astype(np.float32)
        tensors[f"{view.name}/behind_m"] = view.behind_m.astype(np.float32)
        tensors[f"{view.name}/source"] = view.source
        tensors[f"{view.name}/box"] = view.box.astype(np.int16)
    write_bytes(path, save({name: np.ascontiguousarray(tensor) for name, tensor in tensors.items()}))


def read_views(path: Path, frame: Frame, width_px: int) -> list[SeenView]:
    """The views of a frame as they were written, with their images; raises ValueError where the file is damaged."""
    tensors = _read(path)
    views = []
    for view in load_views(frame, width_px):
        names = [f"{view.name}/{what}" for what in ("depth_m", "source", "box", "behind_m")]
        sizes = {tensors[name].shape if name in tensors else None for name in names}
        if sizes != {view.rgb.shape[:2]}:
            raise ValueError(f"{path}: depth of '{view.name}' is missing or of another size; delete it and build again")
        depth_m, source, box, behind_m = (tensors[name] for name in names)
        views.append(SeenView(view.name, view.camera, view.rgb, depth_m, source, box.astype(np.int32), behind_m))
    return views


def write_models(path: Path, models: dict[str, ObjectPoints]) -> None:
    """Write the point models of a scene."""
    tensors = {}
    for number, model in enumerate(models.values()):
        tensors[f"{number}/points_m"] = np.ascontiguousarray(model.points_m)
        tensors[f"{number}/rgb"] = np.ascontiguousarray(model.rgb)
    names = {name: model.spacing_m for name, model in models.items()}
    write_bytes(path, save(tensors, metadata={"spacing_m": json.dumps(names)}))


def read_models(path: Path) -> dict[str, ObjectPoints]:
    """The point models of a scene; raises ValueError where the file is damaged."""
    tensors = _read(path)
    try:
        with safe_open(path, framework="numpy") as file:
            names = json.loads((file.metadata() or {})["spacing_m"])
        return {
            name: ObjectPoints(tensors[f"{number}/points_m"], tensors[f"{number}/rgb"], float(spacing))
            for number, (name, spacing) in enumerate(names.items())
        }
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{path}: the point models in it are damaged ({error}); delete it and build again") from error


def _read(path: Path) -> dict[str, np.ndarray]:
    try:
        with safe_open(path, framework="numpy") as file:
            return {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise ValueError(f"{path}: cannot be read ({error}); delete it and build again") from error
