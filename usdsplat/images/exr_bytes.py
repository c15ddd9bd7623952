"""Encode and decode the parts of EXR files that deep files need.

OpenImageIO's Python interface passes deep samples one by one. This module instead converts whole
rows of samples between arrays and bytes.

Source: OpenEXR's "File Layout" and "Technical Introduction"; the byte order of its zip compression
(split in two halves, then differences plus 128) from the same.
"""

from __future__ import annotations

import struct
import zlib
from fractions import Fraction
from typing import Any, BinaryIO

import numpy as np

from usdsplat.core.errors import FormatError
from usdsplat.images.layout import Metadata
from usdsplat.images.timecode import Timecode

MAGIC = 20000630
LONG_NAMES, DEEP, MULTIPART = 0x400, 0x800, 0x1000
NAME_MAX = 255
SHORT_NAME_MAX = 31

NONE, RLE, ZIPS = range(3)
TYPES: dict[int, np.dtype[Any]] = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}
CODES = {dtype: code for code, dtype in TYPES.items()}

Attributes = dict[str, tuple[str, bytes]]
"""Name -> (type, value)."""
Channels = dict[str, np.dtype[Any]]
"""Name -> type, in the order of the file, which is alphabetical."""
Box = tuple[int, int, int, int]

_TUPLES = {2: "v2f", 3: "v3f", 8: "chromaticities", 16: "m44f"}


# --- writing -------------------------------------------------------------------------------


def encoded(metadata: Metadata) -> Attributes:
    """Encode header entries as attributes: text, numbers, ratios, time codes, and tuples as vector
    or matrix."""
    found: Attributes = {}
    for key, value in metadata.items():
        if isinstance(value, str):
            found[key] = "string", value.encode()
        elif isinstance(value, int):
            found[key] = "int", struct.pack("<i", value)
        elif isinstance(value, float):
            found[key] = "float", struct.pack("<f", value)
        elif isinstance(value, Fraction):
            ratio = struct.pack("<iI", value.numerator, value.denominator)
            found[key] = "rational", ratio
        elif isinstance(value, Timecode):
            found[key] = "timecode", struct.pack("<II", value.packed, 0)
        else:
            kind = _TUPLES.get(len(value), "floatvector")
            found[key] = kind, struct.pack(f"<{len(value)}f", *value)
    return found


def channel_list(channels: Channels) -> bytes:
    """Return the value of the attribute "channels"."""
    entries = (
        name.encode() + b"\0" + struct.pack("<iIii", CODES[dtype], 0, 1, 1)
        for name, dtype in channels.items()
    )
    return b"".join(entries) + b"\0"


def box(window: Box) -> bytes:
    """Encode a window with exclusive end in EXR's form."""
    x0, y0, x1, y1 = window
    return struct.pack("<4i", x0, y0, x1 - 1, y1 - 1)


def header(attributes: Attributes, flags: int) -> bytes:
    """Return the start of a single-part file."""
    if max(map(len, attributes)) > SHORT_NAME_MAX:
        flags |= LONG_NAMES
    entries = (
        b"%b\0%b\0%b%b" % (name.encode(), kind.encode(), struct.pack("<i", len(value)), value)
        for name, (kind, value) in attributes.items()
    )
    return struct.pack("<iI", MAGIC, 2 | flags) + b"".join(entries) + b"\0"


def zipped(raw: bytes) -> bytes:
    """Return `raw` compressed, or unchanged if that is not smaller."""
    data = np.frombuffer(raw, np.uint8)
    split = np.concatenate([data[0::2], data[1::2]])
    split[1:] = np.diff(split) + np.uint8(128)
    packed = zlib.compress(split.data, 1)
    return packed if len(packed) < len(raw) else raw


# --- reading -------------------------------------------------------------------------------


def read_headers(file: BinaryIO, where: str) -> tuple[list[Attributes], bool]:
    """Return the attributes of each part, and whether chunks have part numbers; advances `file`.

    Raises:
        FormatError: If it is not an EXR file.
    """
    start = file.read(8)
    magic, version = struct.unpack("<iI", start) if len(start) == 8 else (0, 0)
    if magic != MAGIC:
        raise FormatError(where, "no EXR", "an EXR file")
    parts = [_read_header(file, where)]
    while version & MULTIPART and (more := _read_header(file, where)):
        parts.append(more)
    return parts, bool(version & MULTIPART)


def _read_header(file: BinaryIO, where: str) -> Attributes:
    found: Attributes = {}
    while name := _read_name(file, where):
        kind = _read_name(file, where)
        (size,) = struct.unpack("<i", read_exactly(file, 4, where))
        found[name] = kind, read_exactly(file, size, where)
    return found


def _read_name(file: BinaryIO, where: str) -> str:
    name = bytearray()
    while (byte := read_exactly(file, 1, where)) != b"\0":
        name += byte
        if len(name) > NAME_MAX:
            raise FormatError(where, "an unterminated name", f"names of up to {NAME_MAX} bytes")
    return name.decode(errors="replace")


def read_exactly(file: BinaryIO, size: int, where: str) -> bytes:
    """Read the next `size` bytes; raise an error, before allocating, if there are fewer."""
    here = file.tell()
    left = file.seek(0, 2) - here
    file.seek(here)
    if not 0 <= size <= left:
        raise FormatError(
            where, f"{max(0, left)} bytes where {size} should be", "a complete EXR file"
        )
    return file.read(size)


def read_box(attributes: Attributes, name: str, where: str) -> Box:
    """Read a window, end exclusive."""
    x0, y0, x1, y1 = values(attributes, name, "<4i", where)
    if x1 < x0 or y1 < y0:
        raise FormatError(where, f"an empty {name}", "pixels")
    return x0, y0, x1 + 1, y1 + 1


def values(attributes: Attributes, name: str, form: str, where: str) -> tuple[Any, ...]:
    """Read the numbers of an attribute."""
    raw = attributes[name][1] if name in attributes else b""
    if len(raw) != struct.calcsize(form):
        raise FormatError(where, f"no valid {name}", "every attribute that EXR requires")
    return struct.unpack(form, raw)


def read_channels(attributes: Attributes, where: str) -> Channels:
    """Return the value of the attribute "channels"."""
    raw = attributes.get("channels", ("", b""))[1]
    found: Channels = {}
    at = 0
    while at < len(raw) and raw[at]:
        end = raw.find(b"\0", at)
        is_whole = 0 < end < len(raw) - 16
        code = int.from_bytes(raw[end + 1 : end + 5], "little") if is_whole else -1
        if code not in TYPES:
            raise FormatError(
                where, "a truncated channel list", "every attribute that EXR requires"
            )
        found[raw[at:end].decode(errors="replace")] = TYPES[code]
        at = end + 17
    return found


def unpacked(packed: bytes, size: int, compression: int, where: str) -> bytes:
    """Decompress `packed` to `size` bytes, never to more.

    Raises:
        FormatError: If the size differs.
    """
    if len(packed) == size:
        return packed
    raw = b""
    if compression == ZIPS:
        raw = _inflated(packed, size)
    elif compression == RLE:
        raw = _run_lengths(packed, size)
    if len(raw) != size:
        raise FormatError(where, "samples that cannot be unpacked", "a complete EXR file")
    data = np.cumsum(np.frombuffer(raw, np.uint8), dtype=np.uint8)
    data[1::2] ^= 128
    joined = np.empty_like(data)
    half = (size + 1) // 2
    joined[0::2], joined[1::2] = data[:half], data[half:]
    return joined.tobytes()


def _inflated(packed: bytes, size: int) -> bytes:
    try:
        # Allow one extra byte, so that longer data is noticed.
        return zlib.decompressobj().decompress(packed, size + 1)
    except zlib.error:
        return b""


def _run_lengths(packed: bytes, size: int) -> bytes:
    """Undo RLE: n >= 0 repeats a byte n + 1 times, n < 0 is followed by -n literal bytes."""
    raw = bytearray()
    at = 0
    while at < len(packed) and len(raw) <= size:
        n = packed[at]
        if n < 128:
            raw += packed[at + 1 : at + 2] * (n + 1)
            at += 2
        else:
            raw += packed[at + 1 : at + 257 - n]
            at += 257 - n
    return bytes(raw)
