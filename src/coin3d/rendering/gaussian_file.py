"""Gaussians on disk: one safetensors file of about 10 bytes per Gaussian.

Rows are coded in chunks of 256. A centre is a multiple of the chunk's step from the chunk's corner, in 16 bits per axis; a
standard deviation is a point on a logarithmic scale between the chunk's smallest and largest, in 8 bits. Chunks that are too
large for 16 bits (around silhouettes, where near and far pixels meet) keep float32 centres. Errors are bounded by
``centre_tolerance_m`` and by ``STD_TOLERANCE``; colours are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8, UInt16
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from coin3d.records import write_bytes
from coin3d.rendering.gaussians import Gaussians

FORMAT = "gaussians-1"
CHUNK = 256
FLOOR_M = 2.5e-4
ANGLE_RAD = 5e-5
STD_TOLERANCE = 0.02
"""Largest relative error of a standard deviation; reached only if they differ 20,000-fold within a chunk."""


def centre_tolerance_m(nearest_m: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Largest error per axis of a centre in a chunk whose nearest centre is that far from the ego origin.

    A quarter of a millimetre, or what is seen under 0.05 mrad (0.05 pixel at a focal length of 1000).
    """
    return np.asarray(np.maximum(FLOOR_M, ANGLE_RAD * nearest_m))


def save_gaussians(path: Path, gaussians: Gaussians) -> None:
    """Write the file atomically."""
    n = len(gaussians)
    centre = _chunked(gaussians.centre_m)
    coded, exact = _code_centres(centre)
    std = _code_std(_chunked(gaussians.std_m))
    tensors = {
        "corner_m": coded.corner_m, "step_m": coded.step_m, "centre": coded.centre[~exact].reshape(-1, 3),
        "exact": exact.astype(np.uint8), "exact_centre_m": centre[exact].reshape(-1, 3),
        "std_range_m": std.range_m, "std": std.code.reshape(-1)[:n], "rgb": gaussians.rgb,
    }  # fmt: skip
    tensors = {name: np.ascontiguousarray(tensor) for name, tensor in tensors.items()}
    write_bytes(Path(path), save(tensors, metadata={"coin3d": FORMAT}))


def load_gaussians(path: Path) -> Gaussians:
    """Read what ``save_gaussians`` wrote.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a file that is truncated, damaged, or something else.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file of Gaussians")
    try:
        with safe_open(path, framework="numpy") as file:
            made_by = (file.metadata() or {}).get("coin3d")
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise ValueError(f"{path}: not a complete safetensors file ({error}); build the scene again") from error
    if made_by != FORMAT:
        raise ValueError(f"{path}: a safetensors file, but not Gaussians of this version (found {made_by!r}, not '{FORMAT}')")
    try:
        return _decode(tensors)
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise ValueError(f"{path}: the Gaussians in it are damaged ({error}); build the scene again") from error


@dataclass(frozen=True)
class _Centres:
    corner_m: Float32[np.ndarray, "c 3"]
    step_m: Float32[np.ndarray, "c"]
    centre: UInt16[np.ndarray, "c 256 3"]


@dataclass(frozen=True)
class _Std:
    range_m: Float32[np.ndarray, "c 2"]
    code: UInt8[np.ndarray, "c 256"]


def _chunked(values: np.ndarray) -> np.ndarray:
    """(n, ...) rows as (chunks, 256, ...); the last chunk is filled up with its last row."""
    missing = -len(values) % CHUNK
    if missing:
        values = np.concatenate([values, np.repeat(values[-1:], missing, axis=0)])
    return values.reshape(-1, CHUNK, *values.shape[1:])


def _code_centres(centre: Float32[np.ndarray, "c 256 3"]) -> tuple[_Centres, Bool[np.ndarray, "c"]]:
    """The coded centres, and which chunks are too large for them."""
    corner = centre.min(axis=1) if len(centre) else np.zeros((0, 3), np.float32)
    offset = centre - corner[:, None]
    extent = offset.max(axis=(1, 2), initial=0)
    nearest = np.sqrt(np.square(centre).sum(-1).min(axis=1, initial=np.inf))
    step = np.maximum(extent / 65535, np.float32(1e-30))
    # the margin covers the float32 rounding of corner + step * code
    exact = step / 2 > 0.99 * centre_tolerance_m(nearest)
    code = np.rint(np.minimum(offset / step[:, None, None], 65535)).astype(np.uint16)
    return _Centres(corner, step, code), exact


def _code_std(std: Float32[np.ndarray, "c 256"]) -> _Std:
    low, high = std.min(axis=1, initial=np.inf), std.max(axis=1, initial=0)
    width = np.log(np.where(high > low, high / low, 2))[:, None]
    code = np.rint(np.log(std / low[:, None]) / width * 255).astype(np.uint8)
    return _Std(np.stack([low, high], axis=1).astype(np.float32), code)


def _decode(tensors: dict[str, np.ndarray]) -> Gaussians:
    rgb, std_code, exact = tensors["rgb"], tensors["std"], tensors["exact"].astype(bool)
    n, chunks, whole = len(rgb), len(exact), int(exact.sum())
    shapes = {
        "rgb": (n, 3), "std": (n,), "exact": (chunks,), "corner_m": (chunks, 3), "step_m": (chunks,),
        "std_range_m": (chunks, 2), "centre": ((chunks - whole) * CHUNK, 3), "exact_centre_m": (whole * CHUNK, 3),
    }  # fmt: skip
    if wrong := [name for name, shape in shapes.items() if tensors[name].shape != shape]:
        raise ValueError(f"'{wrong[0]}' has the shape {tensors[wrong[0]].shape}, expected {shapes[wrong[0]]}")
    if -(-n // CHUNK) != chunks:
        raise ValueError(f"{n} colours, {len(std_code)} standard deviations and {chunks} chunks do not belong together")
    corner, step = tensors["corner_m"], tensors["step_m"]
    centre = np.empty((chunks, CHUNK, 3), np.float32)
    centre[exact] = tensors["exact_centre_m"].reshape(-1, CHUNK, 3)
    coded = tensors["centre"].reshape(-1, CHUNK, 3).astype(np.float32)
    centre[~exact] = coded * step[~exact, None, None] + corner[~exact, None]
    low, high = tensors["std_range_m"].T
    ratio = (high / low)[:, None] ** (np.arange(256, dtype=np.float32) / 255)
    table = low[:, None] * ratio
    std = np.take_along_axis(table, _chunked(std_code).astype(np.intp), axis=1) if n else np.zeros(0)
    return Gaussians(centre.reshape(-1, 3)[:n], std.reshape(-1)[:n].astype(np.float32), rgb)
