"""Find out whether an EXR file is complete, from its tables of chunks.

OpenImageIO's writer ignores the result of closing a file, so the last bytes can be missing on a
full disk without an error. No pixel is decoded here: every chunk must begin where a table says, and
end before the next one and the end of the file.

Source: OpenEXR's "File Layout".
"""

from __future__ import annotations

import mmap
import struct
from pathlib import Path
from typing import NamedTuple

from usdsplat.core.errors import FormatError
from usdsplat.images.exr_bytes import Attributes, read_box, read_headers, values

LINES = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256, 10: 256, 11: 32}
"""Compression -> rows of a chunk of scan lines: none, rle, zips, zip, piz, pxr24, b44, b44a, dwaa,
dwab, htj2k256, htj2k32."""


class _Form(NamedTuple):
    """Layout of the chunks of a part."""

    position: int
    """Size of what precedes the sizes: part number, and row or tile [byte]."""
    is_deep: bool


def is_whole_exr(path: Path) -> bool:
    """Return whether a file is an EXR with all its chunks: flat or deep, in scan lines or tiles."""
    where = str(path)
    with path.open("rb") as file:
        try:
            parts, is_multipart = read_headers(file, where)
            counts = [_chunk_count(part, where) for part in parts]
        except FormatError:
            return False
        start = file.tell()
        if not all(counts) or start + 8 * sum(counts) > file.seek(0, 2):
            return False
        forms = [
            form
            for part, count in zip(parts, counts, strict=True)
            for form in [_form(part, is_multipart)] * count
        ]
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            return _has_chunks(data, start, forms)


def _has_chunks(data: mmap.mmap, start: int, forms: list[_Form]) -> bool:
    """Return whether the chunks of the table at `start`, which have these forms, are in a file."""
    offsets = struct.unpack_from(f"<{len(forms)}Q", data, start)
    end = start + 8 * len(forms)
    for begin, form in sorted(zip(offsets, forms, strict=True)):
        sizes = begin + form.position
        first = sizes + (24 if form.is_deep else 4)
        if begin < end or first > len(data):
            return False
        if form.is_deep:
            size = sum(struct.unpack_from("<QQ", data, sizes))
        else:
            (size,) = struct.unpack_from("<i", data, sizes)
        end = first + size
        if size <= 0:
            return False
    return end <= len(data)


def _form(part: Attributes, is_multipart: bool) -> _Form:
    """Return the layout of the chunks of a part."""
    position = (16 if "tiles" in part else 4) + (4 if is_multipart else 0)
    return _Form(position, part.get("type", ("", b""))[1].startswith(b"deep"))


def _chunk_count(part: Attributes, where: str) -> int:
    """Return the number of chunks of a part; 0 if its header does not say.

    Raises:
        FormatError: If an attribute that it depends on is missing.
    """
    if "chunkCount" in part:
        return max(0, int(values(part, "chunkCount", "<i", where)[0]))
    x0, y0, x1, y1 = read_box(part, "dataWindow", where)
    if "tiles" not in part:
        lines = LINES.get(int(values(part, "compression", "<B", where)[0]), 0)
        return -(-(y1 - y0) // lines) if lines else 0
    width, height, mode = values(part, "tiles", "<IIB", where)
    if not width or not height:
        return 0
    rounds_up = bool(mode >> 4)
    columns = _tile_counts(x1 - x0, width, rounds_up=rounds_up)
    rows = _tile_counts(y1 - y0, height, rounds_up=rounds_up)
    match mode & 15:
        case 0:
            return columns[0] * rows[0]
        case 1:  # mipmaps: the shorter side stays at one tile
            levels = max(len(columns), len(rows))
            columns += [1] * (levels - len(columns))
            rows += [1] * (levels - len(rows))
            return sum(a * b for a, b in zip(columns, rows, strict=True))
        case 2:  # ripmaps
            return sum(columns) * sum(rows)
    return 0


def _tile_counts(size: int, tile: int, *, rounds_up: bool) -> list[int]:
    """Return the number of tiles along a side at each level, from the full size to one pixel."""
    counts = [-(-size // tile)]
    while size > 1:
        size = (size + rounds_up) // 2
        counts.append(-(-size // tile))
    return counts
