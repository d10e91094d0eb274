"""Which boxes of a table which cameras see: ``Rig.sees`` for the samples of a whole data set at once."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from coin3d.evaluation.box_table import BoxTable
from coin3d.geometry import MIN_DEPTH_M, Camera, Lens, Rig

_ROWS_AT_ONCE = 2**17


@dataclass(frozen=True, eq=False)
class _Cameras:
    """The cameras of one name, one row per sample; samples without it have ``there`` False."""

    there: Bool[np.ndarray, "s"]
    rotation: Float[np.ndarray, "s 3 3"]
    position: Float[np.ndarray, "s 3"]
    K: Float[np.ndarray, "s 3 3"]
    size_px: Float[np.ndarray, "s 2"]
    lenses: tuple[Lens, ...]
    lens: Int[np.ndarray, "s"]

    @classmethod
    def gather(cls, cameras: list[Camera | None]) -> _Cameras:
        somewhere = next(camera for camera in cameras if camera is not None)
        filled = [camera or somewhere for camera in cameras]
        lenses: dict[Lens, int] = {}
        lens = np.array([lenses.setdefault(camera.lens, len(lenses)) for camera in filled])
        return cls(
            np.array([camera is not None for camera in cameras]),
            np.stack([camera.ego_from_cam.rotation for camera in filled]),
            np.stack([camera.ego_from_cam.translation for camera in filled]),
            np.stack([camera.K for camera in filled]),
            np.array([[camera.width_px, camera.height_px] for camera in filled], dtype=np.float64),
            tuple(lenses),
            lens,
        )

    def see(self, points_ego: Float[np.ndarray, "n 3"], sample: Int[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
        """Whether points fall into the images of their samples; the arithmetic of ``Camera.sees``."""
        from_camera = points_ego - self.position[sample]
        depth_m = np.einsum("ni,ni->n", from_camera, self.rotation[sample, :, 2])
        seen = self.there[sample] & (depth_m > MIN_DEPTH_M)
        before = np.flatnonzero(seen)
        if len(before):
            own = sample[before]
            points_cam = np.einsum("ni,nij->nj", from_camera[before], self.rotation[own])
            plane = np.empty((len(before), 2))
            for i, lens in enumerate(self.lenses):
                rows = slice(None) if len(self.lenses) == 1 else self.lens[own] == i
                with np.errstate(invalid="ignore", divide="ignore"):
                    plane[rows] = lens.plane_from_ray(points_cam[rows])
            K = self.K[own]
            pixels = np.einsum("nij,nj->ni", K[:, :2, :2], plane) + K[:, :2, 2]
            with np.errstate(invalid="ignore"):
                seen[before] = ((pixels >= 0) & (pixels < self.size_px[own])).all(1)
        return np.asarray(seen)


def seen_by_camera(table: BoxTable, rigs: Mapping[str, Rig]) -> Iterator[tuple[str, Bool[np.ndarray, "n"]]]:
    """For every camera name, which boxes (ego frame) have their centre in its image.

    Raises:
        ValueError: a sample without a rig.
    """
    for name, cameras in _by_name(table, rigs).items():
        seen = np.zeros(len(table), dtype=bool)
        for rows, sample in _chunks(table):
            seen[rows] = cameras.see(table.centre_m[rows], sample)
        yield name, seen


def seen_by_any(table: BoxTable, rigs: Mapping[str, Rig]) -> Bool[np.ndarray, "n"]:
    """Which boxes (ego frame) have their centre in at least one image; False for boxes that take no part.

    Raises:
        ValueError: a sample without a rig.
    """
    all_cameras = _by_name(table, rigs).values()
    seen = np.zeros(len(table), dtype=bool)

    def look(portion: tuple[slice, Int[np.ndarray, "k"]]) -> None:
        rows, sample = portion
        # a box that one camera saw need not be looked for by the next
        left = np.flatnonzero(table.label[rows] >= 0)
        for cameras in all_cameras:
            found = cameras.see(table.centre_m[rows][left], sample[left])
            seen[rows.start + left[found]] = True
            left = left[~found]

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(look, _chunks(table)))
    return seen


def _by_name(table: BoxTable, rigs: Mapping[str, Rig]) -> dict[str, _Cameras]:
    if missing := [token for token in table.tokens if token not in rigs]:
        raise ValueError(f"{len(missing)} samples have no rig, the first is '{missing[0]}'")
    names = dict.fromkeys(name for token in table.tokens for name in rigs[token].cameras)
    return {name: _Cameras.gather([rigs[token].cameras.get(name) for token in table.tokens]) for name in names}


def _chunks(table: BoxTable) -> Iterator[tuple[slice, Int[np.ndarray, "k"]]]:
    """Rows in portions that fit the cache, with the sample of each."""
    for first in range(0, len(table), _ROWS_AT_ONCE):
        rows = slice(first, min(first + _ROWS_AT_ONCE, len(table)))
        yield rows, np.searchsorted(table.start, np.arange(rows.start, rows.stop), side="right") - 1
