"""What a caller may ask of a reader or a writer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.core.progress import Progress, silent

Empty = Callable[[tuple[int, ...]], F32]
"""Gives an array of a shape whose values are about to be written."""

SPZ_VERSIONS = (3, 4)
"""Of SPZ that can be written."""


def _empty(shape: tuple[int, ...]) -> F32:
    return np.empty(shape, np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """How a capture is read."""

    drop_nonfinite: bool = False
    """Leave out splats with a number that is not finite instead of refusing the file."""
    lod: int = 0
    """Level of a capture that has several, 0 the finest; others have no further level."""
    empty: Empty = _empty
    """Where the arrays of the cloud come from: a caller may want them in memory of its own."""
    progress: Progress = silent
    """Told how many splats are read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WriteOptions:
    """How a capture is written."""

    antialiased: bool = False
    """Whether the splats are meant for the antialiased (mip) projection."""
    frame: str | None = None
    """Where x, y and z of the cloud point (`core.axes`), for formats that can say so; None if that
    is not known."""
    spz_version: int = 4
    """Version of SPZ: one of `SPZ_VERSIONS`."""
    progress: Progress = silent
    """Told how many splats are written."""


READ_OPTIONS = ReadOptions()
"""As readers read unless they are told otherwise."""
WRITE_OPTIONS = WriteOptions()
"""As writers write unless they are told otherwise."""
