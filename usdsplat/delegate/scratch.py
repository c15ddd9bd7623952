"""Buffers that live from picture to picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt


class Scratch:
    """Named buffers that grow and never shrink: a frame allocates nothing that the last one had."""

    def __init__(self, empty: Callable[[int, Any], npt.NDArray[Any]]) -> None:
        self._empty = empty
        self._buffers: dict[str, npt.NDArray[Any]] = {}

    def get(self, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """The buffer `name` as an array of this shape; what it holds is undefined."""
        size = math.prod(shape)
        buffer = self._buffers.get(name)
        if buffer is None or buffer.size < size or buffer.dtype != np.dtype(dtype):
            self._buffers.pop(name, None)
            buffer = self._buffers[name] = self._empty(size, dtype)
        return buffer[:size].reshape(shape)
