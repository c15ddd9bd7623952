"""How a splat is read: from arrays of floats, or from its 28 bytes as they are.

Each form is a pair of device functions on a tuple of arrays, the positions first: `load` writes the
quaternion and the deviations and returns the opacity; `shade` writes the colour seen along a sight.
Kernels that call them are exact: they give the same bits as where other AOVs are asked for.
"""

from __future__ import annotations

import math

import numpy as np
from numba import cuda, float32

from usdsplat.kernels.radiance import harmonics
from usdsplat.kernels.unpack import unpack_colors, unpack_harmonic, unpack_shape

COEFFICIENTS = 25
"""Of degree 4."""


@cuda.jit(device=True, inline="always")
def direction(sight, position):
    """Unit direction of sight in the field's space; 0 at the eye."""
    px, py, pz = position[0], position[1], position[2]
    dx = sight[0, 0] * px + sight[0, 1] * py + sight[0, 2] * pz + sight[0, 3]
    dy = sight[1, 0] * px + sight[1, 1] * py + sight[1, 2] * pz + sight[1, 3]
    dz = sight[2, 0] * px + sight[2, 1] * py + sight[2, 2] * pz + sight[2, 3]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    inverse = 1.0 / length if length > 0.0 else 0.0
    return float32(dx * inverse), float32(dy * inverse), float32(dz * inverse)


@cuda.jit(device=True, inline="always")
def row_of(splats, i):
    """Where splat i of memory is in its field; `splats` ends with all of these, or with none where
    memory has the field's order."""
    return splats[5][i] if splats[5].shape[0] > 0 else i


@cuda.jit(device=True, inline="always")
def load_floats(splats, i, rotation, scales):
    """Of (positions, rotations, scales, opacities, sh, rows), arrays as a SplatCloud has them; sh
    in the order of the field, the others in that of memory."""
    for c in range(4):
        rotation[c] = splats[1][i, c]
    for c in range(3):
        scales[c] = splats[2][i, c]
    return splats[3][i]


@cuda.jit(device=True, inline="always")
def shade_floats(splats, i, sight, degree, color):
    """Of the same."""
    x, y, z = float32(0), float32(0), float32(0)
    if degree > 0:
        x, y, z = direction(sight, splats[0][i])
    for c in range(3):
        color[c] = harmonics(splats[4][row_of(splats, i)], c, degree, x, y, z)


@cuda.jit(device=True, inline="always")
def load_packed(splats, i, rotation, scales):
    """Of (positions, words (n, 4) i32, harmonics (n, 4 w) i32, color range (6,) f32, steps of the
    harmonics (degree,) f32, rows); harmonics in the order of the field."""
    return unpack_shape(splats[1][i], rotation, scales)


@cuda.jit(device=True, inline="always")
def shade_packed_flat(splats, i, sight, degree, color):
    """Of the same, at degree 0: without the memory of a thread's own, which slows all of them."""
    unpack_colors(splats[1][i], splats[3], color)
    least = cuda.local.array((1, 3), np.float32)
    for c in range(3):
        least[0, c] = color[c]
    for c in range(3):
        color[c] = harmonics(least, c, 0, float32(0), float32(0), float32(0))


@cuda.jit(device=True, inline="always")
def shade_packed(splats, i, sight, degree, color):
    """Of the same, of degree 1 and above; a channel at a time needs a third of the memory."""
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
