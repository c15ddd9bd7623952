"""Read the containers of SPZ: header, compressed attributes, extensions.

Versions 1 to 3 are one gzip stream. Version 4 has an uncompressed header, extensions and table of
contents, and a zstd frame for each attribute.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from typing import BinaryIO

from usdsplat.core.errors import FormatError
from usdsplat.core.sh import MAX_DEGREE, coefficient_count
from usdsplat.formats.inflate import Gunzip, Unzstd, check_count
from usdsplat.formats.spz.extensions import EXTENSION_LIMIT

MAGIC = b"NGSP"
GZIP_MAGIC = b"\x1f\x8b"
MAX_FRACTIONAL_BITS = 24

HEADER4_SIZE = 32
"""Size of version 4's header [byte]: `SpzHeader`, offset of the table of contents, zeros."""
TABLE_OFFSET = struct.Struct("<I")
TABLE_ENTRY = struct.Struct("<QQ")
"""Compressed and uncompressed size of a frame [byte]."""
ANTIALIASED, HAS_EXTENSIONS = 1, 2
"""Bits of `SpzHeader.flags`."""

_HEADER = struct.Struct("<4sIIBBBB")


@dataclass(frozen=True, slots=True)
class SpzHeader:
    """The 16-byte header of all versions."""

    magic: bytes
    version: int
    count: int
    degree: int
    fractional_bits: int
    flags: int
    streams: int
    """Number of zstd frames in version 4, reserved before."""

    @property
    def is_antialiased(self) -> bool:
        """Whether the splats were trained with the antialiased projection."""
        return bool(self.flags & ANTIALIASED)

    @property
    def has_extensions(self) -> bool:
        """Whether extension records follow."""
        return bool(self.flags & HAS_EXTENSIONS)

    def pack(self) -> bytes:
        """Return the 16 bytes."""
        return _HEADER.pack(*astuple(self))

    def sizes(self) -> dict[str, int]:
        """Return bytes per splat by attribute, in the order of the file."""
        sizes = {
            "positions": 6 if self.version == 1 else 9,
            "alphas": 1,
            "colors": 3,
            "scales": 3,
            "rotations": 3 if self.version < 3 else 4,
        }
        if self.degree:
            sizes["harmonics"] = 3 * (coefficient_count(self.degree) - 1)
        return sizes


class SpzContainer(ABC):
    """An opened SPZ file; attributes must be read once each, in order, to their end."""

    def __init__(self, source: str, header: bytes, file_bytes: int) -> None:
        self._source = source
        self.header = SpzHeader(*_HEADER.unpack(header))
        self._check(file_bytes)

    @abstractmethod
    def attribute(self, name: str, rows: int) -> Iterator[bytes]:
        """Yield the bytes of an attribute, `rows` splats at a time.

        Raises:
            FormatError: If there are fewer or more than the header declares, or they are damaged.
        """

    @abstractmethod
    def extensions(self) -> bytes:
        """Return the extension records; call this after the last attribute is read.

        Raises:
            FormatError: If other data follows the last attribute.
        """

    def _check(self, file_bytes: int) -> None:
        """Raise an error for an invalid header."""
        header, source = self.header, self._source
        if header.magic != MAGIC:
            raise FormatError(source, f"magic {header.magic!r}", f"{MAGIC!r} of SPZ")
        if not 1 <= header.version <= 4:
            raise FormatError(source, f"SPZ version {header.version}", "version 1 to 4")
        if header.degree > MAX_DEGREE:
            raise FormatError(source, f"harmonics of degree {header.degree}", f"0 to {MAX_DEGREE}")
        if header.fractional_bits > MAX_FRACTIONAL_BITS:
            found = f"{header.fractional_bits} fractional bits"
            raise FormatError(source, found, f"at most {MAX_FRACTIONAL_BITS}")
        check_count(source, header.count, file_bytes)


def open_container(source: str, file: BinaryIO, file_bytes: int) -> SpzContainer:
    """Open an SPZ file of any version; `source` names it in error messages.

    Raises:
        FormatError: If the header is missing or invalid.
    """
    magic = file.read(len(MAGIC))
    file.seek(0)
    if magic == MAGIC:
        return _Frames(source, file, file_bytes)
    if magic.startswith(GZIP_MAGIC):
        return _GzipStream(source, file, file_bytes)
    raise FormatError(source, f"{magic!r} at the start", f"{MAGIC!r} or gzip")


class _GzipStream(SpzContainer):
    """A file of version 1 to 3."""

    def __init__(self, source: str, file: BinaryIO, file_bytes: int) -> None:
        self._stream = Gunzip(source, file)
        super().__init__(source, self._stream.read(_HEADER.size, "the header"), file_bytes)
        if self.header.version > 3:
            found = f"SPZ version {self.header.version} in gzip"
            raise FormatError(source, found, "version 1, 2 or 3")

    def attribute(self, name: str, rows: int) -> Iterator[bytes]:
        size = self.header.sizes()[name]
        return self._stream.pieces(self.header.count * size, rows * size, name)

    def extensions(self) -> bytes:
        records = b""
        if self.header.has_extensions:
            records = self._stream.read_up_to(EXTENSION_LIMIT)
        self._stream.expect_end("the last splat")
        return records


class _Frames(SpzContainer):
    """A file of version 4."""

    def __init__(self, source: str, file: BinaryIO, file_bytes: int) -> None:
        head = file.read(HEADER4_SIZE)
        if len(head) < HEADER4_SIZE:
            raise FormatError(source, f"a header of {len(head)} bytes", str(HEADER4_SIZE))
        super().__init__(source, head[: _HEADER.size], file_bytes)
        self._file = file
        self._left = file_bytes - HEADER4_SIZE
        header, sizes = self.header, self.header.sizes()
        (table,) = TABLE_OFFSET.unpack_from(head, _HEADER.size)
        if header.version < 4:
            raise FormatError(source, f"SPZ version {header.version} without gzip", "version 4")
        if header.streams != len(sizes):
            found = f"{header.streams} streams for degree {header.degree}"
            raise FormatError(source, found, str(len(sizes)))
        if not HEADER4_SIZE <= table <= HEADER4_SIZE + EXTENSION_LIMIT:
            raise FormatError(source, f"table of contents at byte {table}", "after the header")
        self._records = self._take(table - HEADER4_SIZE, "extensions")
        entries = self._take(TABLE_ENTRY.size * len(sizes), "table of contents")
        self._table = dict(zip(sizes, TABLE_ENTRY.iter_unpack(entries), strict=True))

    def attribute(self, name: str, rows: int) -> Iterator[bytes]:
        packed, unpacked = self._table[name]
        row_bytes = self.header.sizes()[name]
        size = self.header.count * row_bytes
        if unpacked != size:
            raise FormatError(self._source, f"{unpacked} bytes of {name}", str(size))
        stream = Unzstd(self._source, self._take(packed, name))
        yield from stream.pieces(size, rows * row_bytes, name)
        stream.expect_end(name)

    def extensions(self) -> bytes:
        if self._left:
            raise FormatError(self._source, f"{self._left} bytes after the last stream", "none")
        return self._records if self.header.has_extensions else b""

    def _take(self, size: int, what: str) -> bytes:
        """Read the next `size` bytes of the file; raise an error if there are fewer."""
        if size > self._left:
            raise FormatError(self._source, f"{self._left} bytes left for {what}", str(size))
        self._left -= size
        return self._file.read(size)
