"""Convert a finished picture from one colour space to another."""

from __future__ import annotations

import numpy as np

from .color import convert
from .launch import kernel

# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="image", writes=("image",), axes=2)
def recolor(y, x, image, conversion):
    """Unpremultiply, convert and premultiply again, in place.

    Args:
        image: Premultiplied RGBA, shape (h, w, 4) f32; pixels with A = 0 are skipped. Or RGB, shape
            (h, w, 3), as if A were 1.
        conversion: 13 numbers, see `color`.
    """
    alpha = image[y, x, 3] if image.shape[2] > 3 else np.float32(1)
    if alpha > np.float32(0):
        r, g, b = convert(
            image[y, x, 0] / alpha,
            image[y, x, 1] / alpha,
            image[y, x, 2] / alpha,
            conversion,
        )
        image[y, x, 0], image[y, x, 1], image[y, x, 2] = r * alpha, g * alpha, b * alpha
