"""Extension records of SPZ files: what a vendor adds beside the splats.

Source: nianticlabs/spz, `extensions/`; records are {u32 type, u32 length, payload}.
"""

from __future__ import annotations

import struct

from usdsplat.core.errors import FormatError

EXTENSION_LIMIT = 1 << 16
"""Bytes that all records of a file may take: those that exist take 30."""

COORDINATE_SYSTEM = 0xADBE0003
"""Adobe's record that says where the axes point, u32."""

_RECORD = struct.Struct("<II")
_DEFAULT_FRAME = "rub"  # what the library reads "unspecified" as
_FRAMES = (
    *(_DEFAULT_FRAME, "ldb", "rdb", "lub", "rub", "ldf", "rdf", "luf", "ruf"),
    *("lfd", "rfd", "lfu", "rfu", "lbd", "rbd", "lbu", "rbu"),
)


def parse_extensions(source: str, block: bytes) -> dict[int, bytes]:
    """Split the extension block of a file into type -> payload; `source` names it in errors.

    Raises:
        FormatError: If a record goes past the end of the block.
    """
    records = {}
    start = 0
    while start < len(block):
        if start + _RECORD.size > len(block):
            raise FormatError(source, f"{len(block) - start} stray bytes", "an extension record")
        kind, length = _RECORD.unpack_from(block, start)
        start += _RECORD.size
        if length > len(block) - start:
            found = f"extension {kind:#010x} of {length} bytes where {len(block) - start} are left"
            raise FormatError(source, found, "a whole record")
        records[kind] = block[start : start + length]
        start += length
    return records


def stated_frame(source: str, records: dict[int, bytes]) -> str | None:
    """Frame that the coordinate system record names (`core.axes`); None if there is no record.

    Raises:
        FormatError: If the record names none that exists.
    """
    payload = records.get(COORDINATE_SYSTEM)
    if payload is None:
        return None
    index = int.from_bytes(payload, "little")
    if len(payload) != 4 or index >= len(_FRAMES):
        found = f"coordinate system {index} in {len(payload)} bytes"
        raise FormatError(source, found, f"0 to {len(_FRAMES) - 1} in 4 bytes")
    return _FRAMES[index]
