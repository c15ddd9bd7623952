"""Number encodings shared by several file formats and the packed schema.

Callers arrange the codes into bits. Codes are computed in float64: in float32, rounding could pick
a neighbour of the nearest code.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating[Any]]
Codes = npt.NDArray[np.integer[Any]]

SMALL_LIMIT = math.sqrt(0.5)
"""Limit of all components of a unit quaternion but the largest."""

HALF_MAX = 65504.0
"""Largest finite half-precision number; larger ones round to infinity."""


def sigmoid(x: Floats) -> Floats:
    """Return the logistic function, without overflow; keeps the dtype. -inf gives 0, +inf gives
    1."""
    small = np.exp(-np.abs(x))  # in (0, 1]: never overflows
    one = small.dtype.type(1)
    return np.where(x >= 0, one / (one + small), small / (one + small))


def logit(p: Floats) -> Floats:
    """Return the inverse of `sigmoid`; keeps the dtype. 0 gives -inf and 1 gives +inf, both
    legal."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(p) - np.log1p(-p)


def quantize(values: Floats, lower: Any, upper: Any, top: int) -> npt.NDArray[np.uint32]:
    """Return the nearest of codes 0..top, evenly spaced on [lower, upper]; clamps values outside.

    Args:
        values: Any shape, no NaN.
        lower: Value of code 0; broadcasts against `values`.
        upper: Value of code `top`; where it equals `lower`, the code is 0.
        top: Highest code: `2**bits - 1` uses all codes of `bits` bits; an even number gives the
            middle of the interval an exact code.
    """
    low = np.asarray(lower, np.float64)
    span = np.asarray(upper, np.float64) - low
    with np.errstate(divide="ignore"):
        slope = np.where(span > 0, top / span, 0.0)
    codes = np.rint((values.astype(np.float64) - low) * slope)
    return np.clip(codes, 0, top, out=codes).astype(np.uint32)


def dequantize(codes: Codes, lower: Any, upper: Any, top: int) -> npt.NDArray[np.float32]:
    """Return values of codes 0..top over [lower, upper]; exact at both ends."""
    t = codes.astype(np.float64) / top
    values = np.asarray(lower, np.float64) * (1.0 - t) + np.asarray(upper, np.float64) * t
    return values.astype(np.float32)


def split_largest(quaternions: Floats) -> tuple[npt.NDArray[np.uint8], Floats]:
    """Reduce unit quaternions to the three components that are smallest in magnitude.

    Args:
        quaternions: Unit quaternions in any component order, shape (n, 4).

    Returns:
        Index of the omitted component, the first of equals, shape (n,); the others in order, with
        the sign for which the omitted one is positive, shape (n, 3), in +-`SMALL_LIMIT`.
    """
    parts = np.ascontiguousarray(quaternions.T)
    size = np.abs(parts)
    # Comparing whole columns is twice as fast as argmax and indexing by rows.
    second, fourth = size[1] > size[0], size[3] > size[2]
    upper = np.maximum(size[2], size[3]) > np.maximum(size[0], size[1])
    largest = np.where(upper, fourth + np.uint8(2), second.view(np.uint8))
    lower_part, upper_part = (
        _select(second, parts[1], parts[0]),
        _select(fourth, parts[3], parts[2]),
    )
    sign = np.copysign(quaternions.dtype.type(1), _select(upper, upper_part, lower_part))
    rest = np.empty((len(quaternions), 3), quaternions.dtype)
    for column in range(3):  # components after the omitted one move up
        other = _select(largest > column, parts[column], parts[column + 1])
        np.multiply(other, sign, out=rest[:, column])
    return largest, rest


def join_largest(largest: Codes, rest: Floats) -> npt.NDArray[np.float32]:
    """Undo `split_largest`: return unit quaternions, shape (n, 4), in the original component order.

    Rows whose three components have a length above 1, which no encoder writes, are normalised.
    Computed in the dtype of `rest`.
    """
    a, b, c = small = np.array(rest.T, order="C")
    squared = a * a + b * b + c * c
    if np.any(squared > 1):
        small /= np.sqrt(np.maximum(squared, 1))
    missing = np.sqrt(np.maximum(1 - squared, 0))
    whole = np.empty((len(rest), 4), np.float32)
    whole[:, 0] = _select(largest == 0, missing, a)
    whole[:, 1] = _select(largest == 1, missing, _select(largest < 1, a, b))
    whole[:, 2] = _select(largest == 2, missing, _select(largest < 2, b, c))
    whole[:, 3] = _select(largest == 3, missing, c)
    return whole


def encode_smallest_three(
    quaternions: Floats, *, top: int, limit: float = SMALL_LIMIT
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint32]]:
    """Encode unit quaternions as the index of the largest component and codes of the others.

    Args:
        quaternions: Unit quaternions in any component order, shape (n, 4).
        top: Highest code; components -limit..+limit become 0..top.
        limit: Magnitude represented by codes 0 and `top`.

    Returns:
        Index, shape (n,), and codes, shape (n, 3). The error of the decoded rotation is at most 4
        sqrt(3) limit / top radians: 0.27 degrees with 10 bits a component, 0.0086 with 15.
    """
    largest, rest = split_largest(quaternions)
    return largest, quantize(rest, -limit, limit, top)


def decode_smallest_three(
    largest: Codes, codes: Codes, *, top: int, limit: float = SMALL_LIMIT
) -> npt.NDArray[np.float32]:
    """Undo `encode_smallest_three`: return unit quaternions, shape (n, 4)."""
    span = 2.0 * limit / top
    return join_largest(largest, codes.astype(np.float64) * span - limit)


def _select(condition: npt.NDArray[np.bool_], a: Floats, b: Floats) -> Floats:
    """Return `np.where` of floats of one dtype, computed on bits to avoid branch mispredictions."""
    bits = np.dtype(f"u{a.dtype.itemsize}")
    mask = np.negative(condition.astype(bits))  # all ones where true
    ones, zeros = a.view(bits), b.view(bits)
    return (zeros ^ (ones ^ zeros) & mask).view(a.dtype)
