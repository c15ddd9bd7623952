"""Niantic's SPZ, versions 1 to 4: fixed-point numbers and bytes, attribute by attribute.

19 bytes a splat, 64 with harmonics of degree 3, before gzip or zstd. Lossy: see the error bounds of
the `Capture`.

Source: nianticlabs/spz, the library that defines the format. Its own axes are "rub", but its tools
and others pack PLY files without converting them, so most files hold "rdf" (nianticlabs/spz issue
84). If the file does not state its axes, "rdf" is assumed and noted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import OutputError, UsageError
from usdsplat.core.output import output_file
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.cloud_builder import BLOCK, CloudBuilder, blocks, in_parallel, threads
from usdsplat.formats.options import (
    READ_OPTIONS,
    SPZ_VERSIONS,
    WRITE_OPTIONS,
    ReadOptions,
    WriteOptions,
)
from usdsplat.formats.spz.container import (
    ANTIALIASED,
    GZIP_MAGIC,
    HAS_EXTENSIONS,
    MAGIC,
    SpzContainer,
    SpzHeader,
    open_container,
)
from usdsplat.formats.spz.decoding import Codes, decode
from usdsplat.formats.spz.encoding import LARGEST_STEP, encode, finest_bits
from usdsplat.formats.spz.extensions import (
    frame_record,
    parse_extensions,
    remarks,
    stated_frame,
)
from usdsplat.formats.spz.packing import write_frames, write_gzip

SUFFIXES: tuple[str, ...] = (".spz",)
FRAME = "rdf"

_WAITING = 16
"""Maximum number of blocks waiting to be decoded."""


def recognises(path: Path, head: bytes) -> bool:
    """Return whether a file that starts with `head` is SPZ, or gzip, which no other format uses."""
    return head.startswith((MAGIC, GZIP_MAGIC))


def read(path: Path, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read splats of any version.

    Raises:
        FormatError: If the header is invalid, data is missing, damaged or longer than the header
            declares, or a half-precision position is not finite.
    """
    with path.open("rb") as file:
        return replace(unpack(str(path), file, path.stat().st_size, how), files=(path,))


def unpack(source: str, file: BinaryIO, size: int, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read a capture of any version from `size` bytes at the current position of `file`.

    Args:
        source: Name of the data in error messages.
        file: A readable, seekable file.
        size: Length of the data [byte].
        how: Options of the reader.

    Returns:
        A capture without `files`.

    Raises:
        FormatError: As for `read`.
    """
    container = open_container(source, file, size)
    builder = _fill(source, container, how)
    records = parse_extensions(source, container.extensions())
    frame = stated_frame(source, records)
    cloud, notes = builder.cloud()
    if frame is None:
        notes += (UNKNOWN_AXES,)
    return Capture(
        cloud=cloud,
        format=f"SPZ {container.header.version}",
        files=(),
        frame=frame or "rdf",
        frame_source="assumed" if frame is None else "file",
        antialiased=container.header.is_antialiased,
        error_bounds=_error_bounds(container.header),
        notes=notes + remarks(records),
    )


def write(cloud: SplatCloud, path: Path, how: WriteOptions = WRITE_OPTIONS) -> Mapping[str, str]:
    """Write `cloud` in `how.spz_version`, without ids and velocities.

    Positions get the largest number of fractional bits with which the farthest splat does not
    overflow. `spz.encoding` describes what is clamped.

    Args:
        cloud: Finite splats.
        path: Target, replaced when the file is complete.
        how: Version, antialiased flag, and axes, which become an extension record if known.

    Returns:
        Error bounds, in the form of `Capture.error_bounds`.

    Raises:
        OutputError: If a coordinate exceeds 8 388 607, or the target cannot be written.
        UsageError: If the version is unknown, or SPZ cannot express the axes.
    """
    if how.spz_version not in SPZ_VERSIONS:
        known = " or ".join(map(str, SPZ_VERSIONS))
        raise UsageError("SPZ version", str(how.spz_version), known)
    bits = finest_bits(cloud.positions)
    if bits is None:
        raise OutputError(str(path), "a larger coordinate", f"at most {LARGEST_STEP} in SPZ")
    extensions = b"" if how.frame is None else frame_record(how.frame)
    flags = (ANTIALIASED if how.antialiased else 0) | (HAS_EXTENSIONS if extensions else 0)
    header = SpzHeader(MAGIC, how.spz_version, len(cloud), cloud.sh_degree, bits, flags, 0)
    with output_file(path) as output, output.open() as file:
        planes = _encoded(cloud, header)
        pack = write_gzip if how.spz_version < 4 else write_frames
        pack(
            file,
            header,
            planes,
            extensions,
            lambda *done: how.progress.step(f"writing {path}", *done),
        )
    return _error_bounds(header)


def _error_bounds(header: SpzHeader) -> dict[str, str]:
    """Return the rounding errors of the library's encoder."""
    half = header.version == 1
    derived = header.version < 3
    return {
        "positions": "half precision" if half else f"2^-{header.fractional_bits + 1}",
        "scales": "a factor of exp(1/32) within exp(-10) to exp(5.94)",
        "rotations": "some degrees where w is near 0, else 0.7" if derived else "0.28 degrees",
        "opacities": "1/510",
        "sh": "degree 0: 0.013 within +-3.33; degree 1: 1/32, above: 1/16, within +-1",
    }


def _encoded(cloud: SplatCloud, header: SpzHeader) -> list[Codes]:
    """Return the codes of every attribute, a row for each splat, in the order of the file."""
    planes = {name: np.empty((len(cloud), size), np.uint8) for name, size in header.sizes().items()}

    def work(rows: slice) -> None:
        for name, plane in planes.items():
            plane[rows] = encode(cloud, name, rows, header.fractional_bits)

    in_parallel(len(cloud), work)
    return list(planes.values())


def _fill(source: str, container: SpzContainer, how: ReadOptions) -> CloudBuilder:
    """Unpack the attributes; threads decode while the last and largest one is unpacked."""
    header = container.header
    *names, last = header.sizes()
    planes = {
        name: np.frombuffer(b"".join(container.attribute(name, BLOCK)), np.uint8) for name in names
    }
    # Allocated only now: the data for this count exists.
    builder = CloudBuilder(source, header.count, header.degree, how)

    def work(rows: slice, piece: bytes) -> None:
        block = {name: plane.reshape(header.count, -1)[rows] for name, plane in planes.items()}
        block[last] = np.frombuffer(piece, np.uint8).reshape(rows.stop - rows.start, -1)
        for name, codes in block.items():
            decode(builder, header, name, rows, codes)
        if header.version == 1:
            builder.settle(rows)

    jobs: deque[Future[None]] = deque()
    with threads() as workers:
        for rows, piece in zip(blocks(header.count), container.attribute(last, BLOCK), strict=True):
            jobs.append(workers.submit(work, rows, piece))
            if len(jobs) > _WAITING:
                jobs.popleft().result()
            how.progress.step(f"reading {source}", rows.stop, header.count)
        for job in jobs:
            job.result()
    return builder
