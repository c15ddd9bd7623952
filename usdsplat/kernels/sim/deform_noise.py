"""Deformers that nobody can foresee: noise, and a flow that keeps volume.

Both see a point in wavelengths, float32, and give displacement and gradient there. Noise is three
independent fields, one a coordinate. The flow carries a point along whirls without divergence, by a
fixed number of midpoint steps, so that a cloud is stirred and neither thinned nor packed.

Source: Bridson, Hourihan & Nordenstam 2007, "Curl-noise for procedural fluid flow".
"""

from __future__ import annotations

import numpy as np
from numba import prange

from usdsplat.kernels.jit import parallel, scalar

from .deform import BLOCK, fade, inside, moved
from .noise import curl_noise, gradient_noise

NOISE, CURL = range(2)
STEPS = 4
_SECOND, _THIRD = np.uint32(0x9E3779B9), np.uint32(0x3C6EF372)
_HALF, _ZERO = np.float32(0.5), np.float32(0)
_H = np.float32(1 / 128)
"""Half of the base of central differences [wavelength]."""
_SLOPE = np.float32(64)
"""1 / 2 _H."""


# --- 1. mathematics: one point ---------------------------------------------------------


@scalar
def three_noises(x, y, z, amount, seed):
    """Displacement by three fields, and its gradient."""
    a, ax, ay, az = gradient_noise(x, y, z, seed)
    b, bx, by, bz = gradient_noise(x, y, z, seed ^ _SECOND)
    c, cx, cy, cz = gradient_noise(x, y, z, seed ^ _THIRD)
    gradient = (
        amount * ax, amount * ay, amount * az, amount * bx, amount * by, amount * bz,
        amount * cx, amount * cy, amount * cz,
    )  # fmt: skip
    return (amount * a, amount * b, amount * c), gradient


@scalar
def stirred(x, y, z, amount, seed):
    """Displacement of a point that whirls of speed 1 carry for a time of `amount`."""
    dx, dy, dz, ux, uy, uz = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    h = amount / np.float32(STEPS)
    for part in range(2 * STEPS):
        vx, vy, vz = curl_noise(x + ux, y + uy, z + uz, seed)
        whole = part & 1
        step = h if whole else h * _HALF
        ux, uy, uz = dx + step * vx, dy + step * vy, dz + step * vz
        if whole:
            dx, dy, dz = ux, uy, uz
    return dx, dy, dz


@scalar
def sign(sample, axis):
    """1, -1 or 0: which way a sample of central differences lies along an axis; sample 0 is the
    point itself."""
    return np.float32((sample == 2 * axis + 1) - (sample == 2 * axis + 2))


@scalar
def flow(x, y, z, amount, seed, samples):
    """`stirred`, and its gradient by central differences if `samples` is 7 and not 1."""
    dx, dy, dz = _ZERO, _ZERO, _ZERO
    j0, j1, j2, j3, j4, j5, j6, j7, j8 = (
        _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO,
    )  # fmt: skip
    # One loop, not seven calls: all of this is inlined, and the noise is long.
    for sample in range(samples):
        hx, hy, hz = sign(sample, 0), sign(sample, 1), sign(sample, 2)
        ax, ay, az = stirred(x + _H * hx, y + _H * hy, z + _H * hz, amount, seed)
        if sample == 0:
            dx, dy, dz = ax, ay, az
        hx, hy, hz = hx * _SLOPE, hy * _SLOPE, hz * _SLOPE
        j0, j1, j2 = j0 + ax * hx, j1 + ax * hy, j2 + ax * hz
        j3, j4, j5 = j3 + ay * hx, j4 + ay * hy, j5 + ay * hz
        j6, j7, j8 = j6 + az * hx, j7 + az * hy, j8 + az * hz
    return (dx, dy, dz), (j0, j1, j2, j3, j4, j5, j6, j7, j8)


# --- 2. CPU ----------------------------------------------------------------------------


@parallel
def noise(kind, amount, size, shift, seed, space, weight, reach, mask, positions, gradient):
    """Noise or flow, on all splats; arguments as `deform.deform`.

    Args:
        kind: NOISE or CURL.
        amount: How far splats move [unit].
        size: Wavelength [unit].
        shift: How many wavelengths have passed by, along the axis.
        seed: u32.
    """
    n = len(positions)
    far = np.float32(amount / size)
    for b in prange((n + BLOCK - 1) // BLOCK):
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            x, y, z = inside(positions, i, space)
            own = weight * mask[i] if len(mask) > 0 else weight
            w, gx, gy, gz = fade(x, y, z, own, reach)
            if w == 0.0:
                continue
            u, v, t = np.float32(x / size), np.float32(y / size), np.float32(z / size - shift)
            if kind == NOISE:
                d, j = three_noises(u, v, t, far, seed)
            else:
                d, j = flow(u, v, t, far, seed, 7 if len(gradient) > 0 else 1)
            d = (d[0] * size, d[1] * size, d[2] * size)
            moved(positions, gradient, i, space, d, j, w, gx, gy, gz)
