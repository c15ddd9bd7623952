"""Read a splat from arrays of floats, or from its 28 packed bytes.

Each form is a pair of device functions on a tuple of arrays, positions first. `load` writes
quaternion and standard deviations and returns the opacity. `shade` writes the colour for a view
direction. Kernels that call them are exact: they give the same bits as the kernels for other AOVs.
"""

from __future__ import annotations

import math

import numpy as np
from numba import cuda, float32

from usdsplat.kernels.radiance import harmonics
from usdsplat.kernels.unpack import unpack_colors, unpack_harmonic, unpack_shape

COEFFICIENTS = 25
"""Number of coefficients of degree 4."""


@cuda.jit(device=True, inline="always")
def direction(sight, position):
    """Return the unit view direction in the field's space; 0 at the eye."""
    px, py, pz = position[0], position[1], position[2]
    dx = sight[0, 0] * px + sight[0, 1] * py + sight[0, 2] * pz + sight[0, 3]
    dy = sight[1, 0] * px + sight[1, 1] * py + sight[1, 2] * pz + sight[1, 3]
    dz = sight[2, 0] * px + sight[2, 1] * py + sight[2, 2] * pz + sight[2, 3]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    inverse = 1.0 / length if length > 0.0 else 0.0
    return float32(dx * inverse), float32(dy * inverse), float32(dz * inverse)


@cuda.jit(device=True, inline="always")
def row_of(splats, i):
    """Return the row in its field of splat i in memory. The last array of `splats` has all rows, or
    is empty if memory has the field's order."""
    return splats[5][i] if splats[5].shape[0] > 0 else i


@cuda.jit(device=True, inline="always")
def load_floats(splats, i, rotation, scales):
    """Load from (positions, rotations, scales, opacities, sh, rows), arrays as in SplatCloud. sh is
    in the order of the field, the others in that of memory."""
    for c in range(4):
        rotation[c] = splats[1][i, c]
    for c in range(3):
        scales[c] = splats[2][i, c]
    return splats[3][i]


@cuda.jit(device=True, inline="always")
def shade_floats(splats, i, sight, degree, color):
    """Shade from the arrays of `load_floats`."""
    x, y, z = float32(0), float32(0), float32(0)
    if degree > 0:
        x, y, z = direction(sight, splats[0][i])
    for c in range(3):
        color[c] = harmonics(splats[4][row_of(splats, i)], c, degree, x, y, z)


@cuda.jit(device=True, inline="always")
def load_packed(splats, i, rotation, scales):
    """Load from (positions, words (n, 4) i32, harmonics (n, 4 w) i32, color range (6,) f32, steps
    of the harmonics (degree,) f32, rows). Harmonics are in the order of the field."""
    return unpack_shape(splats[1][i], rotation, scales)


@cuda.jit(device=True, inline="always")
def shade_packed_flat(splats, i, sight, degree, color):
    """Shade from the arrays of `load_packed` at degree 0, without local memory, which slows all
    threads."""
    unpack_colors(splats[1][i], splats[3], color)
    least = cuda.local.array((1, 3), np.float32)
    for c in range(3):
        least[0, c] = color[c]
    for c in range(3):
        color[c] = harmonics(least, c, 0, float32(0), float32(0), float32(0))


@cuda.jit(device=True, inline="always")
def shade_packed(splats, i, sight, degree, color):
    """Shade from the arrays of `load_packed` at degree 1 and above, by channels, which needs a
    third of the memory."""
    unpack_colors(splats[1][i], splats[3], color)
    sh = cuda.local.array((COEFFICIENTS, 1), np.float32)
    x, y, z = direction(sight, splats[0][i])
    words = splats[2][row_of(splats, i)]
    for c in range(3):
        sh[0, 0] = color[c]
        for band in range(1, degree + 1):
            for k in range(band * band, (band + 1) * (band + 1)):
                sh[k, 0] = unpack_harmonic(words, 3 * (k - 1) + c, splats[4], band)
        color[c] = harmonics(sh, 0, degree, x, y, z)
