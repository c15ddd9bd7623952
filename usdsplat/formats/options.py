"""Options of readers and writers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.core.progress import Progress, silent

Empty = Callable[[tuple[int, ...]], F32]
"""Function that returns an uninitialised float32 array of a shape."""

SPZ_VERSIONS = (3, 4)
"""Versions of SPZ that can be written."""


def _empty(shape: tuple[int, ...]) -> F32:
    return np.empty(shape, np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """Options for reading a capture."""

    drop_nonfinite: bool = False
    """Drop splats with a number that is not finite, instead of rejecting the file."""
    lod: int = 0
    """Level of detail to read, 0 being the finest; formats without levels have only level 0."""
    empty: Empty = _empty
    """Allocator of the cloud's arrays, for callers that provide their own memory."""
    progress: Progress = silent
    """Receives the number of splats read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WriteOptions:
    """Options for writing a capture."""

    antialiased: bool = False
    """Whether the splats are meant for the antialiased (mip) projection."""
    frame: str | None = None
    """Directions of x, y and z of the cloud (`core.axes`), for formats that can state them; None if
    unknown."""
    spz_version: int = 4
    """Version of SPZ: one of `SPZ_VERSIONS`."""
    progress: Progress = silent
    """Receives the number of splats written."""


READ_OPTIONS = ReadOptions()
"""Default options of readers."""
WRITE_OPTIONS = WriteOptions()
"""Default options of writers."""
