"""Niantic's SPZ, versions 1 to 4: fixed point and bytes, attribute by attribute.

Versions 1 to 3 are one gzip stream, version 4 has a plain header and a zstd frame per attribute. 19
bytes a splat, 64 with harmonics of degree 3, before compression. Lossy: see `Capture.error_bounds`.

Source: nianticlabs/spz, the library that defines the format. Its own frame is "rub", but its tools,
and others, pack PLY files without turning them, so most files in the wild hold "rdf"
(nianticlabs/spz issue 84). Where the file does not say, "rdf" is assumed and a note says so.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.core.encoding import join_largest
from usdsplat.core.errors import FormatError
from usdsplat.core.progress import Progress, silent
from usdsplat.core.sh import MAX_DEGREE, coefficient_count
from usdsplat.formats.capture import Capture
from usdsplat.formats.filling import Filling, blocks
from usdsplat.formats.inflate import Gunzip, Unzstd, check_count
from usdsplat.formats.spz_extensions import (
    COORDINATE_SYSTEM,
    EXTENSION_LIMIT,
    parse_extensions,
    stated_frame,
)

SUFFIXES: tuple[str, ...] = (".spz",)

Codes = npt.NDArray[np.uint8]
Reader = Callable[[int, str], bytearray]
"""(bytes, name of the attribute) -> exactly these bytes, in the order of the file."""

MAGIC = b"NGSP"
MAX_FRACTIONAL_BITS = 24

_GZIP = b"\x1f\x8b"
_HEADER = struct.Struct("<4sIIBBBB")
_AFTER_HEADER = struct.Struct("<BI")  # version 4: streams, in the last byte of the 16, and table
_HEADER4_SIZE = 32
_TOC = struct.Struct("<QQ")
_ANTIALIASED, _HAS_EXTENSIONS = 1, 2

_SCALES = np.exp(np.arange(256) / 16 - 10).astype(np.float32)
_DC = ((np.arange(256) / 255 - 0.5) / 0.15).astype(np.float32)
_HARMONICS = ((np.arange(256) - 128) / 128).astype(np.float32)

ERROR_BOUNDS = {
    "scales": "a factor of exp(1/32)",
    "opacities": "1/510",
    "sh": "degree 0: 0.013 within +-3.33; degree 1: 1/32, above: 1/16, within +-1",
}


@dataclass(frozen=True, slots=True)
class _Header:
    """The 16 bytes that all versions begin with."""

    magic: bytes
    version: int
    count: int
    degree: int
    fractional_bits: int
    flags: int
    reserved: int

    def planes(self) -> dict[str, int]:
        """Attribute -> bytes a splat, in the order of the file."""
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


def recognises(path: Path, head: bytes) -> bool:
    """Whether a file that starts with `head` is SPZ, or anything in gzip, which nothing else is."""
    return head.startswith((MAGIC, _GZIP))


def read(path: Path, *, progress: Progress = silent) -> Capture:
    """Read splats of any version.

    Raises:
        FormatError: If the header asks for what cannot be, if data is missing, damaged or more than
            the header says, or if a half-precision position is not finite.
    """
    source = str(path)
    with path.open("rb") as file:
        if file.read(len(MAGIC)) == MAGIC:
            file.seek(0)
            return _read_frames(source, file, path.stat().st_size, progress)
        file.seek(0)
        return _read_gzip(source, file, path.stat().st_size, progress)


def _read_gzip(source: str, file: BinaryIO, file_bytes: int, progress: Progress) -> Capture:
    """Versions 1 to 3: attributes, then extensions, in one stream."""
    stream = Gunzip(source, file)
    fields = _HEADER.unpack(stream.read(_HEADER.size, "the header"))
    header = _checked(source, _Header(*fields), file_bytes)
    if header.version == 4:
        raise FormatError(source, "SPZ version 4 in gzip", "version 1, 2 or 3")
    filling = _fill(source, header, stream.read, progress)
    block = b""
    if header.flags & _HAS_EXTENSIONS:
        block = bytes(stream.read_up_to(EXTENSION_LIMIT))
    stream.expect_end("the last splat")
    return _capture(source, header, filling, block, ())


def _read_frames(source: str, file: BinaryIO, file_bytes: int, progress: Progress) -> Capture:
    """Version 4: plain header, extensions and table of contents, then a zstd frame per attribute."""
    head = file.read(_HEADER4_SIZE)
    if len(head) < _HEADER4_SIZE:
        raise FormatError(source, f"a header of {len(head)} bytes", str(_HEADER4_SIZE))
    header = _checked(source, _Header(*_HEADER.unpack_from(head)), file_bytes)
    frames, toc = _AFTER_HEADER.unpack_from(head, _HEADER.size - 1)
    if header.version != 4:
        raise FormatError(source, f"SPZ version {header.version} without gzip", "version 4")
    planes = header.planes()
    if frames != len(planes):
        raise FormatError(source, f"{frames} streams", f"{len(planes)} for degree {header.degree}")
    if not _HEADER4_SIZE <= toc <= _HEADER4_SIZE + EXTENSION_LIMIT:
        raise FormatError(source, f"table of contents at byte {toc}", "one behind the header")
    block = file.read(toc - _HEADER4_SIZE)
    entries = file.read(_TOC.size * frames)
    if len(entries) < _TOC.size * frames:
        raise FormatError(source, f"{file_bytes} bytes", f"at least {toc + _TOC.size * frames}")
    sizes = dict(zip(planes, _TOC.iter_unpack(entries), strict=True))

    def read_plane(size: int, name: str) -> bytearray:
        packed, unpacked = sizes[name]
        if unpacked != size:
            raise FormatError(source, f"{unpacked} bytes of {name}", str(size))
        if packed > file_bytes - file.tell():
            raise FormatError(source, f"{file_bytes} bytes", f"{packed} more for {name}")
        stream = Unzstd(source, file.read(packed))
        plane = stream.read(size, name)
        stream.expect_end(name)
        return plane

    filling = _fill(source, header, read_plane, progress)
    surplus = file_bytes - file.tell()
    notes = (f"ignored {surplus} bytes behind the last stream",) if surplus else ()
    has_extensions = header.flags & _HAS_EXTENSIONS
    return _capture(source, header, filling, block if has_extensions else b"", notes)


def _checked(source: str, header: _Header, file_bytes: int) -> _Header:
    """The header, if what it says can be."""
    if header.magic != MAGIC:
        raise FormatError(source, f"magic {header.magic!r}", f"{MAGIC!r} (SPZ)")
    if not 1 <= header.version <= 4:
        raise FormatError(source, f"SPZ version {header.version}", "version 1 to 4")
    if header.degree > MAX_DEGREE:
        raise FormatError(source, f"harmonics of degree {header.degree}", f"0 to {MAX_DEGREE}")
    if header.fractional_bits > MAX_FRACTIONAL_BITS:
        found = f"{header.fractional_bits} fractional bits"
        raise FormatError(source, found, f"at most {MAX_FRACTIONAL_BITS}")
    check_count(source, header.count, file_bytes)
    return header


def _fill(source: str, header: _Header, read_plane: Reader, progress: Progress) -> Filling:
    """Decode attribute after attribute; arrays are made when the first one has arrived."""
    planes = header.planes()
    total = header.count * sum(planes.values())
    filling = None
    done = 0
    for name, size in planes.items():
        plane = np.frombuffer(read_plane(header.count * size, name), np.uint8)
        filling = filling or Filling(source, header.count, header.degree)
        codes = plane.reshape(header.count, size)
        for rows in blocks(header.count):
            _decode(filling, header, name, rows, codes[rows])
        done += header.count * size
        progress.step(f"reading {source}", done, total)
    assert filling is not None  # there is no version without attributes
    for rows in blocks(header.count):
        filling.settle(rows)
    return filling


def _decode(filling: Filling, header: _Header, name: str, rows: slice, codes: Codes) -> None:
    """Decode one attribute of some splats; `codes` has a row of bytes for each."""
    match name:
        case "positions" if header.version == 1:
            filling.positions[rows] = codes.view("<f2")
        case "positions":
            filling.positions[rows] = _fixed_point(codes, header.fractional_bits)
        case "alphas":
            filling.opacities[rows] = codes[:, 0] / np.float32(255)
        case "colors":
            filling.sh[rows, 0] = _DC[codes]
        case "scales":
            filling.scales[rows] = _SCALES[codes]
        case "rotations" if header.version < 3:
            filling.rotations[rows] = _derived_w(codes)
        case "rotations":
            filling.rotations[rows] = _smallest_three(codes.view("<u4")[:, 0])
        case "harmonics":
            filling.sh[rows, 1:] = _HARMONICS[codes].reshape(len(codes), -1, 3)


def _fixed_point(codes: Codes, fractional_bits: int) -> F32:
    """Signed 24-bit numbers, little endian, three a row."""
    words = np.zeros((len(codes), 3, 4), np.uint8)
    words[:, :, 1:] = codes.reshape(-1, 3, 3)
    signed = words.view("<i4")[:, :, 0] >> 8  # the code stood in the upper bytes
    return (signed * 2.0**-fractional_bits).astype(np.float32)


def _derived_w(codes: Codes) -> F32:
    """Rotations of versions 1 and 2: x, y, z in bytes and w >= 0 from the length."""
    xyz = codes.astype(np.float64) / 127.5 - 1
    w = np.sqrt(np.maximum(0, 1 - np.einsum("ni,ni->n", xyz, xyz)))
    return np.column_stack([w, xyz]).astype(np.float32)


def _smallest_three(words: npt.NDArray[np.uint32]) -> F32:
    """Rotations of version 3 on: index of the largest in (x, y, z, w), three signed magnitudes."""
    parts = np.stack([words >> 20 & 1023, words >> 10 & 1023, words & 1023], axis=1)
    magnitudes = (parts & 511) / (511 * np.sqrt(2))
    rest = np.where(parts & 512, -magnitudes, magnitudes)
    return join_largest(words >> 30, rest)[:, [3, 0, 1, 2]]


def _capture(
    source: str, header: _Header, filling: Filling, block: bytes, notes: tuple[str, ...]
) -> Capture:
    """The result, with what the extensions say and what nobody says."""
    records = parse_extensions(source, block)
    frame = stated_frame(source, records)
    cloud, dropped = filling.cloud()
    remarks = [*dropped, *notes]
    if frame is None:
        remarks.append("SPZ files do not say where their axes point: 'rdf' is assumed, try 'rub'")
    unknown = [f"{kind:#010x}" for kind in records if kind != COORDINATE_SYSTEM]
    if unknown:
        remarks.append(f"ignored extensions {', '.join(unknown)}")
    step = "half precision" if header.version == 1 else f"2^-{header.fractional_bits + 1}"
    turn = "0.2 degrees" if header.version > 2 else "0.4 degrees, some degrees where w is near 0"
    return Capture(
        cloud=cloud,
        format=f"SPZ {header.version}",
        frame=frame or "rdf",
        antialiased=bool(header.flags & _ANTIALIASED),
        error_bounds={"positions": step, "rotations": turn, **ERROR_BOUNDS},
        notes=tuple(remarks),
    )
