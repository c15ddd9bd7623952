"""NumPy arrays to Vt arrays and back, at the speed of memory.

Reading is free: NumPy sees a Vt array in place. Writing through Vt's own `FromNumpy` converts one
vector after the other (10 ms for a million float3); assigning into the memory of a fresh Vt array
takes 3 ms, and converts to half or reorders quaternions on the way. Nothing is copied of what was
written into the memory of a Vt array to begin with: `empty` lends it. Our quaternions are
(w, x, y, z), Vt's memory holds (x, y, z, w): the exchange happens here and nowhere else.
"""

from __future__ import annotations

import ctypes
import math
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Vt

from usdsplat.core.cloud import F32

Array = npt.NDArray[Any]

_QUATERNIONS = (Vt.QuatfArray, Vt.QuathArray)
_FROM_VT = [3, 0, 1, 2]
_LENT: dict[tuple[type, int], Any] = {
    (np.float32, 1): Vt.FloatArray,
    (np.float32, 3): Vt.Vec3fArray,
    (np.int32, 4): Vt.Vec4iArray,
}
"""Type of the numbers, and how many of them are in a row -> what has memory for them."""


class _Lender:
    """A Vt array whose memory NumPy arrays have; each of them keeps it alive as their base."""

    __slots__ = ("__array_interface__", "value")

    def __init__(self, value: Any, shape: tuple[int, ...]) -> None:
        self.value = value
        memory = np.asarray(value)
        self.__array_interface__ = {
            "version": 3,
            "shape": shape,
            "typestr": memory.dtype.str,
            "data": (memory.ctypes.data, False),
        }


def empty(shape: tuple[int, ...], dtype: type = np.float32) -> Array:
    """An array to be filled, and given to `to_vt` without a copy where it can be.

    Args:
        shape: Real (n,) and (n, ..., 3) and whole (n, 4) get the memory of Vt arrays of scalars and
            vectors; others, such as quaternions, that of NumPy.
        dtype: `np.float32` or `np.int32`.
    """
    kind = _LENT.get((dtype, shape[-1] if len(shape) > 1 else 1))
    if kind is None or not math.prod(shape):
        return np.empty(shape, dtype)
    rows = math.prod(shape[:-1]) if len(shape) > 1 else shape[0]
    return np.asarray(_Lender(kind(rows), shape))


def to_vt(array: Array, kind: type) -> Any:
    """A NumPy array as a Vt array: its own, if `empty` made it and it is whole, else a copy.

    What is not copied belongs to USD from then on, and becomes read-only.

    Args:
        array: Shape (n, ...) as `kind` has it: (n,) for scalars, (n, 3) for vectors, (n, 4) in the
            order (w, x, y, z) for quaternions. Any dtype that NumPy converts "same_kind".
        kind: A Vt array class such as `Vt.Vec3fArray`.

    Raises:
        ValueError: If the shape does not fit.
        TypeError: If the numbers cannot be converted, such as real ones to integers.
    """
    lent = _lent(array, kind)
    if lent is not None:
        return lent
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


def _lent(array: Array, kind: type) -> Any:
    """The Vt array whose memory `array` is, all of it and in its order; None if there is none."""
    chain: list[Array] = []
    base: Any = array
    while isinstance(base, np.ndarray):
        chain.append(base)
        base = base.base
    if not isinstance(base, _Lender) or type(base.value) is not kind:
        return None
    whole = np.asarray(base.value)
    is_whole = array.shape == whole.shape and array.flags.c_contiguous
    if not is_whole or array.ctypes.data != whole.ctypes.data or array.dtype != whole.dtype:
        return None
    for each in chain:
        each.flags.writeable = False
    return base.value


def _writable(fresh: Any) -> Array:
    """The memory of a Vt array for writing; only of one that nobody else holds yet."""
    view = np.asarray(fresh)
    if not view.size:
        return np.empty_like(view)
    raw = (ctypes.c_byte * view.nbytes).from_address(view.ctypes.data)
    return np.ctypeslib.as_array(raw).view(view.dtype).reshape(view.shape)
