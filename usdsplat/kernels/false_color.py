"""Show depths, vectors, motion and ids as colours over a background.

Each kernel fills `out`, RGB of shape (h, w, 3) u8. Where there is no value it shows `background`:
RGB of two kinds of rows, shape (2, w, 3) u8, which alternate every `square` rows.
"""

from __future__ import annotations

import math

import numpy as np

from .jit import scalar
from .launch import kernel
from .show import byte

# --- 1. mathematics: one pixel ---------------------------------------------------------


@scalar
def mixed(number):
    """Return a 32-bit hash whose high bits are evenly distributed for consecutive numbers.

    Source: Wellons 2018, "Prospecting for hash functions", lowbias32.
    """
    bits = np.uint32(number)
    bits = np.uint32((bits ^ bits >> np.uint32(16)) * np.uint32(0x7FEB352D))
    bits = np.uint32((bits ^ bits >> np.uint32(15)) * np.uint32(0x846CA68B))
    return np.uint32(bits ^ bits >> np.uint32(16))


@scalar
def put(out, y, x, color):
    """Set one pixel."""
    for c in range(3):
        out[y, x, c] = color[c]


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="parts", writes=("out",), axes=2)
def fractions(y, x, parts, depth, ramp, background, square, out):
    """Colour numbers from 0 to 1 by a ramp.

    Args:
        parts: Shape (h, w) f32.
        depth: Shape (h, w) f32; infinite where pixels are empty.
        ramp: Colours, shape (n, 3) u8.
    """
    if abs(depth[y, x]) < np.float32(np.inf):
        part = min(max(parts[y, x], np.float32(0)), np.float32(1))
        put(out, y, x, ramp[np.uint32(part * np.float32(ramp.shape[0] - 1) + np.float32(0.5))])
    else:
        put(out, y, x, background[y // square & 1, x])


@kernel(over="depth", writes=("out",), axes=2)
def depths(y, x, depth, white, per_unit, ramp, background, square, out):
    """Colour depths by a ramp; infinite depths are empty.

    Args:
        depth: Shape (h, w) f32.
        white: Depth at the end of the ramp.
        per_unit: 1 / range of depths of the ramp, which begins at `white` + 1 / `per_unit`.
        ramp: Colours, shape (n, 3) u8.
    """
    last = np.float32(ramp.shape[0] - 1)
    z = depth[y, x]
    if abs(z) < np.float32(np.inf):
        part = np.float32(1) - (z - white) * per_unit
        part = min(max(part, np.float32(0)), np.float32(1))
        put(out, y, x, ramp[np.uint32(part * last + np.float32(0.5))])
    else:
        put(out, y, x, background[y // square & 1, x])


@kernel(over="vector", writes=("out",), axes=2)
def vectors(y, x, vector, low, per_unit, background, square, out):
    """Colour vectors; those of length 0 are empty.

    A component becomes the code value (v - `low`) * `per_unit`, clamped to 0..1.

    Args:
        vector: Shape (h, w, 3) f32.
        low, per_unit: One number for each component, shape (3,) f32.
    """
    zero = np.float32(0)
    a, b, c = vector[y, x, 0], vector[y, x, 1], vector[y, x, 2]
    if a == zero and b == zero and c == zero:
        put(out, y, x, background[y // square & 1, x])
    else:
        out[y, x, 0] = byte((a - low[0]) * per_unit[0])
        out[y, x, 1] = byte((b - low[1]) * per_unit[1])
        out[y, x, 2] = byte((c - low[2]) * per_unit[2])


@kernel(over="motion", writes=("out",), axes=2)
def motions(y, x, motion, depth, per_pixel, hues, background, square, out):
    """Colour motion: hue by direction, value by length; pixels of infinite depth are empty.

    Args:
        motion: Shape (h, w, 2) f32.
        depth: Shape (h, w) f32.
        per_pixel: Value of a motion by one pixel.
        hues: Colour wheel, shape (n, 3) f32 [0..1].
    """
    count = hues.shape[0]
    turns = np.float32(count / (2 * math.pi))
    if not depth[y, x] < np.float32(np.inf):
        put(out, y, x, background[y // square & 1, x])
        return
    u, v = motion[y, x, 0], motion[y, x, 1]
    at = math.floor(np.float32(math.atan2(v, u)) * turns + np.float32(0.5)) % count
    value = min(np.float32(math.sqrt(u * u + v * v)) * per_pixel, np.float32(1))
    for c in range(3):
        out[y, x, c] = byte(hues[at, c] * value)


@kernel(over="ids", writes=("out",), axes=2)
def hashed(y, x, ids, shift, colors, background, square, out):
    """Colour ids by the high bits of their hashes; ids below 0 are empty.

    Args:
        ids: Shape (h, w) i32.
        shift: Number of low bits of a hash that are dropped.
        colors: Shape (2**n, 3) u8.
    """
    if ids[y, x] < 0:
        put(out, y, x, background[y // square & 1, x])
    else:
        put(out, y, x, colors[mixed(ids[y, x]) >> shift])


@kernel(over="ids", writes=("out",), axes=2)
def counted(y, x, ids, colors, background, square, out):
    """Colour integers by a table; those outside the table are empty.

    Args:
        ids: Shape (h, w) i32.
        colors: Shape (n, 3) u8.
    """
    if 0 <= ids[y, x] < colors.shape[0]:
        put(out, y, x, colors[ids[y, x]])
    else:
        put(out, y, x, background[y // square & 1, x])


@kernel(over="matte", writes=("out",), axes=2)
def mattes(y, x, matte, shift, colors, background, square, out):
    """Colour Cryptomatte: the mean of the hashes' colours and the background, weighted by coverage.

    Args:
        matte: Pairs of hash bits and coverage, shape (h, w, ranks, 2) f32.
        shift: Number of low bits of a hash that are dropped.
        colors: Shape (2**n, 3) u8.
    """
    left = np.float32(1)
    red, green, blue = np.float32(0), np.float32(0), np.float32(0)
    bits = matte[y, x].view(np.uint32)
    for rank in range(matte.shape[2]):
        weight = matte[y, x, rank, 1]
        if weight <= np.float32(0):
            break
        color = colors[mixed(bits[rank, 0]) >> shift]
        red += weight * np.float32(color[0])
        green += weight * np.float32(color[1])
        blue += weight * np.float32(color[2])
        left -= weight
    left = max(left, np.float32(0))
    back = background[y // square & 1, x]
    out[y, x, 0] = byte((red + left * np.float32(back[0])) / np.float32(255))
    out[y, x, 1] = byte((green + left * np.float32(back[1])) / np.float32(255))
    out[y, x, 2] = byte((blue + left * np.float32(back[2])) / np.float32(255))
