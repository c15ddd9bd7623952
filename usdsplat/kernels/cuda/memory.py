"""Memory of a GPU for the arrays of one stream.

The driver takes 0.1 ms and more to allocate memory, and waits for the GPU to free it. Its pool does
both in the order of the stream, in microseconds: an array that nothing refers to is free for the
next one as soon as the work that was launched before has used it.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.cuda.arrays import GpuArray, with_views
from usdsplat.kernels.cuda.support import is_compiled

if is_compiled():
    from numba.cuda.cudadrv.driver import MemoryPointer, binding

UNUSED = 1 << 31
"""Size of unused memory that the pool may keep [byte]."""


@functools.cache
def pool() -> Any:
    """Return the pool of this process, a `cuda.core.DeviceMemoryResource`; None if the GPU has no
    pools."""
    if not is_compiled():
        return None
    from cuda.core import Device, DeviceMemoryResource, DeviceMemoryResourceOptions

    device = Device(cuda.get_current_device().id)
    if not device.properties.memory_pools_supported:
        return None
    made = DeviceMemoryResource(device, DeviceMemoryResourceOptions())
    kept = binding.CUmemPool_attribute.CU_MEMPOOL_ATTR_RELEASE_THRESHOLD
    _check(binding.cuMemPoolSetAttribute(made.handle, kept, binding.cuuint64_t(UNUSED)))
    return made


class StreamMemory:
    """Memory for arrays that are used on one stream only.

    Args:
        stream: The stream.
    """

    def __init__(self, stream: Any) -> None:
        self._stream, self._pool, self._order = stream, pool(), None
        if self._pool is not None:
            from cuda.core import Stream

            self._order = Stream.from_handle(int(stream.handle))

    def array(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        """Return a new array with undefined contents."""
        sizes = (shape,) if isinstance(shape, int) else tuple(map(int, shape))
        kind = np.dtype(dtype)
        nbytes = math.prod(sizes) * kind.itemsize
        if self._pool is None or not nbytes:
            return with_views(cuda.device_array(sizes, kind, stream=self._stream))
        context = cuda.current_context()  # of this thread, too, which may be new
        try:
            buffer = self._pool.allocate(nbytes, stream=self._order)
        except Exception as error:
            if "OUT_OF_MEMORY" not in str(error):
                raise
            context.deallocations.clear()
            self.trim()
            buffer = self._pool.allocate(nbytes, stream=self._order)
        address = binding.CUdeviceptr(int(buffer.handle))
        # a tuple is emptied from its end: memory is freed on its stream before that is
        memory = MemoryPointer(context, address, nbytes, owner=(self._stream, buffer))
        strides = (kind.itemsize * math.prod(sizes[k:]) for k in range(1, len(sizes) + 1))
        return GpuArray(sizes, tuple(strides), kind, self._stream, memory)

    def trim(self) -> None:
        """Give back what no array uses."""
        if self._pool is not None:
            self._stream.synchronize()
            _check(binding.cuMemPoolTrimTo(self._pool.handle, 0))


def _check(result: tuple[Any, ...]) -> None:
    """Raise an error for a result of the driver that is not a success."""
    if result[0] != binding.CUresult.CUDA_SUCCESS:
        raise RuntimeError(result[0].name)
