"""Read attributes as checked NumPy arrays: on a stage, a value may have any type."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Usd

from usdsplat.core.cloud import F32, I32
from usdsplat.core.errors import StageError


def value(attribute: Usd.Attribute, time: Usd.TimeCode) -> Any:
    """Return the value of an attribute; at the default time the first sample if it has only
    samples."""
    if not attribute:
        return None
    found = attribute.Get(time)
    if found is None and time.IsDefault():
        found = attribute.Get(Usd.TimeCode.EarliestTime())
    return found


def vectors(where: str, found: Any, width: int) -> F32:
    """Return a new array of vectors, shape (n, width); scalars count as vectors of width 1.

    None gives an empty array.

    Raises:
        StageError: If it is something else, or not finite in single precision.
    """
    if found is None:
        return np.empty((0, width), np.float32)
    expected = f"an array of {width} numbers each" if width > 1 else "an array of numbers"
    array = _array(where, found, expected)
    if array.size == 0:
        return np.empty((0, width), np.float32)
    if array.reshape(len(array), -1).shape[1] != width or array.ndim > 2:
        raise StageError(where, f"an array of shape {array.shape}", expected)
    with np.errstate(over="ignore"):
        numbers = array.reshape(-1, width).astype(np.float32)
    if not np.isfinite(numbers).all():
        raise StageError(where, "numbers that are not finite", "finite ones")
    return numbers


def integers(where: str, found: Any) -> I32:
    """Return an array of integers, shape (n,); empty for None.

    Raises:
        StageError: If it is something else.
    """
    if found is None:
        return np.empty(0, np.int32)
    array = _array(where, found, "an array of integers")
    if array.size == 0:
        return np.empty(0, np.int32)
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise StageError(where, f"an array of {array.dtype}", "an array of integers")
    numbers = array.astype(np.int32)
    wrong = array[numbers != array]
    if len(wrong):
        raise StageError(where, f"the number {wrong[0]}", "one of 32 bits")
    return numbers


def _array(where: str, found: Any, expected: str) -> npt.NDArray[Any]:
    try:
        array = np.asarray(found)
    except (TypeError, ValueError):
        raise StageError(where, f"a value of type {type(found).__name__}", expected) from None
    if array.ndim == 0 or array.dtype.kind not in "iuf":
        raise StageError(where, f"a value of type {type(found).__name__}", expected)
    return array
