"""LZF decompression, which compressed PCD files use (format of Marc Lehmann's LibLZF)."""

from __future__ import annotations

_LARGEST_GROWTH = 88
"""Three bytes stand for 264 at most, so no stream grows by more than this."""


def lzf_decompress(data: bytes, size: int) -> bytes:
    """The content of an LZF stream.

    A control byte below 32 announces that many literal bytes plus one. Any other is a copy from what was written before: its
    upper three bits are the length minus two (seven: the next byte is added), its lower five the upper bits of the distance
    minus one, whose lower eight follow.

    Args:
        data: the compressed bytes.
        size: how many bytes come out.

    Raises:
        ValueError: the stream is cut short, points before its beginning, or does not give ``size`` bytes.
    """
    if size > _LARGEST_GROWTH * len(data):
        raise ValueError(f"{len(data)} compressed bytes cannot become {size}")
    out, at = bytearray(), 0
    try:
        while at < len(data) and len(out) <= size:
            control = data[at]
            at += 1
            if control < 32:
                out += data[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[at]
                at += 1
            distance = ((control & 31) << 8 | data[at]) + 1
            at += 1
            start, length = len(out) - distance, length + 2
            if start < 0:
                raise ValueError(f"a copy at byte {at} starts before the beginning")
            if distance >= length:
                out += out[start : start + length]
            else:  # the copy overlaps what it writes: a pattern that repeats
                pattern = bytes(out[start:])
                out += (pattern * (length // distance + 1))[:length]
    except IndexError:
        raise ValueError("the compressed data end within a copy") from None
    if at > len(data):
        raise ValueError("the compressed data end within literal bytes")
    if len(out) != size:
        raise ValueError(f"the compressed data give {'more than ' * (len(out) > size)}{min(len(out), size)} bytes, not {size}")
    return bytes(out)
