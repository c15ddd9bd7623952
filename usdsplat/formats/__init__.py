"""Read and write splat files: one module per format, one entry each in `FORMATS`.

A format is a module with `SUFFIXES`, `recognises`, `read` and, if it can be written, `write`: see
`Format` and `WritableFormat`. The content of a file selects its reader. The suffix counts only if
no format recognises the content, because files get renamed.
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
    "check_finite",
    "degree_written",
    "find",
    "frame_written",
    "read",
    "suffixes_read",
    "suffixes_written",
    "unit_written",
    "write",
]

_HEAD = 1 << 16
"""Number of leading bytes that are passed to `recognises`."""


class Format(Protocol):
    """A module that reads one format."""

    SUFFIXES: tuple[str, ...]
    """Suffixes of file names, in lower case. A "/name" matches the whole file name."""

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether `path` is of this format, judged by its first bytes (empty for a
        folder)."""

    def read(self, path: Path, how: ReadOptions) -> Capture:
        """Read the whole capture."""


class WritableFormat(Format, Protocol):
    """A module that also writes its format. `MAX_DEGREE`, if present, is the highest degree of
    harmonics that it writes; the default is 4. `METERS_PER_UNIT`, if present, is the unit that its
    lengths are defined in."""

    FRAME: str
    """Directions of x, y and z in its files (`core.axes`): prescribed by the format, or else
    customary."""

    def write(self, cloud: SplatCloud, path: Path, how: WriteOptions) -> Mapping[str, str]:
        """Write the whole cloud and return its error bounds, in the form of
        `Capture.error_bounds`."""


FORMATS: tuple[Format, ...] = (compressed_ply, ply, sog, sog_lod, spz, glb, gltf, ksplat, splat)
"""Every format; a specific one stands before a more general one that would also match."""


def read(
    path: str | Path,
    *,
    how: ReadOptions = READ_OPTIONS,
    progress: Progress = silent,
) -> Capture:
    """Read a capture.

    Args:
        path: A file, or the folder or `meta.json` of an unpacked SOG.
        how: Options of the reader; its `progress` is replaced by the argument below.
        progress: Receives the number of splats read.

    Raises:
        FormatError: If the file cannot be opened, or is damaged or of another format.
        UnknownFormatError: If neither content nor suffix is known.
        UsageError: If the capture does not have the requested level of detail.
    """
    module = find(path)
    if how.lod and not getattr(module, "HAS_LEVELS", False):
        raise UsageError(f"{path}: level of detail", str(how.lod), "0, the only level")
    return module.read(Path(path), replace(how, progress=progress))


def find(path: str | Path) -> Format:
    """Return the format of a capture, chosen by its first bytes or its name.

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
        path: Target; an existing file is replaced once the new one is complete.
        how: Options for writing, such as the SPZ version; its `progress` is replaced by `progress`.
        progress: Receives the number of splats written.

    Returns:
        Maximum error of the written values, by field of the cloud; fields that are not listed are
        stored as floats.

    Raises:
        UnknownFormatError: If the suffix is not one of `suffixes_written()`.
        OutputError: If the target cannot be written, or a number of the cloud is not finite.
        UsageError: If the format cannot hold the cloud, or does not support what `how` requests.
    """
    path = Path(path)
    writer = _writer(path)
    check_finite(cloud, path)
    return writer.write(cloud, path, replace(how, progress=progress))


def check_finite(cloud: SplatCloud, path: str | Path) -> None:
    """Raise an error, before anything is written to `path`, for a number that is not finite.

    Raises:
        OutputError: If the cloud has one.
    """

    def check(rows: slice) -> None:
        for field in ("positions", "scales", "rotations", "opacities", "sh"):
            if not np.isfinite(getattr(cloud, field)[rows]).all():
                expected = (
                    "finite numbers; first drop splats with other values, for example with "
                    "--drop-nan"
                )
                raise OutputError(str(path), f"{field} that are not finite", expected)

    in_parallel(len(cloud), check)


def frame_written(path: str | Path) -> str:
    """Return the axes of files with the suffix of `path`, such as "rdf".

    Raises:
        UnknownFormatError: If the suffix is not one of `suffixes_written()`.
    """
    return _writer(Path(path)).FRAME


def degree_written(path: str | Path) -> int:
    """Return the highest degree of harmonics to write in the format that the suffix names.

    A format may hold more than the readers of other projects support; this is what they support.

    Raises:
        UnknownFormatError: If the suffix is not one of `suffixes_written()`.
    """
    return int(getattr(_writer(Path(path)), "MAX_DEGREE", MAX_DEGREE))


def unit_written(path: str | Path) -> float | None:
    """Return the metres per unit of files with the suffix of `path`; None if the format defines no
    unit.

    Raises:
        UnknownFormatError: If the suffix is not one of `suffixes_written()`.
    """
    return getattr(_writer(Path(path)), "METERS_PER_UNIT", None)


def suffixes_read() -> tuple[str, ...]:
    """Return the suffixes that can be read; "/name" matches a whole file name."""
    return tuple(suffix for module in FORMATS for suffix in module.SUFFIXES)


def suffixes_written() -> tuple[str, ...]:
    """Return the suffixes that can be written."""
    able = [module for module in FORMATS if hasattr(module, "write")]
    return tuple(suffix for module in able for suffix in module.SUFFIXES)


def _writer(path: Path) -> WritableFormat:
    """Return the writer for the suffix of `path`."""
    return cast(WritableFormat, _by_suffix(path, suffixes_written()))


def _by_suffix(path: Path, allowed: tuple[str, ...]) -> Format:
    """Return the format with the longest suffix that matches `path`, if `allowed` lists that
    suffix."""
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
    """Return the first bytes of a plain file, or none for a folder."""
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            return b""
        if not stat.S_ISREG(mode):  # opening a pipe may block, a device has no end
            raise FormatError(str(path), "neither file nor folder", "a capture file")
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError as error:
        found = (error.strerror or str(error)).lower()
        raise FormatError(str(path), found, "a readable capture file") from error
