"""Render buffers: AOVs in memory."""

from __future__ import annotations

import math
import weakref
from typing import Any

import numpy as np
import numpy.typing as npt

Pixels = npt.NDArray[Any]


class RenderBuffer:
    """Buffer of one AOV of a picture, written band by band.

    Hydra's Bprim, with one difference: a complete allocation is not written again as long as
    anything refers to it, so a mapped picture stays unchanged when the next one is drawn.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._pixels: Pixels | None = None
        self._idle: npt.NDArray[np.uint8] | None = None
        """Memory of an earlier picture to which nothing refers any more."""

    def allocate(self, shape: tuple[int, ...], dtype: npt.DTypeLike) -> None:
        """Allocate a new picture; `shape` is (height, width) or (height, width, channels).

        Memory of an earlier one of the same size is used again if nothing refers to it: the system
        has to provide each page of new memory, which takes longer than writing the picture.
        """
        self._pixels = None  # perhaps the last reference
        memory, self._idle = self._idle, None
        size = math.prod(shape) * np.dtype(dtype).itemsize
        if memory is None or memory.nbytes != size:
            memory = np.empty(size, np.uint8)
        # views keep only the array that owns their memory alive: `lent`, made from a memoryview
        lent = np.frombuffer(memory.data, dtype)
        weakref.finalize(lent, self._take_back, memory).atexit = False
        self._pixels = lent.reshape(shape)

    def adopt(self, picture: Pixels) -> None:
        """Keep a whole picture without a copy. The caller must never write to its array again."""
        self._pixels, self._idle = picture, None

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
        self._pixels = self._idle = None

    def _take_back(self, memory: npt.NDArray[np.uint8]) -> None:
        self._idle = memory
