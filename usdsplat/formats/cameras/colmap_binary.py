"""Read COLMAP's `cameras.bin` and `images.bin`, little-endian."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from usdsplat.core.errors import FormatError
from usdsplat.formats.cameras.lens import MODELS, Lens, lens
from usdsplat.formats.cameras.posed import Stored, checked_count

_COUNT = struct.Struct("<Q")
_LENS = struct.Struct("<IiQQ")
_IMAGE = struct.Struct("<I4d3dI")
_POINT_BYTES = 24
_LONGEST_NAME = 4096
_NAMES = {number: name for name, (number, _) in MODELS.items()}


def lenses(path: Path) -> dict[int, Lens]:
    """Return the lenses by camera id.

    Raises:
        FormatError: If the file ends early or a model is unknown.
    """
    found = {}
    with path.open("rb") as file:
        (count,) = _take(path, file, _COUNT)
        for index in range(checked_count(str(path), count)):
            where = f"{path}: camera {index}"
            number, model, width, height = _take(path, file, _LENS)
            name = _NAMES.get(model, f"number {model}")
            parameters = len(MODELS[name][1].split()) if name in MODELS else 0
            values = _take(path, file, struct.Struct(f"<{parameters}d"))
            found[number] = lens(where, name, (width, height), values)
    return found


def images(path: Path, known: Mapping[int, Lens]) -> Iterator[Stored]:
    """Yield the photographs.

    Raises:
        FormatError: If the file ends early, or a lens is not among the `known`.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        (count,) = _take(path, file, _COUNT)
        for index in range(checked_count(str(path), count)):
            where = f"{path}: image {index}"
            _, *numbers, camera = _take(path, file, _IMAGE)
            name = _name(where, file)
            if camera not in known:
                raise FormatError(where, f"camera {camera}", "one of cameras.bin")
            (points,) = _take(path, file, _COUNT)
            if points * _POINT_BYTES > size - file.tell():
                raise FormatError(where, f"{points} points", "as many as the file holds")
            file.seek(points * _POINT_BYTES, os.SEEK_CUR)
            yield Stored(name=name, lens=known[camera], pose=numbers)


def _take(path: Path, file: BinaryIO, layout: struct.Struct) -> tuple[Any, ...]:
    """Read the next values of `layout`."""
    data = file.read(layout.size)
    if len(data) < layout.size:
        raise FormatError(str(path), "a truncated file", "the records that its counts declare")
    return layout.unpack(data)


def _name(where: str, file: BinaryIO) -> str:
    """Read a zero-terminated string."""
    start = file.tell()
    text, zero, _ = file.read(_LONGEST_NAME).partition(b"\0")
    if not zero:
        raise FormatError(where, "an unterminated name", f"one of up to {_LONGEST_NAME} bytes")
    file.seek(start + len(text) + 1)
    return text.decode("utf-8", "replace")
