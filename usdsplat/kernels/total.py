"""Sum pictures."""

from __future__ import annotations

import numpy as np

from .launch import kernel

# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="total", writes=("total",), axes=2)
def clear(y, x, total):
    """Clear a sum, shape (h, w, n) f32."""
    for c in range(total.shape[2]):
        total[y, x, c] = np.float32(0)


@kernel(over="total", writes=("total",), axes=2)
def add(y, x, total, image):
    """Add the first n channels of a picture, shape (h, w, >= n) f32, to a sum of n, in place."""
    for c in range(total.shape[2]):
        total[y, x, c] += image[y, x, c]


@kernel(over="total", writes=("total",), axes=2)
def scale(y, x, total, factor):
    """Multiply a sum by a number, f32, in place."""
    for c in range(total.shape[2]):
        total[y, x, c] *= factor
