"""Read streamed SOG: `lod-meta.json` and many SOG files that hold several levels of detail.

One whole level is read; 0 is the finest. No splats are decoded until the metadata of every file of
the level has been read.

Source: splat-transform, which writes and reads it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from usdsplat.core.errors import FormatError, UsageError
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.cloud_builder import CloudBuilder
from usdsplat.formats.inflate import check_count
from usdsplat.formats.options import READ_OPTIONS, ReadOptions
from usdsplat.formats.sog import ERROR_BOUNDS
from usdsplat.formats.sog.decoding import Range, Sog, read_codes, survey
from usdsplat.formats.sog.files import open_sog
from usdsplat.formats.sog.lod_meta import LOD_META, LOD_META_LIMIT, LodMeta, parse_lod_meta

SUFFIXES: tuple[str, ...] = (f"/{LOD_META}",)
HAS_LEVELS = True


def recognises(path: Path, head: bytes) -> bool:
    """Return whether `path` is `lod-meta.json`, or a folder that holds one."""
    is_folder = path.is_dir() and (path / LOD_META).is_file()
    return is_folder or path.name.lower() == LOD_META


def read_meta(path: Path) -> tuple[Path, LodMeta]:
    """Read `lod-meta.json`, or that of a folder, and return its path too.

    Raises:
        FormatError: If it is invalid.
    """
    path = path / LOD_META if path.is_dir() else path
    return path, parse_lod_meta(str(path), _text(path))


def _text(path: Path) -> bytes:
    """Return the content of `lod-meta.json`, which has a maximum length."""
    with path.open("rb") as file:
        text = file.read(LOD_META_LIMIT + 1)
    if len(text) > LOD_META_LIMIT:
        raise FormatError(str(path), f"over {LOD_META_LIMIT} bytes", "no more")
    return text


def read(path: Path, how: ReadOptions = READ_OPTIONS) -> Capture:
    """Read the level `how.lod`; the environment SOG is left out, and a note says so.

    Raises:
        FormatError: If a file is missing or damaged, or contradicts `lod-meta.json`.
        UsageError: If there is no such level.
    """
    path, meta = read_meta(path)
    if not 0 <= how.lod < len(meta.counts):
        levels = f"a level from 0 to {len(meta.counts) - 1}"
        raise UsageError(str(path), f"no level {how.lod}", levels)
    units = _survey(path, meta, how.lod)
    degree = max((unit.degree for unit in units), default=0)
    count = meta.counts[how.lod]
    builder = CloudBuilder(str(path), count, degree, how)
    row = 0
    for unit in units:
        with open_unit(path, unit.name) as sog:
            row = read_codes(sog).decode(unit.ranges, builder, row)
        how.progress.step(f"reading {path}", row, count)
    cloud, notes = builder.cloud()
    versions = sorted({unit.version for unit in units})
    return Capture(
        cloud=cloud,
        format=f"streamed SOG {' and '.join(map(str, versions))}".rstrip(),
        files=(path, *(file for unit in units for file in unit.paths)),
        frame="rdf",
        frame_source="assumed",
        antialiased=any(unit.antialiased for unit in units),
        error_bounds=ERROR_BOUNDS,
        notes=(UNKNOWN_AXES, *_remarks(meta, how.lod), *notes),
    )


@dataclass(frozen=True, slots=True)
class _Unit:
    """Metadata of one file of the level."""

    name: str
    ranges: tuple[Range, ...]
    paths: tuple[Path, ...]
    degree: int
    version: int
    antialiased: bool


def _survey(path: Path, meta: LodMeta, level: int) -> list[_Unit]:
    """Read the metadata of every file of a level, before memory is allocated."""
    units = []
    splats = total_bytes = 0
    for name, ranges in meta.files(level).items():
        with open_unit(path, name) as sog:
            if ranges[-1][1] > sog.meta.count:
                found = f"splat {ranges[-1][1] - 1} of {name}"
                raise FormatError(str(path), found, f"one of its {sog.meta.count}")
            splats += sog.meta.count
            total_bytes += sog.files.total_bytes
            unit = _Unit(
                name=name,
                ranges=ranges,
                paths=sog.files.paths(sog.meta.files),
                degree=sog.degree,
                version=sog.meta.version,
                antialiased=sog.meta.antialiased,
            )
        units.append(unit)
    check_count(str(path), splats, total_bytes)
    return units


@contextmanager
def open_unit(path: Path, name: str) -> Iterator[Sog]:
    """Open and survey a SOG beside `lod-meta.json`.

    Raises:
        FormatError: If it is missing, or its metadata is invalid.
    """
    file = path.parent / name
    if not os.path.isfile(file):  # unlike Path.is_file, accepts names of any length
        raise FormatError(str(path), f"no file {name[:60]!r}", "one in its folder")
    with open_sog(file) as files:
        yield survey(files)


def _remarks(meta: LodMeta, level: int) -> list[str]:
    """Return notes on the other levels and the environment."""
    notes = []
    if len(meta.counts) > 1:
        others = ", ".join(str(count) for count in meta.counts)
        notes.append(f"level {level} of {len(meta.counts)}, which have {others} splats")
    if meta.environment is not None:
        notes.append(f"its environment, {meta.environment}, is a separate capture")
    return notes
