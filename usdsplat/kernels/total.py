"""Sums of pictures."""

from __future__ import annotations

import numpy as np
from numba import prange

from .jit import parallel

# --- 2. CPU ----------------------------------------------------------------------------


@parallel
def clear(total):
    """Begin with nothing; shape (h, w, n) f32."""
    for y in prange(total.shape[0]):
        for x in range(total.shape[1]):
            for c in range(total.shape[2]):
                total[y, x, c] = np.float32(0)


@parallel
def add(total, image):
    """Add the first n channels of a picture, shape (h, w, >= n) f32, to a sum of n, in place."""
    for y in prange(total.shape[0]):
        for x in range(total.shape[1]):
            for c in range(total.shape[2]):
                total[y, x, c] += image[y, x, c]


@parallel
def scale(total, factor):
    """Multiply a sum by a number, f32, in place."""
    for y in prange(total.shape[0]):
        for x in range(total.shape[1]):
            for c in range(total.shape[2]):
                total[y, x, c] *= factor
