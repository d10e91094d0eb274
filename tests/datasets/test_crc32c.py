"""CRC-32C against published values (RFC 3720, appendix B.4) and against the definition bit by bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coin3d.datasets.crc32c import crc32c, masked_crc32c
from waymo_writer import masked_crc


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", 0),
        (b"123456789", 0xE3069283),
        (bytes(32), 0x8A9136AA),
        (b"\xff" * 32, 0x62A8AB43),
        (bytes(range(32)), 0x46DD794E),
        (bytes(range(31, -1, -1)), 0x113FDB5C),
    ],
)
def test_published_values(data: bytes, expected: int) -> None:
    assert crc32c(data) == expected


def test_the_mask_turns_and_adds() -> None:
    # 0xE3069283 turned right by 15: 0x2507C60D; plus 0xA282EAD8: 0xC78AB0E5
    assert masked_crc32c(b"123456789") == 0xC78AB0E5


@given(st.integers(0, 70_000), st.integers(0, 2**32 - 1))
def test_long_messages_equal_the_definition(size: int, seed: int) -> None:
    data = np.random.default_rng(seed).integers(0, 256, size, dtype=np.uint8).tobytes()
    assert masked_crc32c(data) == masked_crc32c(memoryview(data)) == masked_crc(data)


@pytest.mark.parametrize("size", [1, 64, 65, 255, 256, 257, 16_383, 16_384, 16_385, 16_388, 32_768])
def test_sizes_at_the_edges_of_rows(size: int) -> None:
    data = bytes(i * i % 251 for i in range(size))
    assert masked_crc32c(data) == masked_crc(data)


def test_any_flipped_bit_is_found() -> None:
    data = bytearray(b"frame" * 9_000)
    before = crc32c(bytes(data))
    for place in (0, 3, 4, 16_384, 44_999):
        data[place] ^= 0x10
        assert crc32c(bytes(data)) != before
        data[place] ^= 0x10
