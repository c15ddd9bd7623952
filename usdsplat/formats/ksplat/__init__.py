"""Read mkkellogg's .ksplat 0.1: floats, or 16-bit positions around the centres of buckets.

Read only. 44, 24 or 24 bytes a splat at levels 0, 1 and 2; 140, 72 or 48 with harmonics of degree
2. Lossy: see the error bounds of the `Capture`.

Source: mkkellogg/GaussianSplats3D 0.4.7, the only writer. Its viewer ignores degree 3; here that
band is read after the two others. Sections may differ in degree: missing coefficients are 0.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.core.errors import FormatError
from usdsplat.core.sh import rgb_to_dc
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.cloud_builder import CloudBuilder, blocks
from usdsplat.formats.ksplat.sections import (
    HEADER_BYTES,
    Buckets,
    KsplatHeader,
    Section,
    read_ksplat_header,
    read_sections,
)
from usdsplat.formats.options import READ_OPTIONS, ReadOptions

SUFFIXES: tuple[str, ...] = (".ksplat",)

_VERSION = b"\x00\x01\x00\x00"
_USED = 44
"""Number of header bytes that have a meaning; the others are 0."""


def recognises(path: Path, head: bytes) -> bool:
    """Return whether `head` has version 0.1 and zeros in the unused part of the header."""
    return head.startswith(_VERSION) and head[_USED:HEADER_BYTES] == bytes(HEADER_BYTES - _USED)


def read(path: Path, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read the splats of all sections.

    Raises:
        FormatError: If counts are inconsistent or exceed the file, a number is not finite, or a
            scale is negative.
    """
    source, size = str(path), path.stat().st_size
    with path.open("rb") as file:
        header = read_ksplat_header(source, file, size)
        sections = read_sections(source, file, size, header)
        degree = max((section.degree for section in sections), default=0)
        builder = CloudBuilder(source, header.count, degree, how)
        start = 0
        for section in sections:
            file.seek(section.offset)
            for local in blocks(section.count):
                rows = slice(start + local.start, start + local.stop)
                records = _records(source, file, section, local)
                _decode(builder, rows, local.start, records, section, header)
                builder.settle_linear(rows)
                how.progress.step(f"reading {source}", rows.stop, header.count)
            start += section.count
    cloud, notes = builder.cloud()
    return Capture(
        cloud=cloud,
        format=f"KSPLAT 0.1, level {header.level}",
        files=(path,),
        frame="rdf",
        frame_source="assumed",
        error_bounds=_error_bounds(header, sections),
        notes=(UNKNOWN_AXES, *notes),
    )


def _records(source: str, file: BinaryIO, section: Section, rows: slice) -> npt.NDArray[np.void]:
    """Read the next records of a section."""
    count = rows.stop - rows.start
    data = file.read(count * section.record.itemsize)
    if len(data) < count * section.record.itemsize:  # the file was truncated in the meantime
        raise FormatError(
            source, f"the end of the file before splat {rows.stop}", f"{section.count} splats"
        )
    return np.frombuffer(data, section.record)


def _decode(
    builder: CloudBuilder,
    rows: slice,
    first: int,
    records: npt.NDArray[np.void],
    section: Section,
    header: KsplatHeader,
) -> None:
    """Decode records into `rows`; `first` is the index of the first one in its section."""
    if section.buckets is None:
        builder.positions[rows] = records["position"]
    else:
        builder.positions[rows] = _around(section.buckets, first, records["position"])
    builder.scales[rows] = records["scale"]
    builder.rotations[rows] = records["rotation"]
    rgba = records["rgba"] / np.float32(255)
    builder.sh[rows, 0] = rgb_to_dc(rgba[:, :3])
    builder.opacities[rows] = rgba[:, 3]
    builder.sh[rows, 1:] = 0
    codes = records["sh"]
    with np.errstate(over="ignore", invalid="ignore"):  # `settle` reports infinities and NaN
        span = np.float32(header.highest) - np.float32(header.lowest)
        values = codes * (span / 255) + np.float32(header.lowest) if header.level == 2 else codes
    for band in range(1, section.degree + 1):
        below, above = band**2, (band + 1) ** 2
        by_channel = values[:, 3 * (below - 1) : 3 * (above - 1)].reshape(len(values), 3, -1)
        builder.sh[rows, below:above] = by_channel.transpose(0, 2, 1)


def _around(buckets: Buckets, first: int, codes: npt.NDArray[np.uint16]) -> F32:
    """Return the positions of the splats of a section from index `first` on."""
    place = np.arange(first, first + len(codes))
    centres = buckets.centres[np.searchsorted(buckets.ends, place, side="right")]
    with np.errstate(over="ignore", invalid="ignore"):  # `settle` reports infinities and NaN
        return ((codes - float(buckets.top)) * buckets.step + centres).astype(np.float32)


def _error_bounds(header: KsplatHeader, sections: tuple[Section, ...]) -> dict[str, str]:
    """Return the error bounds of the only writer, which truncates instead of rounding."""
    colors = "degree 0: 0.014 within +-1.77"
    bounds = {"opacities": "1/255", "sh": colors}
    if header.level == 0:
        return bounds
    step = max((section.buckets.step for section in sections if section.buckets), default=0.0)
    above = "2^-10 of it"
    if header.level == 2:
        span = header.highest - header.lowest
        above = f"{span / 255:.2g} within {header.lowest:.3g} to {header.highest:.3g}"
    return bounds | {
        "positions": f"{step / 2:.2g}",
        "scales": "2^-10 of it",
        "rotations": "0.12 degrees",
        "sh": f"{colors}; above: {above}",
    }
