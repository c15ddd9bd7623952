"""Read the header and the section headers of a .ksplat file.

Every count is checked against the size of the file before memory is allocated for it.

Source: `SplatBuffer` of mkkellogg/GaussianSplats3D 0.4.7.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.core.errors import FormatError

HEADER_BYTES = 4096
_HEADER = np.dtype(
    {
        "names": ["version", "room", "sections", "splats", "level", "lowest", "highest"],
        "formats": ["<u2", "<u4", "<u4", "<u4", "<u2", "<f4", "<f4"],
        "offsets": [0, 4, 8, 16, 20, 36, 40],
        "itemsize": HEADER_BYTES,
    }
)
_SECTION = np.dtype(
    {
        "names": ["splats", "room", "bucket", "buckets", "block", "bucket_bytes", "top", "full",
                  "partial", "degree"],
        "formats": ["<u4", "<u4", "<u4", "<u4", "<f4", "<u2", "<u4", "<u4", "<u4", "<u2"],
        "offsets": [0, 4, 8, 12, 16, 20, 24, 32, 36, 40],
        "itemsize": 1024,
    }
)  # fmt: skip

_CENTRE_BYTES = 12
_MAX_DEGREE = 3
_TYPES = (("<f4", "<f4", "<f4"), ("<u2", "<f2", "<f2"), ("<u2", "<f2", "u1"))
"""Types by level: of positions; of scales and rotations; of harmonics."""

_DEFAULT_TOP = 32767
_DEFAULT_HARMONICS = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class KsplatHeader:
    """The header of a .ksplat file."""

    level: int
    """0: floats; 1: 16-bit positions, half-precision values; 2: as 1, with 8-bit harmonics."""
    count: int
    sections: int
    first_section: int
    """Offset of the data of the first section [byte]."""
    lowest: float
    """Value of harmonics code 0 at level 2."""
    highest: float
    """Value of harmonics code 255 at level 2."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Buckets:
    """Groups of neighbouring splats whose positions are coded relative to a common centre."""

    centres: F32
    """Centres [scene unit], shape (b, 3)."""
    ends: npt.NDArray[np.int64]
    """Number of splats in all buckets up to and including each one, shape (b,), ascending."""
    top: int
    """Code of the bucket centre; codes 0 and 2 * top are half a block before and after it."""
    step: float
    """Distance between adjacent codes [scene unit]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Section:
    """A section: splats that are stored in one way."""

    count: int
    degree: int
    record: np.dtype[np.void]
    """Layout of a splat: position, scale, rotation (w, x, y, z), rgba, harmonics if any."""
    offset: int
    """Offset of the first splat [byte]."""
    buckets: Buckets | None
    """None at level 0."""


def read_ksplat_header(source: str, file: BinaryIO, size: int) -> KsplatHeader:
    """Read the header of a file of `size` bytes and check that its section headers fit.

    Raises:
        FormatError: If the version or the level is not known, or the file too short.
    """
    data = file.read(HEADER_BYTES)
    if len(data) < HEADER_BYTES:
        raise FormatError(source, f"{size} bytes", f"a header of {HEADER_BYTES}")
    stored = np.frombuffer(data, _HEADER)[0]
    major, minor, level = data[0], data[1], int(stored["level"])
    if (major, minor) < (0, 1) or major:
        raise FormatError(source, f"version {major}.{minor}", "version 0.1")
    if level >= len(_TYPES):
        raise FormatError(source, f"compression level {level}", "0, 1 or 2")
    room, sections = int(stored["room"]), int(stored["sections"])
    first = HEADER_BYTES + room * _SECTION.itemsize
    if sections > room or first > size:
        found = f"{sections} sections and room for {room} in {size} bytes"
        raise FormatError(source, found, "sections that fit")
    return KsplatHeader(
        level=level,
        count=int(stored["splats"]),
        sections=sections,
        first_section=first,
        lowest=float(stored["lowest"]) or -_DEFAULT_HARMONICS,
        highest=float(stored["highest"]) or _DEFAULT_HARMONICS,
    )


def read_sections(
    source: str, file: BinaryIO, size: int, header: KsplatHeader
) -> tuple[Section, ...]:
    """Read the sections of a file of `size` bytes; none reaches beyond its end.

    Raises:
        FormatError: If the numbers of a section are inconsistent or exceed the file.
    """
    file.seek(HEADER_BYTES)
    stored = np.frombuffer(file.read(header.sections * _SECTION.itemsize), _SECTION)
    if len(stored) < header.sections:  # the file was truncated in the meantime
        raise FormatError(source, f"{len(stored)} sections", str(header.sections))
    sections = []
    start = header.first_section
    for index, row in enumerate(stored):
        where = f"{source}: section {index}"
        section, start = _section(where, file, size, row, header.level, start)
        sections.append(section)
    count = sum(section.count for section in sections)
    if count != header.count:
        raise FormatError(source, f"{count} splats in its sections", f"{header.count}, as declared")
    return tuple(sections)


def _section(
    where: str, file: BinaryIO, size: int, row: np.void, level: int, start: int
) -> tuple[Section, int]:
    """Return the section whose data starts at `start`, and the start of the next one."""
    degree, count, room = int(row["degree"]), int(row["splats"]), int(row["room"])
    if degree > _MAX_DEGREE:
        raise FormatError(where, f"harmonics of degree {degree}", f"degree 0 to {_MAX_DEGREE}")
    if count > room:
        raise FormatError(
            where, f"{count} splats", f"at most {room}, the capacity that it declares"
        )
    record = _record(level, degree)
    splats = start + 4 * int(row["partial"]) + int(row["bucket_bytes"]) * int(row["buckets"])
    end = splats + room * record.itemsize
    if end > size:
        raise FormatError(where, f"data up to byte {end}", f"an end within {size} bytes")
    buckets = _buckets(where, file, row, start) if level else None
    section = Section(count=count, degree=degree, record=record, offset=splats, buckets=buckets)
    return section, end


def _record(level: int, degree: int) -> np.dtype[np.void]:
    """Return the layout of a splat."""
    place, shape, harmonics = _TYPES[level]
    fields = [
        ("position", place, 3),
        ("scale", shape, 3),
        ("rotation", shape, 4),
        ("rgba", "u1", 4),
    ]
    return np.dtype([*fields, ("sh", harmonics, 3 * ((degree + 1) ** 2 - 1))])


def _buckets(where: str, file: BinaryIO, row: np.void, start: int) -> Buckets:
    """Read the buckets of a section that is known to fit the file."""
    full, partial, count = int(row["full"]), int(row["partial"]), int(row["buckets"])
    if full + partial != count or (count and row["bucket_bytes"] != _CENTRE_BYTES):
        found = f"{full} full and {partial} partial buckets of {row['bucket_bytes']} bytes"
        raise FormatError(where, found, f"{count} of {_CENTRE_BYTES}")
    file.seek(start)
    lengths = np.frombuffer(file.read(4 * partial), "<u4").astype(np.int64)
    centres = np.frombuffer(file.read(_CENTRE_BYTES * count), "<f4")
    splats = full * int(row["bucket"]) + int(lengths.sum())
    if splats != row["splats"]:
        raise FormatError(where, f"{splats} splats in its buckets", f"{row['splats']}, as declared")
    top = int(row["top"]) or _DEFAULT_TOP
    return Buckets(
        centres=centres.astype(np.float32).reshape(-1, 3),
        ends=np.cumsum(np.concatenate([np.full(full, row["bucket"], np.int64), lengths])),
        top=top,
        step=float(row["block"]) / 2 / top,
    )
