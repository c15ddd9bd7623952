"""Number encodings that several file formats and the packed schema share.

Nothing here knows a layout: callers put codes into bits. Coding is done in float64, so that a code
is the nearest one and not the neighbour that float32 rounding prefers.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating[Any]]
Codes = npt.NDArray[np.integer[Any]]

SMALL_LIMIT = math.sqrt(0.5)
"""No component of a unit quaternion but the largest exceeds this."""

HALF_MAX = 65504.0
"""Largest finite number of half precision; what rounds to more becomes infinite."""


def sigmoid(x: Floats) -> Floats:
    """Logistic function, without overflow; keeps the dtype. -inf gives 0 and +inf gives 1."""
    small = np.exp(-np.abs(x))  # in (0, 1]: never overflows
    one = small.dtype.type(1)
    return np.where(x >= 0, one / (one + small), small / (one + small))


def logit(p: Floats) -> Floats:
    """Inverse of `sigmoid`; keeps the dtype. 0 gives -inf and 1 gives +inf, both legal."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(p) - np.log1p(-p)


def quantize(values: Floats, lower: Any, upper: Any, top: int) -> npt.NDArray[np.uint32]:
    """Nearest of the codes 0..top that divide [lower, upper] evenly; values outside are clamped.

    Args:
        values: Any shape, no NaN.
        lower: Value of code 0; broadcasts against `values`.
        upper: Value of code `top`; where it equals `lower` the code is 0.
        top: Highest code, `2**bits - 1` to use all of `bits` bits; an even one gives the middle of
            the interval a code of its own.
    """
    low = np.asarray(lower, np.float64)
    span = np.asarray(upper, np.float64) - low
    with np.errstate(divide="ignore"):
        slope = np.where(span > 0, top / span, 0.0)
    codes = np.rint((values.astype(np.float64) - low) * slope)
    return np.clip(codes, 0, top, out=codes).astype(np.uint32)


def dequantize(codes: Codes, lower: Any, upper: Any, top: int) -> npt.NDArray[np.float32]:
    """Values of codes 0..top over [lower, upper]; exact at both ends."""
    t = codes.astype(np.float64) / top
    values = np.asarray(lower, np.float64) * (1.0 - t) + np.asarray(upper, np.float64) * t
    return values.astype(np.float32)


def split_largest(quaternions: Floats) -> tuple[npt.NDArray[np.uint8], Floats]:
    """Reduce unit quaternions to the three components that are smallest in magnitude.

    Args:
        quaternions: Unit quaternions in any component order, shape (n, 4).

    Returns:
        Index of the component left out, the first of equals, shape (n,); the others in their order,
        with the sign under which the one left out is positive, shape (n, 3), in +-`SMALL_LIMIT`.
    """
    parts = np.ascontiguousarray(quaternions.T)
    size = np.abs(parts)
    # Whole columns are compared: argmax and indexing by rows take twice as long.
    second, fourth = size[1] > size[0], size[3] > size[2]
    upper = np.maximum(size[2], size[3]) > np.maximum(size[0], size[1])
    largest = np.where(upper, fourth + np.uint8(2), second.view(np.uint8))
    lower_part, upper_part = (
        _select(second, parts[1], parts[0]),
        _select(fourth, parts[3], parts[2]),
    )
    sign = np.copysign(quaternions.dtype.type(1), _select(upper, upper_part, lower_part))
    rest = np.empty((len(quaternions), 3), quaternions.dtype)
    for column in range(3):  # what stands behind the one left out moves up
        other = _select(largest > column, parts[column], parts[column + 1])
        np.multiply(other, sign, out=rest[:, column])
    return largest, rest


def join_largest(largest: Codes, rest: Floats) -> npt.NDArray[np.float32]:
    """Undo `split_largest`: unit quaternions in the component order that was split, shape (n, 4).

    Rows whose three components are longer than 1, which no encoder writes, are scaled to length 1.
    Computed in the type of `rest`.
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
    """Code unit quaternions by index of the largest component and codes of the three others.

    Args:
        quaternions: Unit quaternions in any component order, shape (n, 4).
        top: Highest code; components -limit..+limit become 0..top.
        limit: Magnitude that the outermost codes stand for.

    Returns:
        Index, shape (n,), and codes, shape (n, 3). The rotation that comes back is off by at most
        4 sqrt(3) limit / top radians: 0.27 degrees with 10 bits a component, 0.0086 with 15.
    """
    largest, rest = split_largest(quaternions)
    return largest, quantize(rest, -limit, limit, top)


def decode_smallest_three(
    largest: Codes, codes: Codes, *, top: int, limit: float = SMALL_LIMIT
) -> npt.NDArray[np.float32]:
    """Undo `encode_smallest_three`: unit quaternions, shape (n, 4)."""
    span = 2.0 * limit / top
    return join_largest(largest, codes.astype(np.float64) * span - limit)


def _select(condition: npt.NDArray[np.bool_], a: Floats, b: Floats) -> Floats:
    """`np.where` of floats of one type, by their bits: it has no branches to guess wrongly."""
    bits = np.dtype(f"u{a.dtype.itemsize}")
    mask = np.negative(condition.astype(bits))  # of ones where true
    ones, zeros = a.view(bits), b.view(bits)
    return (zeros ^ (ones ^ zeros) & mask).view(a.dtype)
