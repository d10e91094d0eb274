"""CRC-32C (Castagnoli), the checksum of TFRecord files, on whole arrays at a time.

A message is a polynomial over two elements, and its checksum the remainder after division by a fixed one. Reading the message
as rows of many 32-bit words, each row is folded into the next one by multiplying all its words with the same power of x: one
table look-up per half word, for the whole row at once. What is left is one row, which is folded in the same way.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import UInt32

_POLYNOMIAL = 0x82F63B78
"""Without its highest term; bit 31 is the coefficient of x^0, as the checksum reads bytes with the lowest bit first."""

_ONE = 0x80000000
_ROWS_OF_WORDS = (4096, 64, 1)
_MASK_DELTA = 0xA282EAD8


def crc32c(data: bytes | memoryview) -> int:
    """Checksum of some bytes; that of ``b"123456789"`` is 0xE3069283.

    Memory: the message once more, and tables of 1.5 MB.
    """
    size = len(data)
    if size <= 64:
        return _of_few(data)
    width = _ROWS_OF_WORDS[0] if size > 4 * _ROWS_OF_WORDS[0] else _ROWS_OF_WORDS[1]
    # zeros in front change nothing; the initial value of the register is the same as the first four bytes inverted
    padded = np.zeros(-(-size // (4 * width)) * 4 * width, dtype=np.uint8)
    padded[-size:] = np.frombuffer(data, dtype=np.uint8)
    start = len(padded) - size
    padded[start : start + 4] ^= 0xFF
    words = padded.view("<u4").astype(np.uint32, copy=False)
    for width in _ROWS_OF_WORDS:
        if len(words) > width:
            words = _folded(words.reshape(-1, width))
    low, high = _multiplier(4)
    return int(low[words[0] & 0xFFFF] ^ high[words[0] >> 16]) ^ 0xFFFFFFFF


def masked_crc32c(data: bytes | memoryview) -> int:
    """The checksum as TFRecord files store it: turned right by 15 bits, plus a constant."""
    crc = crc32c(data)
    return ((crc >> 15 | crc << 17) + _MASK_DELTA) & 0xFFFFFFFF


def _folded(rows: UInt32[np.ndarray, "n w"]) -> UInt32[np.ndarray, "w"]:
    """The row that stands for all rows: Horner's scheme with x^(bits of a row)."""
    low, high = _multiplier(4 * rows.shape[1])
    total: np.ndarray = rows[0]
    for row in rows[1:]:
        total = low[total & 0xFFFF] ^ high[total >> 16] ^ row
    return total


@lru_cache(maxsize=len(_ROWS_OF_WORDS))
def _multiplier(count: int) -> tuple[UInt32[np.ndarray, "65536"], UInt32[np.ndarray, "65536"]]:
    """Products of x^(8 count) with all lower and all upper half words."""
    power = _power(8 * count)
    tables = []
    for first_bit in (0, 16):
        table = np.zeros(1, dtype=np.uint32)
        for bit in range(first_bit, first_bit + 16):
            table = np.concatenate([table, table ^ np.uint32(_product(1 << bit, power))])
        table.setflags(write=False)
        tables.append(table)
    return tables[0], tables[1]


def _power(exponent: int) -> int:
    """x^exponent modulo the polynomial, by repeated squaring."""
    result, square = _ONE, _ONE >> 1
    while exponent:
        if exponent & 1:
            result = _product(result, square)
        square = _product(square, square)
        exponent >>= 1
    return result


def _product(a: int, b: int) -> int:
    """Product of two polynomials modulo that of the checksum."""
    result = 0
    for power in range(32):  # b is b x^power here
        if a & (_ONE >> power):
            result ^= b
        b = (b >> 1) ^ (_POLYNOMIAL if b & 1 else 0)
    return result


def _of_few(data: bytes | memoryview) -> int:
    register = 0xFFFFFFFF
    for byte in bytes(data):
        register ^= byte
        for _ in range(8):
            register = (register >> 1) ^ (_POLYNOMIAL if register & 1 else 0)
    return register ^ 0xFFFFFFFF
