"""Render buffers: AOVs in memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Pixels = npt.NDArray[Any]


class RenderBuffer:
    """Buffer of one AOV of a picture, written band by band.

    Hydra's Bprim, with one difference: a complete allocation is never written again, so a mapped
    picture stays unchanged when the next one is drawn.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._pixels: Pixels | None = None

    def allocate(self, shape: tuple[int, ...], dtype: npt.DTypeLike) -> None:
        """Allocate a new picture; `shape` is (height, width) or (height, width, channels)."""
        self._pixels = np.empty(shape, dtype)

    def write(self, row: int, band: Pixels) -> None:
        """Store the rows of `band` from `row` on, counted from the top of the data window."""
        assert self._pixels is not None, "allocate comes first"
        self._pixels[row : row + len(band)] = band

    def map(self) -> Pixels:
        """Return the picture, read-only and without a copy, top row first."""
        assert self._pixels is not None, "allocate comes first"
        view = self._pixels.view()
        view.flags.writeable = False
        return view

    def deallocate(self) -> None:
        """Free the memory."""
        self._pixels = None
