"""Text that may hold anything, such as names of files, as one line of printable characters."""

from __future__ import annotations


def shown(value: object) -> str:
    """Return a value as text on one line that any UTF-8 reader accepts.

    Control and format characters, other line breaks, and bytes of file names that are not UTF-8
    become escapes such as `\\n`, `\\u202e` and `\\xff`. Printable characters stay.
    """
    text = str(value)
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else _escape(each) for each in text)


def _escape(character: str) -> str:
    """Return the escape of one character."""
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:  # how Python holds the byte code - 0xDC00 of a file name
        return f"\\x{code - 0xDC00:02x}"
    return character.encode("unicode_escape").decode("ascii")
