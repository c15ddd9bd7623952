"""Buffers of a device that are reused from picture to picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt


class FrameBuffers:
    """Named buffers that grow and never shrink: a frame allocates nothing that the last one had.

    Args:
        empty: Makes a buffer of so many elements: `Device.resident`, so that what one kernel writes
            the next one reads where it is. NumPy reads what `Device.fetch` brings.
    """

    def __init__(self, empty: Callable[[int, Any], Any]) -> None:
        self._empty = empty
        self._buffers: dict[str, Any] = {}
        self._views: dict[str, tuple[tuple[int, ...], Any, Any]] = {}
        """Name -> (shape, dtype, view) of the last request. Most requests are the same in every
        picture, and a new view of a GPU array takes about 25 µs."""
        self._made: dict[str, Any] = {}
        self._notes: dict[str, Any] = {}

    def get(self, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Any:
        """The buffer `name` as an array of this shape; what it holds is undefined."""
        last = self._views.get(name)
        if last is not None and last[0] == shape and last[1] == dtype:
            return last[2]
        view = self._view(name, shape, dtype)
        self._views[name] = shape, dtype, view
        return view

    def _view(self, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Any:
        size = math.prod(shape)
        if size == 0:
            return self._empty(0, dtype).reshape(shape)
        buffer = self._buffers.get(name)
        if buffer is None or buffer.size < size or buffer.dtype != np.dtype(dtype):
            for each in (self._buffers, self._views, self._notes):
                each.pop(name, None)
            buffer = self._buffers[name] = self._empty(size, dtype)
        return buffer[:size].reshape(shape)

    def made(self, name: str, make: Callable[[], Any]) -> Any:
        """What `make` made when it was first asked for: something with buffers of its own."""
        if name not in self._made:
            self._made[name] = make()
        return self._made[name]

    def note(self, name: str, what: Any) -> None:
        """Remember what buffer `name` holds, until it is another one; None for nothing known."""
        self._notes[name] = what

    def noted(self, name: str) -> Any:
        """What was noted last of a buffer; None where nothing is known."""
        return self._notes.get(name)
