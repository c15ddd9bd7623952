"""Copy arrays between the host and a GPU, through pinned memory.

The driver copies pageable memory at a fifth of the speed of the bus. Pinned memory is slow to
allocate, so it is reused.
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
"""Minimum size of an array that is fetched into pinned memory [byte]."""
STEP = 1 << 20
"""Sizes of pinned buffers are multiples of this [byte]."""
IDLE = 1 << 30
"""Total size of pinned buffers that are kept for reuse [byte]."""
LENT = 1 << 31
"""Total size of pinned buffers that are in use [byte], as the system cannot swap them out."""
RING = 1 << 22
"""Size of a ring buffer for small arrays [byte]."""
SMALL = 1 << 16
"""Maximum size of an array in a ring buffer [byte]."""
CONSTANT, CONSTANTS = 2048, 256
"""Maximum size of an array that is cached by contents [byte], and number of cached arrays."""
BLOCK = 1 << 16
"""Size of the memory blocks that cached arrays share [byte]. A block is released with its last
array."""
ALIGNED = 256
"""Alignment of each array [byte]."""


class _Lease:
    """Part of a pinned buffer in NumPy's array interface. When it is deleted, the buffer is idle
    again."""

    def __init__(self, buffer: Any, nbytes: int, idle: PinnedPool) -> None:
        self.__array_interface__ = {
            "version": 3,
            "typestr": "|u1",
            "shape": (nbytes,),
            "data": (buffer.ctypes.data, False),
        }
        self.nbytes = int(buffer.nbytes)
        weakref.finalize(self, idle.give, buffer)


class PinnedPool:
    """Pool of pinned memory for arrays that are fetched from a GPU."""

    def __init__(self) -> None:
        self._idle: deque[Any] = deque()
        self._lent: weakref.WeakSet[_Lease] = weakref.WeakSet()

    def take(self, shape: tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
        """Return an array with undefined contents. Its memory is reused when nothing refers to it
        or to a part of it. It is not pinned if it is small, or above the limit."""
        nbytes = math.prod(shape) * np.dtype(dtype).itemsize
        if nbytes < LEAST or nbytes + sum(each.nbytes for each in list(self._lent)) > LENT:
            return np.empty(shape, dtype)
        lease = _Lease(self._fitting(nbytes), nbytes, self)
        self._lent.add(lease)
        return np.asarray(lease).view(dtype).reshape(shape)

    def give(self, buffer: Any) -> None:
        """Keep a buffer for reuse. The oldest ones are dropped above the limit."""
        self._idle.append(buffer)
        while sum(each.nbytes for each in list(self._idle)) > IDLE:
            self._idle.popleft()

    def clear(self) -> None:
        """Release the idle buffers."""
        self._idle.clear()

    def _fitting(self, nbytes: int) -> Any:
        """Return an idle buffer of at least this size, but less than twice as much."""
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
    """Ring buffer for small arrays that are copied to a GPU, without allocation or waiting.

    It is used by one host thread. A copy is valid for launches on the stream until RING more bytes
    are copied.
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
            self._stream.synchronize()  # all copies have been used
            self._next = 0
        first, end = self._next, self._next + nbytes
        self._next = -(-end // ALIGNED) * ALIGNED
        here = self._here[first:end]
        here[...] = array.reshape(-1).view(np.uint8)
        return _copied(array, here, self._there, first, self._stream)


class Constants:
    """Cache of small read-only arrays on a GPU, by contents, such as cameras and tile grids.

    Most of them are the same for several launches, and for many pictures.
    """

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
        """Release the cached arrays; those still in use are freed later."""
        with self._adding:
            self._known, self._block = {}, None


class Rings:
    """One ring for each host thread."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self._of: dict[int, Ring] = {}

    def put(self, array: npt.NDArray[Any]) -> Any:
        """Return a copy on the GPU, see `Ring.put`."""
        thread = threading.get_ident()
        if thread not in self._of:
            self._of[thread] = Ring(self._stream)
        return self._of[thread].put(array)

    def clear(self) -> None:
        """Release all rings."""
        self._of.clear()


# --- private -------------------------------------------------------------------------------


def _copied(
    like: npt.NDArray[Any], source: npt.NDArray[Any], memory: Any, first: int, stream: Any
) -> Any:
    """Copy `source` to byte `first` of a GPU's memory, and return it as an array like `like`."""
    part = memory.gpu_data.view(first, first + like.nbytes)
    # NumPy gives an axis of length 1 any stride, which would change numba-cuda's type of the array
    strides = np.empty(like.shape, np.uint8).strides
    strides = tuple(like.dtype.itemsize * each for each in strides)
    there = GpuArray(like.shape, strides, like.dtype, stream, part)
    if like.nbytes:
        host_to_device(there, source, like.nbytes, stream)
    return there
