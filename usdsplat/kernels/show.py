"""Convert premultiplied pictures for display: curve or lattice, background, 8 bits.

Colours are unpremultiplied for the view transform, and composited over the background in display
code values, as splats are composited over each other. Curves are tables over the square root of
their argument, so that they are finer in dark tones.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from .jit import parallel, scalar

ALL, RED, GREEN, BLUE, ALPHA = range(5)
"""Channels that can be shown."""


# --- 1. mathematics: one pixel ---------------------------------------------------------


@scalar
def along(table, x, inverse_top):
    """Return the table entry nearest to x; entry i of n is at (i / (n - 1))² / inverse_top."""
    part = min(max(x * inverse_top, np.float32(0)), np.float32(1))
    at = np.float32(math.sqrt(part)) * np.float32(table.shape[0] - 1) + np.float32(0.5)
    return table[np.uint32(at)]


@scalar
def mixed(cube, c, i, j, k, u, v, w):
    """Interpolate channel c in the cell (i, j, k) of a lattice, at (u, v, w) of the way to its far
    corner."""
    a = cube[i, j, k, c] + (cube[i, j, k + 1, c] - cube[i, j, k, c]) * w
    b = cube[i, j + 1, k, c] + (cube[i, j + 1, k + 1, c] - cube[i, j + 1, k, c]) * w
    d = cube[i + 1, j, k, c] + (cube[i + 1, j, k + 1, c] - cube[i + 1, j, k, c]) * w
    e = cube[i + 1, j + 1, k, c] + (cube[i + 1, j + 1, k + 1, c] - cube[i + 1, j + 1, k, c]) * w
    near, far = a + (b - a) * v, d + (e - d) * v
    return near + (far - near) * u


@scalar
def byte(value):
    """Return the nearest of 256 steps, halves up; NaN is black."""
    level = value * np.float32(255) + np.float32(0.5)
    return np.uint8(np.int32(min(max(level, np.float32(0)), np.float32(255))))


# --- 2. CPU ----------------------------------------------------------------------------


@parallel(writes=("out",))
def show(
    image, matrix, shaper, shaper_scale, cube, table, table_scale, channel, backs, square, out
):
    """Fill `out` with display values.

    Args:
        image: Premultiplied RGBA, shape (h, w, 4) f32.
        matrix: Applied to straight RGB, shape (3, 3) f32; empty for none.
        shaper, shaper_scale: Curve from there to lattice coordinates [0..1].
        cube: Lattice of RGB, shape (n, n, n, 3) f32; empty for none.
        table, table_scale: Last curve, to code values; empty for none.
        channel: One of ALL, RED, GREEN, BLUE, ALPHA; single channels are over black.
        backs: Greys of the background [0..1], shape (2, w) f32: two kinds of rows, which alternate.
        square: Number of successive rows of one kind.
        out: Receives RGB, shape (h, w, 3) u8.
    """
    height, width = image.shape[0], image.shape[1]
    is_straight = matrix.size > 0 or cube.size > 0 or table.size > 0
    zero = np.float32(0)
    for y in prange(height):
        background = backs[y // square & 1]
        for x in range(width):
            alpha = image[y, x, 3]
            if channel == ALPHA:
                level = byte(alpha)
                out[y, x, 0] = out[y, x, 1] = out[y, x, 2] = level
                continue
            red, green, blue = image[y, x, 0], image[y, x, 1], image[y, x, 2]
            if is_straight:
                if alpha > zero:
                    scale = np.float32(1) / alpha
                    red, green, blue = red * scale, green * scale, blue * scale
                    if matrix.size > 0:
                        r, g, b = red, green, blue
                        red = matrix[0, 0] * r + matrix[0, 1] * g + matrix[0, 2] * b
                        green = matrix[1, 0] * r + matrix[1, 1] * g + matrix[1, 2] * b
                        blue = matrix[2, 0] * r + matrix[2, 1] * g + matrix[2, 2] * b
                    if cube.size > 0:
                        last = cube.shape[0] - 1
                        u = along(shaper, red, shaper_scale) * np.float32(last)
                        v = along(shaper, green, shaper_scale) * np.float32(last)
                        w = along(shaper, blue, shaper_scale) * np.float32(last)
                        i, j, k = (
                            min(int(u), last - 1),
                            min(int(v), last - 1),
                            min(int(w), last - 1),
                        )
                        u, v, w = u - np.float32(i), v - np.float32(j), w - np.float32(k)
                        red = mixed(cube, 0, i, j, k, u, v, w)
                        green = mixed(cube, 1, i, j, k, u, v, w)
                        blue = mixed(cube, 2, i, j, k, u, v, w)
                    if table.size > 0:
                        red = along(table, red, table_scale)
                        green = along(table, green, table_scale)
                        blue = along(table, blue, table_scale)
                    red, green, blue = red * alpha, green * alpha, blue * alpha
                else:
                    red = green = blue = zero
            if channel == ALL:
                back = (np.float32(1) - alpha) * background[x]
                out[y, x, 0] = byte(red + back)
                out[y, x, 1] = byte(green + back)
                out[y, x, 2] = byte(blue + back)
            else:
                level = byte(red if channel == RED else green if channel == GREEN else blue)
                out[y, x, 0] = out[y, x, 1] = out[y, x, 2] = level
