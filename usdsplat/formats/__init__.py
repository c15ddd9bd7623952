"""Files to splats and back: one module per format, one entry in `FORMATS`.

A format is a module with `SUFFIXES`, `recognises`, `read` and, if it can be written, `write`: see
`Format` and `WritableFormat`. What a file contains decides which one reads it; its suffix is asked
only when the content is unknown, for files get renamed.
"""

from __future__ import annotations

import stat
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Protocol, cast

import numpy as np

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import FormatError, OutputError, UnknownFormatError, UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.core.sh import MAX_DEGREE
from usdsplat.formats import compressed_ply, gltf, ksplat, ply, sog, splat, spz
from usdsplat.formats.capture import Capture
from usdsplat.formats.cloud_builder import in_parallel
from usdsplat.formats.gltf import glb
from usdsplat.formats.options import READ_OPTIONS, WRITE_OPTIONS, ReadOptions, WriteOptions
from usdsplat.formats.sog import lod as sog_lod

__all__ = [
    "FORMATS",
    "Capture",
    "ReadOptions",
    "WriteOptions",
    "degree_written",
    "find",
    "frame_written",
    "read",
    "suffixes_read",
    "suffixes_written",
    "write",
]

_HEAD = 1 << 16
"""Bytes of a file that formats may recognise it by."""


class Format(Protocol):
    """What the registry asks of a module."""

    SUFFIXES: tuple[str, ...]
    """Ends of file names, lower case; "/name" is a whole name."""

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether `path` is of this format, judged by its first bytes (none for a folder)."""

    def read(self, path: Path, how: ReadOptions) -> Capture:
        """Read all of it."""


class WritableFormat(Format, Protocol):
    """A module that writes as well; `MAX_DEGREE` says how far its harmonics go if not to 4."""

    FRAME: str
    """Where x, y and z of its files point (`core.axes`), as is usual or as it demands."""

    def write(self, cloud: SplatCloud, path: Path, how: WriteOptions) -> Mapping[str, str]:
        """Write all of it; returns how far values may be off, as `Capture.error_bounds` has it."""


FORMATS: tuple[Format, ...] = (compressed_ply, ply, sog, sog_lod, spz, glb, gltf, ksplat, splat)
"""Every format, the more particular before the more general."""


def read(
    path: str | Path,
    *,
    how: ReadOptions = READ_OPTIONS,
    progress: Progress = silent,
) -> Capture:
    """Read a capture.

    Args:
        path: A file, or the folder or `meta.json` of an unpacked SOG.
        how: What else is asked of the reader; `progress` takes the place of its own.
        progress: Told how many splats are read.

    Raises:
        FormatError: If the file cannot be opened, or is not what it claims to be.
        UnknownFormatError: If neither content nor suffix is known.
        UsageError: If a level is asked for that the capture does not have.
    """
    module = find(path)
    if how.lod and not getattr(module, "HAS_LEVELS", False):
        raise UsageError(f"{path}: level of detail", str(how.lod), "0, it has no others")
    return module.read(Path(path), replace(how, progress=progress))


def find(path: str | Path) -> Format:
    """Return what reads a capture, by its first bytes or its name.

    Raises:
        FormatError: If the file cannot be opened.
        UnknownFormatError: If neither content nor suffix is known.
    """
    path = Path(path)
    head = _head(path)
    for module in FORMATS:
        if module.recognises(path, head):
            return module
    if path.is_dir():
        raise UnknownFormatError(str(path), "a directory without meta.json", "a capture")
    return _by_suffix(path, suffixes_read())


def write(
    cloud: SplatCloud,
    path: str | Path,
    *,
    how: WriteOptions = WRITE_OPTIONS,
    progress: Progress = silent,
) -> Mapping[str, str]:
    """Write `cloud` in the format that the suffix names.

    Args:
        cloud: The splats.
        path: Target; an older file there is replaced when the new one is complete.
        how: What else the file is to say; `progress` takes the place of its own.
        progress: Told how many splats are written.

    Returns:
        Field of the cloud -> how far the written values may be from it; what is not listed is
        stored as floats.

    Raises:
        UnknownFormatError: If the suffix is not one of `suffixes_written()`.
        OutputError: If nothing can be written there, or a number of the cloud is not finite.
        UsageError: If the format cannot hold such a cloud, or what `how` asks for.
    """
    path = Path(path)
    writer = _writer(path)
    _check_finite(cloud, path)
    return writer.write(cloud, path, replace(how, progress=progress))


def frame_written(path: str | Path) -> str:
    """Where x, y and z point in files of the format that the suffix names, such as "rdf".

    Raises:
        UnknownFormatError: If the suffix is not one of `suffixes_written()`.
    """
    return _writer(Path(path)).FRAME


def degree_written(path: str | Path) -> int:
    """Highest degree of harmonics that others read in files of the format that the suffix names.

    Raises:
        UnknownFormatError: If the suffix is not one of `suffixes_written()`.
    """
    return int(getattr(_writer(Path(path)), "MAX_DEGREE", MAX_DEGREE))


def suffixes_read() -> tuple[str, ...]:
    """Ends of names that can be read; "/name" stands for a whole name."""
    return tuple(suffix for module in FORMATS for suffix in module.SUFFIXES)


def suffixes_written() -> tuple[str, ...]:
    """Ends of names that can be written."""
    able = [module for module in FORMATS if hasattr(module, "write")]
    return tuple(suffix for module in able for suffix in module.SUFFIXES)


def _check_finite(cloud: SplatCloud, path: Path) -> None:
    """Refuse what bytes cannot say and readers refuse, before anything is written."""

    def check(rows: slice) -> None:
        for field in ("positions", "scales", "rotations", "opacities", "sh"):
            if not np.isfinite(getattr(cloud, field)[rows]).all():
                expected = "finite numbers: drop the splats that have others first"
                raise OutputError(str(path), f"{field} that are not finite", expected)

    in_parallel(len(cloud), check)


def _writer(path: Path) -> WritableFormat:
    """What writes files of such a name."""
    return cast(WritableFormat, _by_suffix(path, suffixes_written()))


def _by_suffix(path: Path, allowed: tuple[str, ...]) -> Format:
    """The format whose suffix `path` has, the longest that fits, if `allowed` lists it."""
    name = f"/{path.name.lower()}"
    fitting = [
        (len(suffix), suffix, module)
        for module in FORMATS
        for suffix in module.SUFFIXES
        if name.endswith(suffix)
    ]
    if fitting:
        _, suffix, module = max(fitting, key=lambda item: item[0])
        if suffix in allowed:
            return module
    found = f"suffix {(suffix if fitting else path.suffix)!r}"
    listed = [f"a folder with {end[1:]}" if end[0] == "/" else end for end in allowed]
    raise UnknownFormatError(str(path), found, f"one of {', '.join(listed)}")


def _head(path: Path) -> bytes:
    """First bytes of a plain file, none of a folder."""
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            return b""
        if not stat.S_ISREG(mode):  # a pipe would wait, a device never end
            raise FormatError(str(path), "neither file nor folder", "a capture file")
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError as error:
        found = (error.strerror or str(error)).lower()
        raise FormatError(str(path), found, "a readable capture file") from error
