"""Write .usdz packages: zip files without compression whose members begin at multiples of 64 bytes.

A package is the same for the same members: dates are those of SOURCE_DATE_EPOCH, or 1980-01-01.

Source: "Usdz File Format Specification" of OpenUSD; "APPNOTE.TXT" of PKWARE.
"""

from __future__ import annotations

import struct
import time
import zlib
from collections.abc import Iterable
from typing import IO, BinaryIO

from usdsplat.core.errors import OutputError
from usdsplat.core.source_date import source_date

ALIGNMENT = 64
END = b"PK\5\6"
"""The start of the last record of every zip file without a comment."""
END_SIZE = 22
_LOCAL = struct.Struct("<4s5H3I2H")
_CENTRAL = struct.Struct("<4s6H3I5H2I")
_END = struct.Struct("<4s4H2IH")
_PADDING = 0x1986
"""Id of the extra field with padding, as OpenUSD writes it."""
_VERSION = 10
_UTF8 = 0x800
_LARGEST = (1 << 32) - 1
_MOST = (1 << 16) - 1
"""Largest number of members of a zip file without the extensions that a .usdz cannot have."""
_BLOCK = 1 << 20
_FIRST_DATE = (1980, 1, 1, 0, 0, 0)
_LAST_DATE = (2107, 12, 31, 23, 59, 58)


def write(file: BinaryIO, members: Iterable[tuple[str, IO[bytes]]], *, where: str) -> None:
    """Write a package.

    Args:
        file: The file, at its start; it can be sought in.
        members: Name and content of each member; the first is the layer that is opened.
        where: Name of the package, for messages.

    Raises:
        OutputError: If it would be larger than 4 GiB or have more than 65,535 members, which a
            .usdz cannot.
    """
    moment = _dos_time()
    entries: list[bytes] = []
    for name, source in members:
        if len(entries) == _MOST:
            raise OutputError(where, f"more than {_MOST} files to pack", "fewer, or a .usdc")
        begin, text = file.tell(), name.encode()
        extra = _padding(begin + _LOCAL.size + len(text))
        file.seek(begin + _LOCAL.size)
        file.write(text + extra)
        size, crc = _copy(source, file)
        end = file.tell()
        if end > _LARGEST:
            raise OutputError(where, "a package of more than 4 GiB", "a smaller one, or a .usdc")
        flags = 0 if name.isascii() else _UTF8
        shared = (_VERSION, flags, 0, *moment, crc, size, size, len(text), len(extra))
        file.seek(begin)
        file.write(_LOCAL.pack(b"PK\3\4", *shared))
        file.seek(end)
        entries.append(_CENTRAL.pack(b"PK\1\2", 0, *shared, 0, 0, 0, 0, begin) + text + extra)
    begin, contents = file.tell(), b"".join(entries)
    count = len(entries)
    file.write(contents)
    file.write(_END.pack(END, 0, 0, count, count, len(contents), begin, 0))


def _copy(source: IO[bytes], file: BinaryIO) -> tuple[int, int]:
    """Copy a member; return its size and CRC-32."""
    size = crc = 0
    while block := source.read(_BLOCK):
        file.write(block)
        size += len(block)
        crc = zlib.crc32(block, crc)
    return size, crc


def _padding(start: int) -> bytes:
    """Return an extra field after which a member that would begin at `start` is aligned."""
    size = -start % ALIGNMENT
    if 0 < size < 4:  # an extra field has 4 bytes at least
        size += ALIGNMENT
    return struct.pack("<HH", _PADDING, size - 4) + bytes(size - 4) if size else b""


def _dos_time() -> tuple[int, int]:
    """Return time and date of all members, in the form of zip files."""
    date = source_date()
    found = _FIRST_DATE if date is None else time.gmtime(date)[:6]
    year, month, day, hour, minute, second = min(max(found, _FIRST_DATE), _LAST_DATE)
    return hour << 11 | minute << 5 | second // 2, year - 1980 << 9 | month << 5 | day
