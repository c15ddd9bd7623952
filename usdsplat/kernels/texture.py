"""Sample textures from mipmaps: a pyramid of halved pictures, read between texels and between
levels.

All pyramids lie in one flat array, level after level, row 0 of each at the top (v = 1). Each level
is the exact mean of the one above it. If a size is odd, a texel covers two texels and a fraction.

Source: Williams 1983, "Pyramidal parametrics", trilinear interpolation; the odd sizes are a box
filter by area.
"""

from __future__ import annotations

import math

import numpy as np

from .jit import scalar
from .launch import kernel

BLACK, CLAMP, REPEAT, MIRROR = range(4)
"""Wrap modes, for coordinates outside [0, 1]."""

LEVEL = np.dtype([("first", "i8"), ("width", "i8"), ("height", "i8")])
"""One level of a pyramid: index of its first float, and its size [texel]."""

CHANNELS = 3
FARTHEST = 1e15
"""Limit of texture coordinates. Larger ones have no significant fraction and read as 0."""


# --- 1. mathematics: one look-up --------------------------------------------------------


@scalar
def reduced(u, wrap):
    """Return an equivalent small coordinate; 0 for NaN."""
    if not (abs(u) < FARTHEST):
        return 0.0
    if wrap == REPEAT:
        return u - math.floor(u)
    if wrap == MIRROR:
        return u - 2.0 * math.floor(0.5 * u)
    return min(max(u, -2.0), 3.0)


@scalar
def texel(i, n, wrap):
    """Return which of n texels is at index i of an infinite row; -1 for black."""
    if 0 <= i < n:
        return i
    if wrap == BLACK:
        return -1
    if wrap == CLAMP:
        return min(max(i, 0), n - 1)
    if wrap == REPEAT:
        return i % n
    j = i % (2 * n)
    return j if j < n else 2 * n - 1 - j


@scalar
def fetch(texels, level, x, y, weight):
    """Return a texel times a weight; black outside."""
    if x < 0 or y < 0:
        return np.float32(0), np.float32(0), np.float32(0)
    at = level.first + (y * level.width + x) * CHANNELS
    return texels[at] * weight, texels[at + 1] * weight, texels[at + 2] * weight


@scalar
def bilinear(texels, level, wrap_u, wrap_v, u, v):
    """Return the bilinear sample of one level at (u, v), small coordinates: (r, g, b)."""
    x = u * np.float64(level.width) - 0.5
    y = (1.0 - v) * np.float64(level.height) - 0.5
    i, j = np.int64(math.floor(x)), np.int64(math.floor(y))
    fx, fy = np.float32(x - math.floor(x)), np.float32(y - math.floor(y))
    gx, gy = np.float32(1) - fx, np.float32(1) - fy
    x0, x1 = texel(i, level.width, wrap_u), texel(i + 1, level.width, wrap_u)
    y0, y1 = texel(j, level.height, wrap_v), texel(j + 1, level.height, wrap_v)
    r0, g0, b0 = fetch(texels, level, x0, y0, gx * gy)
    r1, g1, b1 = fetch(texels, level, x1, y0, fx * gy)
    r2, g2, b2 = fetch(texels, level, x0, y1, gx * fy)
    r3, g3, b3 = fetch(texels, level, x1, y1, fx * fy)
    return r0 + r1 + r2 + r3, g0 + g1 + g2 + g3, b0 + b1 + b2 + b3


@scalar
def footprint(level, dudx, dvdx, dudy, dvdy):
    """Return the longer side of a pixel's footprint [texel of the level]."""
    w, h = np.float64(level.width), np.float64(level.height)
    across = (dudx * w) * (dudx * w) + (dvdx * h) * (dvdx * h)
    down = (dudy * w) * (dudy * w) + (dvdy * h) * (dvdy * h)
    return math.sqrt(max(across, down))


@scalar
def trilinear(texels, levels, first, count, wrap_u, wrap_v, u, v, texels_per_pixel):
    """Return the trilinear sample at (u, v) for a pixel of a number of texels of level 0."""
    u, v = reduced(u, wrap_u), reduced(v, wrap_v)
    last = count - 1
    # the first test is also false for NaN, from a surface seen edge-on
    if texels_per_pixel <= 1.0:
        depth = 0.0
    elif texels_per_pixel < 1e30:
        depth = min(math.log2(texels_per_pixel), np.float64(last))
    else:
        depth = np.float64(last)
    k = np.int64(depth)
    t = np.float32(depth - np.float64(k))
    r, g, b = bilinear(texels, levels[first + k], wrap_u, wrap_v, u, v)
    if t > np.float32(0):
        s = np.float32(1) - t
        r1, g1, b1 = bilinear(texels, levels[first + k + 1], wrap_u, wrap_v, u, v)
        r, g, b = s * r + t * r1, s * g + t * g1, s * b + t * b1
    return r, g, b


@scalar
def taps(i, n):
    """Return the weights of texels 2i, 2i + 1 and 2i + 2 in texel i of the next level."""
    if n == 1:
        return np.float32(1), np.float32(0), np.float32(0)
    if n % 2 == 0:
        return np.float32(0.5), np.float32(0.5), np.float32(0)
    m = n // 2
    return np.float32((m - i) / n), np.float32(m / n), np.float32((i + 1) / n)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="size", writes=("texels",), axes=2)
def halve(y, x, texels, levels, k, size):
    """Fill level k + 1 of a pyramid from level k.

    Args:
        texels: All levels, f32.
        levels: LEVEL records.
        size: Rows and columns of level k + 1.
    """
    big, small = levels[k], levels[k + 1]
    wy, wx = taps(y, big.height), taps(x, big.width)
    for c in range(CHANNELS):
        total = np.float32(0)
        for j in range(3):
            if wy[j] > np.float32(0):
                for i in range(3):
                    if wx[i] > np.float32(0):
                        row = (2 * y + j) * big.width + 2 * x + i
                        value = texels[big.first + row * CHANNELS + c]
                        total += wy[j] * wx[i] * value
        texels[small.first + (y * small.width + x) * CHANNELS + c] = total
