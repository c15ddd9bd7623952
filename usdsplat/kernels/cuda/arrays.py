"""GPU arrays with cached views: numba-cuda takes 25 µs for each view, and a frame needs many."""

from __future__ import annotations

from typing import Any

import numpy as np

from usdsplat.kernels.cuda.support import is_compiled

VIEWS = 64
"""Maximum number of cached views of one array."""


def _base() -> Any:
    if not is_compiled():
        return object
    from numba.cuda.cudadrv.devicearray import DeviceNDArray

    return DeviceNDArray


_Base: Any = _base()


class GpuArray(_Base):
    """numba-cuda's array with cached views: slices, rows, other shapes and types.

    A view holds the memory, not the array that it was made of, so there is no cycle.
    """

    def __getitem__(self, item: Any) -> Any:
        """Return a view of a slice or a row. A single number is copied to the host, which waits for
        it."""
        if isinstance(item, slice):
            return self._view((item.start, item.stop, item.step), super().__getitem__, item)
        if isinstance(item, int) and self.ndim > 1:
            return self._view(item, super().__getitem__, item)
        return super().__getitem__(item)

    def reshape(self, *shape: Any) -> Any:
        """Return a view of a contiguous array in another shape, given as a tuple or as several
        numbers."""
        return self._view(("reshape", *shape), super().reshape, *shape)

    def view(self, dtype: Any) -> Any:
        """Return the same memory as another type."""
        return self._view(np.dtype(dtype), lambda: with_views(super(GpuArray, self).view(dtype)))

    def _view(self, key: Any, make: Any, *args: Any) -> Any:
        views = self.__dict__.setdefault("_views", {})
        found = views.get(key)
        if found is None:
            if len(views) >= VIEWS:
                views.clear()
            found = views[key] = make(*args)
        return found


def with_views(array: Any) -> Any:
    """Return a numba-cuda array as a GpuArray on the same memory, or a simulated array itself."""
    if not is_compiled():
        return array
    return GpuArray(array.shape, array.strides, array.dtype, array.stream, array.gpu_data)
