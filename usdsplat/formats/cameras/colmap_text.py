"""Read COLMAP's `cameras.txt` and `images.txt`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from usdsplat.core.errors import FormatError
from usdsplat.formats.cameras.lens import Lens, lens
from usdsplat.formats.cameras.posed import MOST, Stored

_LONGEST = 1 << 13
"""Maximum length of a parsed line [byte]. Lists of points are longer and are skipped."""


def lenses(path: Path) -> dict[int, Lens]:
    """Return the lenses by camera id, from lines `CAMERA_ID MODEL WIDTH HEIGHT PARAMS...`.

    Raises:
        FormatError: If a line is something else.
    """
    found: dict[int, Lens] = {}
    with path.open("rb") as file:
        for where, words in _lines(path, file):
            if len(words) < 4:
                raise FormatError(where, f"{len(words)} words", "CAMERA_ID MODEL WIDTH HEIGHT ...")
            number, model, width, height, *parameters = words
            size = _whole(where, width), _whole(where, height)
            values = [_number(where, word) for word in parameters]
            found[_whole(where, number)] = lens(where, model, size, values)
            if len(found) > MOST:
                raise FormatError(where, f"more than {MOST} lenses", "fewer")
    return found


def images(path: Path, known: Mapping[int, Lens]) -> Iterator[Stored]:
    """Yield the photographs.

    Each is a line `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, followed by a line of points.

    Raises:
        FormatError: If a line is something else, or a lens is not among the `known`.
    """
    with path.open("rb") as file:
        for where, words in _lines(path, file):
            if len(words) < 10:
                expected = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
                raise FormatError(where, f"{len(words)} words", expected)
            numbers = [_number(where, word) for word in words[1:8]]
            camera = _whole(where, words[8])
            if camera not in known:
                raise FormatError(where, f"camera {camera}", "one of cameras.txt")
            name = " ".join(words[9:])
            yield Stored(name=name, lens=known[camera], pose=numbers)
            _skip_line(file)


def _lines(path: Path, file: BinaryIO) -> Iterator[tuple[str, list[str]]]:
    """Yield (location, words) of each line that is neither blank nor a comment."""
    while line := file.readline(_LONGEST):
        where = f"{path} at byte {file.tell() - len(line)}"
        if not line.endswith(b"\n") and len(line) == _LONGEST:
            if line.startswith(b"#"):
                _skip_line(file)
                continue
            raise FormatError(where, f"a line of more than {_LONGEST} bytes", "COLMAP's text")
        words = line.decode("utf-8", "replace").split()
        if words and not words[0].startswith("#"):
            yield where, words


def _skip_line(file: BinaryIO) -> None:
    """Skip the rest of the line, of any length."""
    while (part := file.readline(1 << 16)) and not part.endswith(b"\n"):
        pass


def _whole(where: str, word: str) -> int:
    """Parse a whole number that is not negative."""
    if not (word.isascii() and word.isdigit() and len(word) <= 19):
        raise FormatError(where, repr(word[:40]), "a whole number")
    return int(word)


def _number(where: str, word: str) -> float:
    """Parse a number, which may be infinite or NaN: the caller checks that."""
    try:
        return float(word)
    except ValueError:
        raise FormatError(where, repr(word[:40]), "a number") from None
