"""The table of Gaussians and its file: what is refused, and how exact the coding is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.numpy import save_file

from coin3d.rendering import Gaussians, load_gaussians, save_gaussians
from coin3d.rendering.gaussian_file import CHUNK, STD_TOLERANCE, centre_tolerance_m


def random_gaussians(n: int, seed: int = 0, spread_m: float = 20) -> Gaussians:
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-spread_m, spread_m, (n, 3)).astype(np.float32)
    std = np.exp(rng.uniform(np.log(1e-3), np.log(0.1), n)).astype(np.float32)
    return Gaussians(centre, std, rng.integers(0, 256, (n, 3)).astype(np.uint8))


def test_parts_are_put_together_in_order() -> None:
    a, b = random_gaussians(3), random_gaussians(4, seed=1)
    both = Gaussians.concatenate([a, Gaussians.empty(), b])
    assert len(both) == 7 and len(Gaussians.concatenate([])) == 0
    np.testing.assert_array_equal(both.centre_m[3:], b.centre_m)
    np.testing.assert_array_equal(both[np.array([6, 0])].rgb, [b.rgb[3], a.rgb[0]])


def test_arrays_cannot_be_written_through_the_record() -> None:
    with pytest.raises(ValueError, match="read-only"):
        random_gaussians(3).centre_m[0] = 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_centres_that_are_not_finite_are_refused(bad: float) -> None:
    good = random_gaussians(5)
    centre = good.centre_m.copy()
    centre[3, 1] = bad
    with pytest.raises(ValueError, match="Gaussian 3 has the centre"):
        Gaussians(centre, good.std_m, good.rgb)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 0, -1])
def test_standard_deviations_are_positive_and_finite(bad: float) -> None:
    good = random_gaussians(5)
    std = good.std_m.copy()
    std[2] = bad
    with pytest.raises(ValueError, match="Gaussian 2 has the standard deviation"):
        Gaussians(good.centre_m, std, good.rgb)


def test_wrong_shapes_and_types_are_named() -> None:
    good = random_gaussians(5)
    with pytest.raises(ValueError, match="std_m of 5 Gaussians"):
        Gaussians(good.centre_m, good.std_m[:4], good.rgb)
    with pytest.raises(ValueError, match=r"rgb of 5 Gaussians is uint8 .* got float64"):
        Gaussians(good.centre_m, good.std_m, good.rgb / 255)
    with pytest.raises(ValueError, match="centre_m of 5 Gaussians"):
        Gaussians(good.centre_m[:, :2], good.std_m, good.rgb)


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.integers(0, 700), st.floats(1e-3, 500), st.floats(0, 300))
def test_a_file_keeps_every_gaussian_within_tolerance(
    tmp_path_factory: pytest.TempPathFactory, seed: int, n: int, spread_m: float, distance_m: float
) -> None:
    given_ = random_gaussians(n, seed, spread_m)
    given_ = Gaussians(given_.centre_m + np.float32(distance_m), given_.std_m, given_.rgb)
    path = tmp_path_factory.mktemp("scene") / "frame.safetensors"
    save_gaussians(path, given_)
    read = load_gaussians(path)
    np.testing.assert_array_equal(read.rgb, given_.rgb)
    np.testing.assert_allclose(read.std_m, given_.std_m, rtol=STD_TOLERANCE)
    for first in range(0, n, CHUNK):
        rows = slice(first, first + CHUNK)
        nearest = np.linalg.norm(given_.centre_m[rows].astype(np.float64), axis=1).min()
        error = np.abs(read.centre_m[rows].astype(np.float64) - given_.centre_m[rows]).max()
        assert error <= centre_tolerance_m(np.array(nearest))


def test_identical_points_and_equal_sizes_are_exact(tmp_path: Path) -> None:
    one = Gaussians(np.full((300, 3), 7.3, np.float32), np.full(300, 0.02, np.float32), np.zeros((300, 3), np.uint8))
    save_gaussians(tmp_path / "a.safetensors", one)
    read = load_gaussians(tmp_path / "a.safetensors")
    np.testing.assert_array_equal(read.centre_m, one.centre_m)
    np.testing.assert_array_equal(read.std_m, one.std_m)


def test_compact_chunks_take_ten_bytes_a_gaussian_and_wide_ones_stay_float32(tmp_path: Path) -> None:
    n = 100 * CHUNK
    compact = random_gaussians(n, spread_m=2)
    save_gaussians(tmp_path / "compact.safetensors", compact)
    assert (tmp_path / "compact.safetensors").stat().st_size < 10.3 * n
    wide = random_gaussians(n, spread_m=100)
    centre = wide.centre_m.copy()
    centre[::CHUNK] = 1  # near the ego origin, so that millimetres count
    wide = Gaussians(centre, wide.std_m, wide.rgb)
    save_gaussians(tmp_path / "wide.safetensors", wide)
    np.testing.assert_array_equal(load_gaussians(tmp_path / "wide.safetensors").centre_m, wide.centre_m)


def test_the_same_scene_gives_the_same_bytes_and_nothing_else_in_the_folder(tmp_path: Path) -> None:
    for _ in range(2):
        save_gaussians(tmp_path / "a.safetensors", random_gaussians(1000))
        content = (tmp_path / "a.safetensors").read_bytes()
    save_gaussians(tmp_path / "b.safetensors", random_gaussians(1000))
    assert (tmp_path / "b.safetensors").read_bytes() == content
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.safetensors", "b.safetensors"]


def test_files_that_are_missing_cut_foreign_or_damaged_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    with pytest.raises(FileNotFoundError, match=r"a\.safetensors: no such file"):
        load_gaussians(path)
    save_gaussians(path, random_gaussians(1000))
    whole = path.read_bytes()
    for size in (0, 5, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=r"a\.safetensors: not a complete safetensors file"):
            load_gaussians(path)
    save_file({"weights": np.zeros(3)}, path)
    with pytest.raises(ValueError, match=r"a\.safetensors: a safetensors file, but not Gaussians"):
        load_gaussians(path)
    save_file({"rgb": np.zeros((300, 3), np.uint8), "std": np.zeros(2)}, path, metadata={"coin3d": "gaussians-1"})
    with pytest.raises(ValueError, match=r"a\.safetensors: the Gaussians in it are damaged"):
        load_gaussians(path)


def test_numbers_that_became_invalid_in_the_file_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    save_gaussians(path, random_gaussians(10))
    content = bytearray(path.read_bytes())
    corner = random_gaussians(10).centre_m.min(0)
    at = content.find(corner.tobytes())
    assert at > 0
    content[at : at + 4] = np.float32(np.nan).tobytes()
    path.write_bytes(bytes(content))
    with pytest.raises(ValueError, match="damaged"):
        load_gaussians(path)
