"""The wire format of protocol buffers: a message is a list of numbered fields. Which number means what, the caller knows.

Nested messages are opened when asked for, so depth is that of the caller's questions, whatever the bytes hold.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_KINDS = {_VARINT: "a whole number", _FIXED64: "8 bytes", _BYTES: "a string or message", _FIXED32: "4 bytes"}
_MAX_FIELDS = 100_000
"""Of one message: far more than a frame has, few enough for a list of them."""

_MAX_VARINT_BYTES = 10
_DOUBLE = struct.Struct("<d")


class Field(NamedTuple):
    """One field as it lies in the bytes.

    Args:
        number: which field.
        kind: wire type.
        value: of a whole number; 0 otherwise.
        start: first byte of the content.
        end: byte after it.
    """

    number: int
    kind: int
    value: int
    start: int
    end: int


def read_varint(data: bytes, start: int, end: int, where: str) -> tuple[int, int]:
    """A whole number of up to 64 bits and the byte after it.

    Raises:
        ValueError: it does not end before ``end``, or has more than 64 bits.
    """
    value = 0
    for i in range(min(_MAX_VARINT_BYTES, end - start)):
        byte = data[start + i]
        value |= (byte & 0x7F) << (7 * i)
        if byte < 0x80:
            if value >> 64:
                break
            return value, start + i + 1
    raise ValueError(f"{where}: byte {start}: a number that does not end or has more than 64 bits; the record is damaged")


def read_field(data: bytes, start: int, end: int, where: str, size: int | None = None) -> Field:
    """The field that begins at ``start``.

    Args:
        data: bytes of the message, at least up to where the field's content starts.
        start: first byte of the field.
        end: how far ``data`` may be read.
        where: names the message in errors.
        size: end of the message, if ``data`` is only a piece of it.

    Raises:
        ValueError: a wire type that does not exist or is not used any more, or a content that leaves the message.
    """
    tag, after = read_varint(data, start, end, where)
    number, kind = tag >> 3, tag & 7
    if not 0 < number < 1 << 29 or kind not in _KINDS:
        raise ValueError(f"{where}: byte {start}: no field begins so (number {number}, kind {kind}); the record is damaged")
    if kind == _VARINT:
        value, stop = read_varint(data, after, end, where)
        return Field(number, kind, value, after, stop)
    if kind == _BYTES:
        length, after = read_varint(data, after, end, where)
    else:
        length = 8 if kind == _FIXED64 else 4
    if length > (end if size is None else size) - after:
        raise ValueError(f"{where}: byte {start}: field {number} of {length} bytes leaves its message; the record is damaged")
    return Field(number, kind, 0, after, after + length)


class Message:
    """The fields of one message by number.

    Args:
        data: bytes that hold it.
        where: names it in errors.
        start: its first byte.
        end: the byte after it; the end of ``data`` by default.

    Raises:
        ValueError: bytes that are no message, or one of more than 100,000 fields.
    """

    def __init__(self, data: bytes, where: str, start: int = 0, end: int | None = None) -> None:
        self.data, self.where = data, where
        self._fields: dict[int, list[Field]] = {}
        for count, field in enumerate(_fields(data, start, len(data) if end is None else end, where)):
            if count >= _MAX_FIELDS:
                raise ValueError(f"{where}: more than {_MAX_FIELDS} fields in one message; the record is damaged")
            self._fields.setdefault(field.number, []).append(field)

    def whole(self, number: int, name: str) -> int | None:
        """A whole number, or None where the field is absent."""
        field = self._one(number, _VARINT, name)
        return None if field is None else field.value

    def real(self, number: int, name: str) -> float | None:
        """A number of double precision, or None where the field is absent."""
        field = self._one(number, _FIXED64, name)
        return None if field is None else float(_DOUBLE.unpack_from(self.data, field.start)[0])

    def text(self, number: int, name: str) -> str | None:
        """A string, or None where the field is absent."""
        field = self._one(number, _BYTES, name)
        try:
            return None if field is None else self.data[field.start : field.end].decode()
        except UnicodeDecodeError as error:
            raise ValueError(f"{self.where}: {name} is no text ({error}); the record is damaged") from error

    def span(self, number: int, name: str) -> tuple[int, int] | None:
        """First byte and byte after the last of a string of bytes, or None where the field is absent."""
        field = self._one(number, _BYTES, name)
        return None if field is None else (field.start, field.end)

    def message(self, number: int, name: str) -> Message | None:
        """A nested message, or None where the field is absent."""
        field = self._one(number, _BYTES, name)
        return None if field is None else self._open(field, name)

    def messages(self, number: int, name: str) -> list[Message]:
        """All nested messages of a repeated field."""
        fields = self._of_kind(number, (_BYTES,), name)
        return [self._open(field, f"{name} {i}") for i, field in enumerate(fields)]

    def reals(self, number: int, name: str) -> Float[np.ndarray, "n"]:
        """All numbers of a repeated field of double precision, packed or not."""
        return self._numbers(number, _FIXED64, "<f8", name)

    def singles(self, number: int, name: str) -> Float[np.ndarray, "n"]:
        """All numbers of a repeated field of single precision, packed or not."""
        return self._numbers(number, _FIXED32, "<f4", name)

    def wholes(self, number: int, name: str) -> list[int]:
        """All whole numbers of a repeated field, packed or not."""
        found = []
        for field in self._of_kind(number, (_VARINT, _BYTES), name):
            if field.kind == _VARINT:
                found.append(field.value)
                continue
            at = field.start
            while at < field.end:
                value, at = read_varint(self.data, at, field.end, f"{self.where}: {name}")
                found.append(value)
                if len(found) > _MAX_FIELDS:
                    raise ValueError(f"{self.where}: {name} holds more than {_MAX_FIELDS} numbers; the record is damaged")
        return found

    def _open(self, field: Field, name: str) -> Message:
        return Message(self.data, f"{self.where}: {name}", field.start, field.end)

    def _numbers(self, number: int, kind: int, dtype: str, name: str) -> np.ndarray:
        size = np.dtype(dtype).itemsize
        parts = []
        for field in self._of_kind(number, (kind, _BYTES), name):
            count, rest = divmod(field.end - field.start, size)
            if rest:
                raise ValueError(f"{self.where}: {name} is not a whole number of {size}-byte numbers; the record is damaged")
            parts.append(np.frombuffer(self.data, dtype, count, field.start))
        return np.concatenate(parts) if parts else np.zeros(0, dtype)

    def _one(self, number: int, kind: int, name: str) -> Field | None:
        fields = self._of_kind(number, (kind,), name)
        if len(fields) > 1:
            raise ValueError(f"{self.where}: {name} occurs {len(fields)} times, once is expected; the record is damaged")
        return fields[0] if fields else None

    def _of_kind(self, number: int, kinds: tuple[int, ...], name: str) -> list[Field]:
        fields = self._fields.get(number, [])
        for field in fields:
            if field.kind not in kinds:
                expected = " or ".join(_KINDS[kind] for kind in kinds)
                raise ValueError(
                    f"{self.where}: {name} (field {number}) is {_KINDS[field.kind]} where {expected} is expected; the record "
                    "is damaged or of another kind"
                )
        return fields


def _fields(data: bytes, start: int, end: int, where: str) -> Iterator[Field]:
    while start < end:
        field = read_field(data, start, end, where)
        yield field
        start = field.end
