"""The wire format, from its description: numbers, strings, nesting, and everything that is no message."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coin3d.datasets import protobuf_wire
from coin3d.datasets.protobuf_wire import Message, read_varint
from waymo_writer import content, packed, real, varint, whole


@pytest.mark.parametrize(
    ("data", "value"),
    [
        (b"\x00", 0),
        (b"\x01", 1),
        (b"\x96\x01", 150),
        (b"\xac\x02", 300),
        (b"\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01", 2**64 - 1),
        (b"\x80\x00", 0),  # longer than needed, and allowed
    ],
)
def test_varints(data: bytes, value: int) -> None:
    assert read_varint(data + b"\x07", 0, len(data) + 1, "x") == (value, len(data))


@pytest.mark.parametrize(
    "data",
    [b"", b"\x80", b"\xff" * 9, b"\xff" * 10 + b"\x01", b"\x80" * 11, b"\xff\xff\xff\xff\xff\xff\xff\xff\xff\x02"],
    ids=["nothing", "open", "nine open", "eleven", "eleven empty", "65 bits"],
)
def test_varints_that_are_none(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"x: byte 0: a number that does not end or has more than 64 bits"):
        read_varint(data, 0, len(data), "x")


@given(st.integers(0, 2**64 - 1))
def test_varints_come_back(value: int) -> None:
    assert read_varint(varint(value), 0, 10, "x") == (value, len(varint(value))) or len(varint(value)) < 10
    assert Message(whole(3, value), "x").whole(3, "n") == value


def test_a_message_with_everything() -> None:
    inner = content(1, "žluť".encode()) + real(9, 0.5)
    data = whole(1, 7) + content(2, inner) + real(3, 1.5, -2.5) + content(3, np.array([4.0]).tobytes())
    data += packed(4, [1, 2]) + varint(4 << 3 | 5) + np.float32(3).tobytes() + whole(5, 1) + content(5, varint(300), varint(2))
    message = Message(data, "x")
    assert message.whole(1, "n") == 7 and message.whole(77, "n") is None
    nested = message.message(2, "inner")
    assert nested is not None and nested.text(1, "name") == "žluť" and nested.real(9, "half") == 0.5
    assert message.reals(3, "r").tolist() == [1.5, -2.5, 4.0]  # packed or not
    assert message.singles(4, "s").tolist() == [1, 2, 3]
    assert message.wholes(5, "w") == [1, 300, 2]
    start, end = message.span(2, "inner") or (0, 0)
    assert data[start:end] == inner
    assert message.messages(6, "none") == [] and message.message(6, "none") is None and len(message.reals(6, "none")) == 0


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\x00\x00", "no field begins so .number 0"),
        (b"\x0b", "kind 3"),  # groups
        (b"\x0c", "kind 4"),
        (b"\x0e\x00", "kind 6"),
        (varint(1 << 32), "no field begins so"),
        (varint(1 << 3 | 2) + varint(5) + b"four", "field 1 of 5 bytes leaves its message"),
        (varint(1 << 3 | 2) + varint(2**63) + b"four", "leaves its message"),
        (varint(1 << 3 | 1) + b"seven77", "field 1 of 8 bytes leaves"),
        (varint(1 << 3 | 5) + b"six", "field 1 of 4 bytes leaves"),
    ],
)
def test_bytes_that_are_no_message(data: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=f"^x: byte 0: .*{message}"):
        Message(data, "x")


def test_fields_of_another_kind() -> None:
    message = Message(real(1, 2.0) + whole(2, 1) + whole(2, 1) + content(3, b"\xff\xfe") + content(4, b"123"), "x")
    with pytest.raises(ValueError, match=r"x: time \(field 1\) is 8 bytes where a whole number is expected"):
        message.whole(1, "time")
    with pytest.raises(ValueError, match="x: time occurs 2 times"):
        message.whole(2, "time")
    with pytest.raises(ValueError, match="x: name is no text"):
        message.text(3, "name")
    with pytest.raises(ValueError, match="not a whole number of 8-byte numbers"):
        message.reals(4, "matrix")
    with pytest.raises(ValueError, match="is a whole number where 8 bytes or a string"):
        message.reals(2, "matrix")
    with pytest.raises(ValueError, match=r"^x: row 0: byte 2: "):
        Message(b"\x0a\x03" + b"\x0a\x09\x00", "x").messages(1, "row")


def test_a_nested_message_may_not_leave_its_parent() -> None:
    inner = varint(1 << 3 | 2) + varint(4) + b"abc"
    with pytest.raises(ValueError, match="inner: byte 2: field 1 of 4 bytes leaves"):
        Message(content(1, inner) + b"\x10\x01", "x").message(1, "inner")


def test_depth_and_number_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(protobuf_wire, "_MAX_FIELDS", 1_000)
    deep = b""
    for _ in range(1_000):
        deep = content(1, deep)
    assert Message(deep, "x").message(1, "inner") is not None  # opened level by level, when asked
    with pytest.raises(ValueError, match="more than 1000 fields"):
        Message(whole(1, 0) * 1_001, "x")
    with pytest.raises(ValueError, match="holds more than 1000 numbers"):
        Message(content(1, b"\x00" * 1_001), "x").wholes(1, "sizes")


@given(st.binary(max_size=300))
def test_any_bytes_end_in_a_message_or_an_error(data: bytes) -> None:
    tracemalloc.start()
    try:
        message = Message(data, "x")
        for number in range(1, 8):
            for ask in (message.whole, message.real, message.text, message.messages, message.reals, message.wholes):
                try:
                    ask(number, "n")
                except ValueError as error:
                    assert str(error).startswith("x")
    except ValueError as error:
        assert str(error).startswith("x: byte ")
    finally:
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
        tracemalloc.stop()
