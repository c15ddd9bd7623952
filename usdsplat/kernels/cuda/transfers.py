"""Copies between the host and a GPU, through pinned memory.

From pageable memory the driver copies at a fifth of the speed of the bus. Pinned memory is slow to
allocate, so it is used again.
"""

from __future__ import annotations

import math
import threading
import weakref
from collections import deque
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import cuda

from usdsplat.kernels.cuda.arrays import GpuArray
from usdsplat.kernels.cuda.support import is_compiled

if is_compiled():
    from numba.cuda.cudadrv.driver import host_to_device

LEAST = 1 << 16
"""[byte] Of an array that is fetched into pinned memory; smaller ones are not worth it."""
STEP = 1 << 20
"""[byte] Sizes of pinned buffers are multiples of this."""
IDLE = 1 << 30
"""[byte] Of pinned buffers that are kept for later."""
RING = 1 << 22
"""[byte] Of small arrays on their way in."""
SMALL = 1 << 16
"""[byte] Of the largest of those."""
CONSTANT, CONSTANTS = 2048, 256
"""[byte] Of the largest array that is looked up by what it holds, and how many are kept."""
BLOCK = 1 << 16
"""[byte] Of the memory that such arrays share; it is released with the last of them."""
ALIGNED = 256
"""[byte] What each begins on."""


class _Lease:
    """A part of a pinned buffer as NumPy takes one; the buffer is idle again when it is gone."""

    def __init__(self, buffer: Any, nbytes: int, idle: PinnedPool) -> None:
        self.__array_interface__ = {
            "version": 3,
            "typestr": "|u1",
            "shape": (nbytes,),
            "data": (buffer.ctypes.data, False),
        }
        weakref.finalize(self, idle.give, buffer)


class PinnedPool:
    """Pinned memory for arrays that come from a GPU."""

    def __init__(self) -> None:
        self._idle: deque[Any] = deque()

    def take(self, shape: tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
        """Return an array with undefined contents. Its memory is used again once nothing refers to
        it or to a part of it."""
        nbytes = math.prod(shape) * np.dtype(dtype).itemsize
        if nbytes < LEAST:
            return np.empty(shape, dtype)
        return np.asarray(_Lease(self._fitting(nbytes), nbytes, self)).view(dtype).reshape(shape)

    def give(self, buffer: Any) -> None:
        """Keep a buffer for later; the oldest go where there are too many."""
        self._idle.append(buffer)
        while sum(each.nbytes for each in list(self._idle)) > IDLE:
            self._idle.popleft()

    def clear(self) -> None:
        """Release what is idle."""
        self._idle.clear()

    def _fitting(self, nbytes: int) -> Any:
        """A buffer that holds so much, but not twice as much and more."""
        for _ in range(len(self._idle)):
            try:
                buffer = self._idle.popleft()
            except IndexError:  # another thread took it
                break
            if nbytes <= buffer.nbytes <= 2 * nbytes + STEP:
                return buffer
            self._idle.append(buffer)
        return cuda.pinned_array(-(-nbytes // STEP) * STEP, np.uint8)


class Ring:
    """Small arrays on their way to a GPU: no allocation, and nobody waits.

    One thread of the host uses it. What was put in is there for what is launched on the stream
    until RING bytes more were put in.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self._here = cuda.pinned_array(RING, np.uint8)
        self._there = cuda.device_array(RING, np.uint8, stream=stream)
        self._next = 0

    def put(self, array: npt.NDArray[Any]) -> Any:
        """Return a copy on the GPU of a contiguous array of at most SMALL bytes."""
        nbytes = array.nbytes
        if self._next + nbytes > RING:
            self._stream.synchronize()  # all that was put in has been used
            self._next = 0
        first, end = self._next, self._next + nbytes
        self._next = -(-end // ALIGNED) * ALIGNED
        here = self._here[first:end]
        here[...] = array.reshape(-1).view(np.uint8)
        return _copied(array, here, self._there, first, self._stream)


class Constants:
    """Small arrays that kernels only read, on a GPU by what they hold: a camera's numbers, the grid
    of tiles, nothing at all. Most are the same for several launches, and for many pictures."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self._known: dict[tuple[Any, ...], Any] = {}
        self._block: Any = None
        self._next = 0
        self._adding = threading.Lock()

    def get(self, array: npt.NDArray[Any]) -> Any:
        """Return a copy on the GPU of a contiguous array of at most CONSTANT bytes."""
        key = array.tobytes(), array.shape, array.dtype
        found = self._known.get(key)
        if found is None:
            with self._adding:
                found = self._known[key] = self._copy(array)
        return found

    def _copy(self, array: npt.NDArray[Any]) -> Any:
        if len(self._known) >= CONSTANTS:
            self._known = {}
        if self._block is None or self._next + array.nbytes > BLOCK:
            self._block = cuda.device_array(BLOCK, np.uint8, stream=self._stream)
            self._next = 0
        first = self._next
        self._next = -(-(first + array.nbytes) // ALIGNED) * ALIGNED
        return _copied(array, array, self._block, first, self._stream)

    def clear(self) -> None:
        """Release them; those that somebody holds stay."""
        with self._adding:
            self._known, self._block = {}, None


class Rings:
    """A ring for each thread of the host."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self._of: dict[int, Ring] = {}

    def put(self, array: npt.NDArray[Any]) -> Any:
        """As `Ring.put`."""
        thread = threading.get_ident()
        if thread not in self._of:
            self._of[thread] = Ring(self._stream)
        return self._of[thread].put(array)

    def clear(self) -> None:
        """Release them."""
        self._of.clear()


# --- private -------------------------------------------------------------------------------


def _copied(
    like: npt.NDArray[Any], source: npt.NDArray[Any], memory: Any, first: int, stream: Any
) -> Any:
    """The bytes of `source` at byte `first` of a GPU's memory, as an array like `like`."""
    part = memory.gpu_data.view(first, first + like.nbytes)
    # NumPy gives an axis of length 1 any stride, by which numba-cuda would type the array
    strides = np.empty(like.shape, np.uint8).strides
    strides = tuple(like.dtype.itemsize * each for each in strides)
    there = GpuArray(like.shape, strides, like.dtype, stream, part)
    if like.nbytes:
        host_to_device(there, source, like.nbytes, stream)
    return there
