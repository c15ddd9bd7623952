"""Read a long, untrusted JSON text piece by piece.

Python's own parser holds the whole document, some ten times the size of its text, and its depth is
limited. Here only the values that the caller asks for are decoded. Each has a maximum length, and
their number has a limit, so that time and memory do not depend on what the text holds.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from usdsplat.core.errors import FormatError

LONGEST = 1 << 16
"""Maximum length of a decoded value, unless stated otherwise [character]."""

MOST = 1 << 19
"""Maximum number of values that are decoded, keys included."""

_SHORT = 512
_SPACE = re.compile(r"[ \t\n\r]*")
_KEY = re.compile(r'[ \t\n\r]*"([^"\\\x00-\x1f]{0,64})"[ \t\n\r]*:')
"""A short key without escapes, and the colon after it."""
_DECODER = json.JSONDecoder()


TOO_LONG: Any = object()
"""Result of `JsonReader.value_if_short` for a value that is not short."""


class JsonReader:
    """Reader of a JSON text, from its beginning to its end.

    Call `value`, `items` or `elements` exactly once for the text itself, after each key that
    `items` yields, and whenever `elements` yields.

    Raises:
        FormatError: If the text is not UTF-8; `where` names it.
    """

    def __init__(self, where: str, text: bytes) -> None:
        self._where, self._at, self._left = where, 0, MOST
        try:
            self._text = text.decode("utf-8-sig")
        except UnicodeDecodeError:
            raise self._wrong() from None

    def next(self) -> str:
        """Return the first character of what follows, without consuming it; "" at the end."""
        found = self._text[self._at : self._at + 1]
        if found and found in " \t\n\r" and (match := _SPACE.match(self._text, self._at)):
            self._at = match.end()
            found = self._text[self._at : self._at + 1]
        return found

    def value(self, longest: int = LONGEST) -> Any:
        """Decode the next value.

        Raises:
            FormatError: If it is not JSON, or longer than `longest` characters, or MOST values have
                been decoded.
        """
        found = self.value_if_short(longest)
        if found is TOO_LONG:
            raise self._wrong()
        return found

    def value_if_short(self, longest: int = LONGEST) -> Any:
        """Decode the next value if it is JSON of at most `longest` characters; otherwise consume
        nothing and return TOO_LONG.

        Raises:
            FormatError: If MOST values have been decoded.
        """
        self._count()
        self.next()
        for size in (_SHORT, longest):
            part = self._text[self._at : self._at + size]
            try:
                value, length = _DECODER.raw_decode(part)
            except (ValueError, RecursionError):
                continue
            if length < len(part) or self._at + length == len(self._text):  # no cut-off number
                self._at += length
                return value
        return TOO_LONG

    def items(self) -> Iterator[str]:
        """Read an object: yield each key; the caller must then read its value."""
        self._take("{")
        if self.next() == "}":
            self._at += 1
            return
        more = True
        while more:
            if match := _KEY.match(self._text, self._at):
                self._count()
                self._at = match.end()
                key = match[1]
            else:
                key = self.value()
                if not isinstance(key, str):
                    raise self._wrong()
                self._take(":")
            yield key
            more = self._take(",}") == ","

    def elements(self) -> Iterator[None]:
        """Read a list: yield once before each element, which the caller must then read."""
        self._take("[")
        if self.next() == "]":
            self._at += 1
            return
        more = True
        while more:
            yield
            more = self._take(",]") == ","

    def end(self) -> None:
        """Raise an error unless the text ends here.

        Raises:
            FormatError: If it goes on.
        """
        if self.next():
            raise self._wrong()

    def _count(self) -> None:
        """Count a value that is decoded."""
        self._left -= 1
        if self._left < 0:
            raise FormatError(self._where, f"more than {MOST} values", "fewer")

    def _take(self, allowed: str) -> str:
        """Consume one of the allowed characters."""
        found = self.next()
        if not found or found not in allowed:
            raise self._wrong()
        self._at += 1
        return found

    def _wrong(self) -> FormatError:
        return FormatError(self._where, "text that is not JSON", "a JSON object")
