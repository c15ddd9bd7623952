"""Convert NumPy arrays to Vt arrays and back, without or with fast copies.

Reading needs no copy: NumPy views a Vt array in place. Writing with Vt's own `FromNumpy` converts
one vector at a time (10 ms for a million float3). Copying into the memory of a new Vt array takes 3
ms, and can convert to half or reorder quaternions. No copy is needed if the values were written
into the memory of a Vt array in the first place, which `empty` provides. Our quaternions are (w, x,
y, z), those in Vt's memory (x, y, z, w): only this module converts between the two.
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
ALL_ROWS = slice(None)
_LENT: dict[tuple[type, int], Any] = {
    (np.float32, 1): Vt.FloatArray,
    (np.float32, 3): Vt.Vec3fArray,
    (np.int32, 4): Vt.Vec4iArray,
}
"""(dtype, length of a row) -> Vt array class with memory of that layout."""


class _Lender:
    """A Vt array that owns the memory of NumPy arrays, which keep it alive as their base."""

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
    """Return an uninitialised array that `to_vt` can convert without a copy where possible.

    Args:
        shape: float32 of shape (n,) or (n, ..., 3) and int32 of shape (n, 4) use the memory of Vt
            arrays; others, such as quaternions, that of NumPy.
        dtype: `np.float32` or `np.int32`.
    """
    kind = _LENT.get((dtype, shape[-1] if len(shape) > 1 else 1))
    if kind is None or not math.prod(shape):
        return np.empty(shape, dtype)
    rows = math.prod(shape[:-1]) if len(shape) > 1 else shape[0]
    return np.asarray(_Lender(kind(rows), shape))


def to_vt(array: Array, kind: type) -> Any:
    """Return a NumPy array as a Vt array, without a copy if `empty` made it and it is complete.

    Without a copy, USD shares the memory from then on and the array becomes read-only.

    Args:
        array: Shape (n, ...) to match `kind`: (n,) for scalars, (n, 3) for vectors, (n, 4) in the
            order (w, x, y, z) for quaternions. Any dtype that NumPy converts by "same_kind".
        kind: A Vt array class such as `Vt.Vec3fArray`.

    Raises:
        ValueError: If the shape does not match.
        TypeError: If the numbers cannot be converted, such as float to integers.
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


def from_vt(value: Any, rows: slice = ALL_ROWS) -> Array:
    """View a Vt array as a NumPy array, read-only; quaternions are reordered into a copy.

    Args:
        value: A Vt array.
        rows: The rows to return; others are not touched.

    Returns:
        The rows with their own dtype; quaternions as (w, x, y, z), shape (n, 4), in a new array.
    """
    array = np.asarray(value)[rows]
    # array[:, _FROM_VT] would give column-major memory, which kernels would have to copy back.
    return np.take(array, _FROM_VT, axis=1) if isinstance(value, _QUATERNIONS) else array


def as_float32(array: Array) -> F32:
    """Return the numbers as C-contiguous float32; no copy if they already are."""
    return np.ascontiguousarray(array, np.float32)


def _lent(array: Array, kind: type) -> Any:
    """Return the Vt array whose complete memory `array` is, in order, or None."""
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
    """Return the writable memory of a Vt array that is not shared yet."""
    view = np.asarray(fresh)
    if not view.size:
        return np.empty_like(view)
    raw = (ctypes.c_byte * view.nbytes).from_address(view.ctypes.data)
    return np.ctypeslib.as_array(raw).view(view.dtype).reshape(view.shape)
