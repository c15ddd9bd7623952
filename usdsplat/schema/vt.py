"""NumPy arrays to Vt arrays and back, at the speed of memory.

Reading is free: NumPy sees a Vt array in place. Writing through Vt's own `FromNumpy` converts one
vector after the other (10 ms for a million float3); assigning into the memory of a fresh Vt array
takes 3 ms, and converts to half or reorders quaternions on the way. Our quaternions are
(w, x, y, z), Vt's memory holds (x, y, z, w): the exchange happens here and nowhere else.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Vt

from usdsplat.core.cloud import F32

Array = npt.NDArray[Any]

_QUATERNIONS = (Vt.QuatfArray, Vt.QuathArray)
_FROM_VT = [3, 0, 1, 2]


def to_vt(array: Array, kind: type) -> Any:
    """Copy a NumPy array into a new Vt array, converting its numbers.

    Args:
        array: Shape (n, ...) as `kind` has it: (n,) for scalars, (n, 3) for vectors, (n, 4) in the
            order (w, x, y, z) for quaternions. Any dtype that NumPy converts "same_kind".
        kind: A Vt array class such as `Vt.Vec3fArray`.

    Raises:
        ValueError: If the shape does not fit.
        TypeError: If the numbers cannot be converted, such as real ones to integers.
    """
    result = kind(len(array))
    memory = _writable(result)
    if memory.shape != array.shape:
        raise ValueError(f"{kind.__name__}: found shape {array.shape}, expected {memory.shape}")
    if issubclass(kind, _QUATERNIONS):
        memory[:, 0:3] = array[:, 1:4]
        memory[:, 3] = array[:, 0]
    else:
        np.copyto(memory, array, casting="same_kind")
    return result


def from_vt(value: Any) -> Array:
    """A Vt array as NumPy sees it: in place and read-only, except that quaternions are reordered.

    Returns:
        The array with its own dtype; quaternions as (w, x, y, z), shape (n, 4), in a new array.
    """
    array = np.asarray(value)
    # Not array[:, _FROM_VT]: that puts columns after one another, and kernels would copy it back.
    return np.take(array, _FROM_VT, axis=1) if isinstance(value, _QUATERNIONS) else array


def as_float32(array: Array) -> F32:
    """The same numbers in float32, row after row; no copy when they are so already."""
    return np.ascontiguousarray(array, np.float32)


def _writable(fresh: Any) -> Array:
    """The memory of a Vt array for writing; only of one that nobody else holds yet."""
    view = np.asarray(fresh)
    if not view.size:
        return np.empty_like(view)
    raw = (ctypes.c_byte * view.nbytes).from_address(view.ctypes.data)
    return np.ctypeslib.as_array(raw).view(view.dtype).reshape(view.shape)
