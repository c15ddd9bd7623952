"""Check the sizes of the arrays in a crate file before USD reads them.

USD compresses arrays of numbers in crate files. Equal numbers take 1/2500 of their size in memory,
so a small file can ask for all memory of the machine. Vectors, such as the centres of splats, are
stored as they are. In a file of splats, no array has many more numbers than the largest stored one
has rows.

Source: `pxr/usd/sdf/crateFile.cpp` and `pxr/base/tf/fastCompression.cpp` of OpenUSD. Compressed
arrays exist since version 0.5.0 of the format.
"""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from pxr import Ar

from usdsplat.core.errors import StageError

TRUSTED = 1 << 20
"""Length of an array that any file may have."""
RATIO = 8
"""Largest ratio of the length of a longer one to that of the longest stored array."""
MOST_FIELDS = 1 << 16
"""Largest number of different values of a layer that is checked, and of the paths and tokens of a
chunk."""

_MAGIC = b"PXR-USDC"
_SECTION = struct.Struct("<16sqq")
_MOST_SECTIONS = 64
_COUNTED = (b"TOKENS", b"STRINGS", b"FIELDS", b"FIELDSETS", b"PATHS", b"SPECS")
"""Sections that begin with the number of their entries."""
_LZ4 = 255
"""Largest ratio of LZ4."""
_ARRAY, _INLINED, _COMPRESSED = 1 << 63, 1 << 62, 1 << 61
_PAYLOAD = (1 << 48) - 1
_DAMAGED = (
    OSError, EOFError, ValueError, OverflowError, RuntimeError, LookupError, NotImplementedError,
    struct.error, zlib.error, zipfile.BadZipFile,
)  # fmt: skip
"""What reading a damaged crate file or package may raise; of an encrypted one a RuntimeError."""


def check_arrays(path: str, *, is_chunk: bool) -> None:
    """Raise an error for a crate file with an array that takes much more memory than the file.

    Other files and layers in memory pass.

    Args:
        path: Real path or identifier of a layer, which may be in a package.
        is_chunk: Whether the layer has one field only. Other layers with more than `MOST_FIELDS`
            values pass.

    Raises:
        StageError: If there is such an array, or the file cannot be read.
    """
    try:
        with _opened(path) as file:
            if file is not None:
                _check(file, path, is_chunk)
    except StageError:
        raise
    except _DAMAGED as error:
        found = str(getattr(error, "strerror", None) or "a damaged crate file")
        raise StageError(path, found, "a file that USD can read") from None


def layer_size(path: str) -> int:
    """Return the size of a layer's file, or of the member of a package [byte]; 0 if it cannot be
    read, or is in memory."""
    try:
        with _opened(path) as file:
            return 0 if file is None else file.seek(0, 2)
    except _DAMAGED:
        return 0


@contextmanager
def _opened(path: str) -> Iterator[BinaryIO | None]:
    """Open the file of a layer, or the member of a package, by default its first; None if there is
    none."""
    outer, inner = Ar.SplitPackageRelativePathOuter(path)
    if not Path(outer).is_file():
        yield None
    elif inner or outer.lower().endswith(".usdz"):
        with ExitStack() as during:
            archive = during.enter_context(zipfile.ZipFile(outer))
            member = archive.open(inner or archive.namelist()[0])
            yield cast(BinaryIO, during.enter_context(member))
    else:
        with open(outer, "rb") as file:
            yield file


def _check(file: BinaryIO, where: str, is_chunk: bool) -> None:
    start = file.read(24)
    if len(start) < 24 or not start.startswith(_MAGIC):
        return
    version = tuple(start[8:11])
    if version < (0, 5, 0):
        return
    size = file.seek(0, 2)
    sections = _sections(file, struct.unpack("<q", start[16:])[0])
    if is_chunk:
        _check_sections(file, where, sections)
    count = struct.Struct("<Q" if version >= (0, 7, 0) else "<I")
    stored, compressed = TRUSTED // RATIO, 0
    for value in _values(file, sections):
        if not value & _ARRAY or value & _INLINED or not value & _PAYLOAD:
            continue
        file.seek(value & _PAYLOAD)
        (length,) = count.unpack(file.read(count.size))
        if value & _COMPRESSED:
            compressed = max(compressed, length)
        elif length > size:
            raise struct.error("an array beyond the file")
        elif 4 * length <= size:
            stored = max(stored, length)
    if compressed > RATIO * stored:
        found = f"an array of {compressed} numbers in {size} bytes"
        raise StageError(where, found, f"at most {RATIO * stored} beside the other arrays")


def _sections(file: BinaryIO, contents: int) -> dict[bytes, tuple[int, int]]:
    """Return the name of each section of a crate file -> its offset and size.

    Args:
        file: The file.
        contents: Offset of its table of sections.
    """
    file.seek(contents)
    (count,) = struct.unpack("<Q", file.read(8))
    found: dict[bytes, tuple[int, int]] = {}
    for _ in range(min(count, _MOST_SECTIONS)):
        name, start, length = _SECTION.unpack(file.read(_SECTION.size))
        found.setdefault(name.rstrip(b"\0"), (start, length))
    return found


def _check_sections(file: BinaryIO, where: str, sections: dict[bytes, tuple[int, int]]) -> None:
    """Raise an error if a section of a chunk has more entries than a chunk needs. USD allocates
    memory for as many as the header of the section states."""
    for name in _COUNTED:
        if name not in sections:
            continue
        start, length = sections[name]
        file.seek(start)
        (entries,) = struct.unpack("<Q", file.read(8))
        if entries > MOST_FIELDS:
            raise StageError(where, f"more than {MOST_FIELDS} values", "a layer with one field")
        if name == b"TOKENS":
            (text,) = struct.unpack("<Q", file.read(8))
            if text > _LZ4 * length:
                raise struct.error("a damaged buffer")


def _values(file: BinaryIO, sections: dict[bytes, tuple[int, int]]) -> list[int]:
    """Return the 64-bit representations of the values of a crate file; none if they are too
    many."""
    if b"FIELDS" not in sections:
        return []
    start, _ = sections[b"FIELDS"]
    file.seek(start)
    fields, names = struct.unpack("<QQ", file.read(16))
    if fields > MOST_FIELDS:
        return []
    file.seek(start + 16 + names)
    (packed,) = struct.unpack("<Q", file.read(8))
    data = _inflated(file.read(min(packed, 16 * fields + 1024)), 8 * fields)
    return list(struct.unpack(f"<{fields}Q", data))


def _inflated(data: bytes, size: int) -> bytes:
    """Decompress a buffer of TfFastCompression to `size` bytes.

    Raises:
        struct.error: If it is damaged.
    """
    out = bytearray()
    if data[:1] == b"\0":
        _inflate_block(data[1:], out, size)
    else:
        at = 1
        for _ in range(data[0] if data else 0):
            (length,) = struct.unpack_from("<i", data, at)
            _inflate_block(data[at + 4 : at + 4 + length], out, size)
            at += 4 + length
    if len(out) != size:
        raise struct.error("a damaged buffer")
    return bytes(out)


def _inflate_block(data: bytes, out: bytearray, most: int) -> None:
    """Append the content of an LZ4 block to `out`, which may become `most` bytes long.

    Raises:
        struct.error: If it is damaged.
    """
    at, begin = 0, len(out)

    def length(short: int) -> int:
        nonlocal at
        total, byte = short, 255 if short == 15 else 0
        while byte == 255:
            if at >= len(data):
                raise struct.error("a damaged buffer")
            byte = data[at]
            total, at = total + byte, at + 1
        return total

    while at < len(data):
        token = data[at]
        at += 1
        literals = length(token >> 4)
        out += data[at : at + literals]
        at += literals
        if at >= len(data):
            return  # a block ends with literals
        (offset,) = struct.unpack_from("<H", data, at)
        at += 2
        copied = length(token & 15) + 4
        if not 0 < offset <= len(out) - begin or len(out) + copied > most:
            raise struct.error("a damaged buffer")
        while copied > 0:  # source and target may overlap
            piece = out[-offset:][:copied]
            out += piece
            copied -= len(piece)
