"""JSON read value by value, for files that are too large to hold."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

_CHUNK = 2**20
_MAX_VALUE = 2**24
_MAX_STRING = 2**16
_SPACE = " \t\n\r"


class JsonStream:
    """A cursor in a JSON text. Objects are walked with ``members``, lists with ``items``; ``value`` reads what is there whole.

    Memory is that of the largest value.

    Args:
        file: open text file.
        path: its name, for errors.
        longest: characters that a value may have; 16 million by default. Where the text ends a value may be a little longer.

    Raises:
        ValueError: from all methods, where the text is no JSON, ends too early or is no UTF-8; with file and character.
    """

    def __init__(self, file: TextIO, path: Path, longest: int | None = None) -> None:
        self._file, self._path = file, path
        self._longest = _MAX_VALUE if longest is None else longest
        self._text, self._at, self._dropped, self._ended = "", 0, 0, False
        self._decoder = json.JSONDecoder()

    def members(self) -> Iterator[str]:
        """The keys of the object that begins here; after each the caller reads what it leads to."""
        self._take("{", "an object")
        if self.peek() == "}":
            self._at += 1
            return
        while True:
            key = self.value()
            if not isinstance(key, str):
                raise self.error(f"a key is a string, got {key!r:.40}")
            self._take(":", "':' after a key")
            yield key
            if self.peek() == "}":
                self._at += 1
                return
            self._take(",", "',' or '}'")

    def items(self) -> Iterator[Any]:
        """The values of the list that begins here, each of them whole."""
        self._take("[", "a list")
        if self.peek() == "]":
            self._at += 1
            return
        while True:
            yield self.value()
            if self._text.startswith(",", self._at):  # by far the most frequent, and there may be millions
                self._at += 1
                continue
            if self.peek() == "]":
                self._at += 1
                return
            self._take(",", "',' or ']'")

    def value(self) -> Any:
        """The value that begins here, whole."""
        if not self.peek():
            raise self.error("the file ends where a value is expected; is it complete?")
        while True:
            problem = "a value has no end"
            try:
                found, end = self._decoder.raw_decode(self._text, self._at)
            except json.JSONDecodeError as error:
                problem = error.msg
                # what is cut off by the end of the portion is reported there, or where its string begins
                if len(self._text) - error.pos > _MAX_STRING:
                    raise self.error(problem, error.pos) from error
            except (ValueError, RecursionError) as error:
                raise self.error(str(error)) from error
            else:
                if end < len(self._text) or self._ended:  # a number may go on in the next portion
                    self._at = end
                    return found
            if self._ended:
                raise self.error(f"{problem}; the file ends within a value, is it complete?")
            if len(self._text) - self._at > self._longest:
                raise self.error(f"a value of more than {self._longest} characters")
            self._read(max(_CHUNK, len(self._text) - self._at))

    def peek(self) -> str:
        """The next character that is not a space, "" at the end of the file."""
        while True:
            text, at, end = self._text, self._at, len(self._text)
            while at < end and text[at] in _SPACE:
                at += 1
            self._at = at
            if at < end:
                return text[at]
            if self._ended:
                return ""
            self._read(_CHUNK)

    def finish(self) -> None:
        """Make sure that nothing follows."""
        if self.peek():
            raise self.error("something follows the end")

    def error(self, what: str, at: int | None = None) -> ValueError:
        """An error at a place of the text, by default here."""
        return ValueError(f"{self._path}: character {self._dropped + (self._at if at is None else at)}: {what}")

    def _take(self, character: str, what: str) -> None:
        found = self.peek()
        if found != character:
            raise self.error(
                f"expected {what}, got {found!r}" if found else f"the file ends where {what} is expected; is it complete?"
            )
        self._at += 1

    def _read(self, size: int) -> None:
        try:
            more = self._file.read(size)
        except UnicodeDecodeError as error:
            raise self.error(f"not UTF-8 text ({error.reason})") from error
        self._dropped += self._at
        self._text, self._at = self._text[self._at :] + more, 0
        self._ended = not more
