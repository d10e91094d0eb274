"""LiDAR files of a user's own recording: bare float32 records, NumPy arrays, PCD files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from coin3d.datasets.frame import LidarScan
from coin3d.datasets.npz_file import HEADER_ERRORS
from coin3d.datasets.pcd_file import read_pcd
from coin3d.geometry import Pose

SUFFIXES = (".bin", ".npy", ".pcd")
"""What can be read; a PCD file names its own columns, the others need theirs named."""

_MOST_COLUMNS = 64


@dataclass(frozen=True, eq=False)
class PointFile:
    """A sweep on disk, read when asked for.

    Args:
        path: the file; its suffix says what it is.
        ego_from_lidar: from the frame of the points to the ego frame of the ``Frame`` that owns the sweep.
        columns: what the numbers of a point are, in order, among them x, y, z (metres) and maybe intensity; empty for PCD.

    Raises:
        ValueError: another suffix, or columns that cannot be.
    """

    path: Path
    ego_from_lidar: Pose
    columns: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        suffix = self.path.suffix.lower()
        if suffix not in SUFFIXES:
            raise ValueError(f"{self.path}: LiDAR files end in {', '.join(SUFFIXES)}")
        if suffix == ".pcd":
            if self.columns:
                raise ValueError(f"{self.path}: PCD files name their own columns; leave 'columns' out")
        elif not {"x", "y", "z"} <= set(self.columns) or not len(set(self.columns)) == len(self.columns) <= _MOST_COLUMNS:
            raise ValueError(
                f"{self.path}: 'columns' names the numbers of a point in order, among them x, y and z, each once, "
                f"for instance x, y, z, intensity; got {', '.join(self.columns) or 'nothing'}"
            )

    def load(self) -> LidarScan:
        """Read the sweep. Points that are not finite (no return) are left out; without a column intensity it is zero.

        Raises:
            ValueError: the file is missing, truncated, or not of the announced columns.
        """
        if not self.path.is_file():
            raise ValueError(f"{self.path}: the LiDAR file is missing")
        named = self._columns_by_name()
        if missing := [axis for axis in "xyz" if axis not in named]:
            raise ValueError(f"{self.path}: has no field {', '.join(missing)}, only {', '.join(named)}")
        points = np.stack([named[axis] for axis in "xyz"], axis=-1)
        finite = np.isfinite(points).all(1)
        intensity = named.get("intensity", np.zeros(len(points)))
        return LidarScan(self.ego_from_lidar.apply(points[finite]), intensity[finite], self.ego_from_lidar.translation)

    def _columns_by_name(self) -> dict[str, Float[np.ndarray, "n"]]:
        suffix = self.path.suffix.lower()
        if suffix == ".pcd":
            return read_pcd(self.path)
        rows = self._records() if suffix == ".bin" else self._array()
        return {name: rows[:, i] for i, name in enumerate(self.columns)}

    def _records(self) -> Float[np.ndarray, "n c"]:
        size, record = self.path.stat().st_size, 4 * len(self.columns)
        if size == 0 or size % record:
            raise ValueError(
                f"{self.path}: {size} bytes are not a whole number of points of {record} bytes "
                f"(float32 {', '.join(self.columns)}): the file is cut short, or 'columns' are others"
            )
        return np.fromfile(self.path, dtype="<f4").reshape(-1, len(self.columns)).astype(np.float64)

    def _array(self) -> Float[np.ndarray, "n c"]:
        try:
            # mapped, so that a header which announces more than the file holds is found out before memory is taken
            array = np.lib.format.open_memmap(self.path, mode="r")
        except HEADER_ERRORS as error:
            raise ValueError(f"{self.path}: not a complete NumPy array ({error})") from error
        if array.ndim != 2 or array.shape[1] != len(self.columns) or array.dtype.kind not in "fiu":
            raise ValueError(
                f"{self.path}: an array of numbers with shape (points, {len(self.columns)}) is expected for "
                f"{', '.join(self.columns)}, got {array.dtype} with shape {array.shape}"
            )
        return np.asarray(array, dtype=np.float64)
