"""Images at the size they are needed in: smaller ones show the same, from edge to edge."""

from __future__ import annotations

import struct
import time
import tracemalloc
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import simplejpeg
from hypothesis import given
from hypothesis import strategies as st

from coin3d.augmentation import RecordedImage, View
from coin3d.datasets.frame import Frame
from coin3d.datasets.image_source import decode_image, load_image, read_image, reduction_to
from coin3d.datasets.undistorted import undistorted
from coin3d.geometry import Camera, Rig, camera_pose, fit_width
from coin3d.geometry.lens_brown_conrady import BrownConrady

WIDTH, HEIGHT = 320, 192
K = np.array([[260.0, 0, 160], [0, 260, 96], [0, 0, 1]])
CAMERA = Camera(K, WIDTH, HEIGHT, camera_pose(np.array([0.0, 0.0, 1.5]), 0.0))


def scene() -> np.ndarray:
    """Smooth stripes and discs: what a camera sees, without the noise that no two ways to shrink agree about."""
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    image = np.stack([127 + 100 * np.sin(u / 23), 127 + 100 * np.cos(v / 17), 127 + 100 * np.sin((u + v) / 31)], axis=-1)
    image = image.astype(np.uint8)
    cv2.circle(image, (200, 100), 40, (250, 20, 20), -1, cv2.LINE_AA)
    return image


def saved(tmp_path: Path, suffix: str, image: np.ndarray | None = None) -> Path:
    path = tmp_path / f"image{suffix}"
    cv2.imwrite(str(path), (scene() if image is None else image)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 98])
    return path


def averaged(image: np.ndarray, reduction: int) -> np.ndarray:
    """Means of blocks, the definition."""
    h, w, c = image.shape
    return image.reshape(h // reduction, reduction, w // reduction, reduction, c).mean((1, 3))


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
@pytest.mark.parametrize("reduction", [1, 2, 4, 8])
def test_reduced_images_are_means_of_blocks(tmp_path: Path, suffix: str, reduction: int) -> None:
    found = read_image(saved(tmp_path, suffix), reduction)
    expected = averaged(scene(), reduction)
    assert found.shape == expected.shape
    error = np.abs(found - expected)
    # a JPEG keeps colours at half resolution, and leaves high frequencies out where the mean would fold them in
    assert error.mean() < (2.0 if suffix == ".jpg" else 0.51)
    np.testing.assert_allclose(load_image(scene(), reduction), expected, atol=0.51)


BY_OPENCV = {1: cv2.IMREAD_COLOR, 2: cv2.IMREAD_REDUCED_COLOR_2, 4: cv2.IMREAD_REDUCED_COLOR_4, 8: cv2.IMREAD_REDUCED_COLOR_8}


def by_opencv(content: bytes, reduction: int) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(content, dtype=np.uint8), BY_OPENCV[reduction])[..., ::-1]


@pytest.mark.parametrize("reduction", [1, 2, 4, 8])
@pytest.mark.parametrize("kind", ["usual", "grey", "progressive", "full colour"])
def test_jpegs_are_what_opencv_gives(kind: str, reduction: int) -> None:
    options = {
        "progressive": [cv2.IMWRITE_JPEG_PROGRESSIVE, 1],
        "full colour": [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444],
    }
    image = scene()[:191, :317]  # not a multiple of a block
    content = cv2.imencode(".jpg", image[..., 0] if kind == "grey" else image, options.get(kind, []))[1].tobytes()
    found = decode_image(np.frombuffer(content, dtype=np.uint8), "there", reduction)
    np.testing.assert_array_equal(found, by_opencv(content, reduction))
    assert found.flags.c_contiguous


@pytest.mark.parametrize("reduction", [1, 2])
def test_a_jpeg_that_hides_its_size_is_left_to_opencv(monkeypatch: pytest.MonkeyPatch, reduction: int) -> None:
    """Zeros before a marker end the search for the size; OpenCV skips them, and so would the fast decoder, without reducing."""
    plain = cv2.imencode(".jpg", scene())[1].tobytes()
    second = 4 + int.from_bytes(plain[4:6])  # where the first segment ends
    content = plain[:second] + bytes(3) + plain[second:]
    monkeypatch.setattr(simplejpeg, "decode_jpeg", lambda *_, **__: pytest.fail("memory would be taken unasked"))
    found = decode_image(np.frombuffer(content, dtype=np.uint8), "there", reduction)
    assert found.shape == (HEIGHT // reduction, WIDTH // reduction, 3)


@pytest.mark.parametrize("reduction", [1, 2])
def test_pictures_of_a_telephone_held_upright_are_turned(reduction: int) -> None:
    lying = cv2.imencode(".jpg", scene()[..., ::-1])[1].tobytes()
    # big endian, one entry: orientation (0x112), a short, 6: what is at the right of the file belongs to the bottom
    exif = b"Exif\0\0MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 0x112, 3, 1, 6, 0, 0)
    content = lying[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + lying[2:]
    found = decode_image(np.frombuffer(content, dtype=np.uint8), "there", reduction)
    expected = decode_image(np.frombuffer(lying, dtype=np.uint8), "there", reduction)
    np.testing.assert_array_equal(found, np.rot90(expected, -1))


def test_edges_stay_where_they_are(tmp_path: Path) -> None:
    """The mean place of a bright disc, in parts of the image, at every size: a shift of half a pixel would show."""
    image = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    cv2.circle(image, (211, 77), 30, (255, 255, 255), -1, cv2.LINE_AA)
    path = saved(tmp_path, ".jpg", image)
    for reduction in (1, 2, 4, 8):
        grey = read_image(path, reduction).mean(-1)
        v, u = np.mgrid[: grey.shape[0], : grey.shape[1]] + 0.5
        centre = np.array([(grey * u).sum(), (grey * v).sum()]) / grey.sum() * reduction
        np.testing.assert_allclose(centre, (211.5, 77.5), atol=0.1)


def png_of(width: int, height: int) -> bytes:
    """A small file that says it is an image of that size."""
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(bytes(1000))), (b"IEND", b"")]
    packed = [struct.pack(">I", len(c)) + kind + c + struct.pack(">I", zlib.crc32(kind + c)) for kind, c in chunks]
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)


def jpeg_of(width: int, height: int) -> bytes:
    content = cv2.imencode(".jpg", np.zeros((16, 16, 3), dtype=np.uint8))[1].tobytes()
    at = content.index(b"\xff\xc0")
    return content[: at + 5] + struct.pack(">HH", height, width) + content[at + 9 :]


@pytest.mark.parametrize("made", [png_of, jpeg_of])
@pytest.mark.parametrize("size_px", [(60_000, 60_000), (65_000, 3_000)])
def test_an_absurd_size_costs_neither_time_nor_memory(made: Callable[[int, int], bytes], size_px: tuple[int, int]) -> None:
    tracemalloc.start()
    began = time.process_time()
    for reduction in (1, 8):
        with pytest.raises(ValueError, match=f"there: .* {size_px[0]} x {size_px[1]} pixels"):
            decode_image(np.frombuffer(made(*size_px), dtype=np.uint8), "there", reduction)
    assert time.process_time() - began < 1 and tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_damaged_images_are_refused_or_decoded_to_their_size(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(0)
    content = saved(tmp_path, suffix, scene()[:64, :64]).read_bytes()
    for n in range(60):
        damaged = bytearray(content[: rng.integers(1, len(content))] if n % 3 == 0 else content)
        for at in rng.integers(0, len(damaged), 3):
            damaged[at] ^= 1 << rng.integers(8)
        try:
            image = decode_image(np.frombuffer(bytes(damaged), dtype=np.uint8), "there")
        except ValueError as error:
            assert str(error).startswith("there: ")
        else:
            assert image.dtype == np.uint8 and image.ndim == 3 and image.size <= 3 * 2**27


@given(st.integers(1, 4000), st.integers(1, 4000), st.integers(1, 4000), st.integers(1, 4000))
def test_the_reduction_is_the_largest_that_fits(width: int, height: int, least_width: int, least_height: int) -> None:
    def fits(r: int) -> bool:
        return width % r == 0 and height % r == 0 and width // r >= least_width and height // r >= least_height

    found = reduction_to((width, height), (least_width, least_height))
    assert found == 1 or fits(found)
    assert not any(fits(r) for r in (2, 4, 8) if r > found)


def frame_of(path: Path, camera: Camera = CAMERA) -> Frame:
    return Frame("f", 0, Rig({"front": camera}), {"front": path})


def test_a_frame_gives_what_will_do(tmp_path: Path) -> None:
    frame = frame_of(saved(tmp_path, ".jpg"))
    sizes = {least: frame.image("front", least).shape[:2] for least in [(320, 192), (161, 96), (160, 96), (80, 20), (1, 1)]}
    assert sizes == {(320, 192): (192, 320), (161, 96): (192, 320), (160, 96): (96, 160), (80, 20): (48, 80), (1, 1): (24, 40)}


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_file_of_another_size_is_refused_at_any_size(tmp_path: Path, suffix: str) -> None:
    halved = cv2.resize(scene(), (WIDTH // 2, HEIGHT // 2))
    frame = frame_of(saved(tmp_path, suffix, halved))
    for least in (None, (100, 50)):
        with pytest.raises(ValueError, match="is 160 x 96 pixels but the rig says 320 x 192"):
            frame.image("front", least)


def test_network_input_from_a_reduced_image(tmp_path: Path) -> None:
    frame = frame_of(saved(tmp_path, ".jpg"))
    transform = fit_width(CAMERA, 100, 48)
    lean, whole = View(RecordedImage(frame, "front"), CAMERA, transform), View(frame.image("front"), CAMERA, transform)
    assert np.abs(lean.network_image().astype(float) - whole.network_image()).mean() < 2
    np.testing.assert_array_equal(lean.network_camera().K, whole.network_camera().K)


def test_lenses_are_taken_out_of_reduced_images_as_well(tmp_path: Path) -> None:
    lens = BrownConrady(k1=-0.3, k2=0.1, p1=0.001, p2=-0.001)
    frame = undistorted(frame_of(saved(tmp_path, ".png"), replace(CAMERA, lens=lens)))
    whole = frame.image("front")
    for reduction in (2, 4):
        reduced = frame.image("front", (WIDTH // reduction, HEIGHT // reduction))
        error = np.abs(reduced - averaged(whole, reduction))
        assert reduced.shape == (HEIGHT // reduction, WIDTH // reduction, 3) and error.mean() < 1.5
