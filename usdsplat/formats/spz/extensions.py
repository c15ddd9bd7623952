"""Read and write the extension records of SPZ files.

Source: nianticlabs/spz, `extensions/`; records are {u32 type, u32 length, payload}.
"""

from __future__ import annotations

import struct

from usdsplat.core.errors import FormatError, UsageError

EXTENSION_LIMIT = 1 << 16
"""Maximum size of all records [byte]; the known ones take 30."""

COORDINATE_SYSTEM = 0xADBE0003
"""Adobe's record of the directions of the axes, u32."""

_SAFE_ORBIT_CAMERA = 0xADBE0002
"""Adobe's limits of an orbit camera: minimum and maximum elevation [radian], radius, f32."""

_RECORD = struct.Struct("<II")
_ORBIT = struct.Struct("<3f")
_INDEX = struct.Struct("<I")
_DEFAULT_FRAME = "rub"  # the library's meaning of "unspecified"
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
            raise FormatError(source, found, "a complete record")
        records[kind] = block[start : start + length]
        start += length
    return records


def stated_frame(source: str, records: dict[int, bytes]) -> str | None:
    """Return the axes of the coordinate system record (`core.axes`), or None without a record.

    Raises:
        FormatError: If the record names unknown axes.
    """
    payload = records.get(COORDINATE_SYSTEM)
    if payload is None:
        return None
    index = int.from_bytes(payload, "little")
    if len(payload) != 4 or index >= len(_FRAMES):
        found = f"coordinate system {index} in {len(payload)} bytes"
        raise FormatError(source, found, f"0 to {len(_FRAMES) - 1} in 4 bytes")
    return _FRAMES[index]


def frame_record(frame: str) -> bytes:
    """Return the record that states the directions of the axes.

    Raises:
        UsageError: If SPZ cannot express `frame`.
    """
    stated = _FRAMES[1:]
    if frame not in stated:
        raise UsageError("frame", repr(frame), f"one that SPZ can name: {', '.join(stated)}")
    payload = _INDEX.pack(1 + stated.index(frame))
    return _RECORD.pack(COORDINATE_SYSTEM, len(payload)) + payload


def remarks(records: dict[int, bytes]) -> tuple[str, ...]:
    """Return a note for each record that has no counterpart in a cloud."""
    return tuple(
        f"ignored extension {kind:#010x}, {_meaning(kind, payload)}"
        for kind, payload in records.items()
        if kind != COORDINATE_SYSTEM
    )


def _meaning(kind: int, payload: bytes) -> str:
    if kind == _SAFE_ORBIT_CAMERA and len(payload) == _ORBIT.size:
        low, high, nearest = _ORBIT.unpack(payload)
        return f"safe orbit camera: elevation {low:g} to {high:g} radians, radius from {nearest:g}"
    return f"unknown, of {len(payload)} bytes"
