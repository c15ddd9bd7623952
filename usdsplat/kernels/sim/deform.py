"""Deformers with a closed form: transform, bend, twist, taper, wave.

Each deformer is a map f of its own space. At a point p it returns the displacement f(p) - p and the
gradient of the displacement, nine numbers in row order. The deformer's axis is its third
coordinate. Everything is computed in float64, and positions are rounded once, when they are
written.

Source: Barr 1984, "Global and local deformations of solid primitives".
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .matrix import product

TRANSFORM, BEND, TWIST, TAPER, WAVE = range(5)


# --- 1. mathematics: one point ---------------------------------------------------------


@scalar
def fade(x, y, z, weight, reach):
    """Return the weight of a deformer at a point of its space, and the gradient of the weight.

    reach: distance from the origin at which the weight has decreased smoothly to 0; 0 means
    infinite.
    """
    square = x * x + y * y + z * z
    if reach <= 0.0:
        return weight, 0.0, 0.0, 0.0
    if square >= reach * reach:
        return 0.0, 0.0, 0.0, 0.0
    t = math.sqrt(square) / reach
    slope = -6.0 * (1.0 - t) / (reach * reach) * weight
    return weight * (1.0 - t * t * (3.0 - 2.0 * t)), slope * x, slope * y, slope * z


@scalar
def _sinc(x):
    """Return sin x / x."""
    return math.sin(x) / x if abs(x) > 1e-4 else 1.0 - x * x / 6.0


@scalar
def bend(x, z, length, angle):
    """Bend the axis from 0 to `length` into an arc of that length, towards the first coordinate.

    Before and after the arc the axis stays straight.
    """
    s = min(max(z, 0.0), length)
    inside = (z > 0.0) & (z < length)
    curvature = angle / length
    a = curvature * s
    sine, cosine = math.sin(a), math.cos(a)
    m = 1.0 - curvature * x if inside else 1.0
    dx = x * (cosine - 1.0) + s * math.sin(0.5 * a) * _sinc(0.5 * a) + (z - s) * sine
    dz = s * _sinc(a) - x * sine + (z - s) * cosine - z
    gradient = (cosine - 1.0, 0.0, m * sine, 0.0, 0.0, 0.0, -sine, 0.0, m * cosine - 1.0)
    return (dx, 0.0, dz), gradient


@scalar
def twist(x, y, z, length, angle):
    """Rotate about the axis, by an angle that increases linearly to `angle` from 0 to `length`."""
    s = min(max(z, 0.0), length)
    rate = angle / length if (z > 0.0) & (z < length) else 0.0
    a = angle * s / length
    sine, cosine = math.sin(a), math.cos(a)
    u, v = x * cosine - y * sine, x * sine + y * cosine
    gradient = (
        cosine - 1.0, -sine, -v * rate, sine, cosine - 1.0, u * rate, 0.0, 0.0, 0.0,
    )  # fmt: skip
    return (u - x, v - y, 0.0), gradient


@scalar
def taper(x, y, z, length, kx, ky):
    """Scale across the axis, by a factor that changes linearly from 1 at 0 to 1 + k at `length`."""
    s = min(max(z, 0.0), length) / length
    rate = 1.0 / length if (z > 0.0) & (z < length) else 0.0
    gradient = (kx * s, 0.0, x * kx * rate, 0.0, ky * s, y * ky * rate, 0.0, 0.0, 0.0)
    return (x * kx * s, y * ky * s, 0.0), gradient


@scalar
def wave(x, amount, number, phase):
    """Move along the axis by a sine wave of the first coordinate."""
    a = number * x - phase
    rise = amount * number * math.cos(a)
    return (0.0, 0.0, amount * math.sin(a)), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, rise, 0.0, 0.0)


@scalar
def affine(x, y, z, m):
    """Return M p + t - p and its gradient; m has the rows of M - I, then t."""
    g = (m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8])
    dx = g[0] * x + g[1] * y + g[2] * z + m[9]
    dy = g[3] * x + g[4] * y + g[5] * z + m[10]
    dz = g[6] * x + g[7] * y + g[8] * z + m[11]
    return (dx, dy, dz), g


@scalar
def inside(positions, i, space):
    """Return the position of splat i in the deformer's space.

    space: rows of the matrix to the deformer's space, then of its inverse, shape (2, 3, 4) f64.
    """
    x, y, z = np.float64(positions[i, 0]), np.float64(positions[i, 1]), np.float64(positions[i, 2])
    return (
        space[0, 0, 0] * x + space[0, 0, 1] * y + space[0, 0, 2] * z + space[0, 0, 3],
        space[0, 1, 0] * x + space[0, 1, 1] * y + space[0, 1, 2] * z + space[0, 1, 3],
        space[0, 2, 0] * x + space[0, 2, 1] * y + space[0, 2, 2] * z + space[0, 2, 3],
    )


@scalar
def linear(space, way):
    """Return the linear part (3, 3) of the matrix to the deformer's space or back, as nine
    numbers."""
    return (
        space[way, 0, 0], space[way, 0, 1], space[way, 0, 2],
        space[way, 1, 0], space[way, 1, 1], space[way, 1, 2],
        space[way, 2, 0], space[way, 2, 1], space[way, 2, 2],
    )  # fmt: skip


@scalar
def moved(positions, gradient, i, space, d, j, w, gx, gy, gz):
    """Move a splat by w d, and its gradient by w J + d (grad w)^T, both in the deformer's space."""
    back = linear(space, 1)
    x, y, z = w * d[0], w * d[1], w * d[2]
    positions[i, 0] = np.float32(positions[i, 0] + (back[0] * x + back[1] * y + back[2] * z))
    positions[i, 1] = np.float32(positions[i, 1] + (back[3] * x + back[4] * y + back[5] * z))
    positions[i, 2] = np.float32(positions[i, 2] + (back[6] * x + back[7] * y + back[8] * z))
    if len(gradient) > 0:
        local = (
            w * j[0] + d[0] * gx, w * j[1] + d[0] * gy, w * j[2] + d[0] * gz,
            w * j[3] + d[1] * gx, w * j[4] + d[1] * gy, w * j[5] + d[1] * gz,
            w * j[6] + d[2] * gx, w * j[7] + d[2] * gy, w * j[8] + d[2] * gz,
        )  # fmt: skip
        e = product(back, product(local, linear(space, 0)))
        for c in range(3):
            a, b, g = gradient[i, 0, c], gradient[i, 1, c], gradient[i, 2, c]
            gradient[i, 0, c] = np.float32(a + (e[0] * a + e[1] * b + e[2] * g))
            gradient[i, 1, c] = np.float32(b + (e[3] * a + e[4] * b + e[5] * g))
            gradient[i, 2, c] = np.float32(g + (e[6] * a + e[7] * b + e[8] * g))


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="positions", writes=("positions", "gradient"))
def deform(i, kind, numbers, space, weight, reach, mask, positions, gradient):
    """Apply one deformer to all splats.

    Args:
        kind: The deformer, which defines `numbers`: TRANSFORM: those of `affine`; BEND, TWIST:
            length, angle [rad]; TAPER: length, kx, ky; WAVE: amount, wave number [rad], phase
            [rad].
        numbers: f64.
        space: Rows of the matrix from the splats' space to the deformer's, then of its inverse,
            shape (2, 3, 4) f64.
        weight: Strength of the deformer.
        reach: See `fade`.
        mask: Factor on `weight` for each splat, shape (n,), or (0,) for 1.
        positions: Changed in place, shape (n, 3). Where the weight is 0 they keep their bits.
        gradient: Replaced by J F, shape (n, 3, 3), or (0, 3, 3) if not needed.
    """
    x, y, z = inside(positions, i, space)
    own = weight * mask[i] if len(mask) > 0 else weight
    w, gx, gy, gz = fade(x, y, z, own, reach)
    if w == 0.0:
        return
    if kind == BEND:
        d, j = bend(x, z, numbers[0], numbers[1])
    elif kind == TWIST:
        d, j = twist(x, y, z, numbers[0], numbers[1])
    elif kind == TAPER:
        d, j = taper(x, y, z, numbers[0], numbers[1], numbers[2])
    elif kind == WAVE:
        d, j = wave(x, numbers[0], numbers[1], numbers[2])
    else:
        d, j = affine(x, y, z, numbers)
    moved(positions, gradient, i, space, d, j, w, gx, gy, gz)
