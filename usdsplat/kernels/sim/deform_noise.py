"""Deformers by random fields: noise, and a flow that keeps volume.

Both take a point in wavelengths, float32, and return displacement and gradient there. Noise uses
three independent fields, one for each coordinate. The flow moves a point along a velocity field
without divergence, by a fixed number of midpoint steps, so that the density of splats stays the
same.

Source: Bridson, Hourihan & Nordenstam 2007, "Curl-noise for procedural fluid flow".
"""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .deform import fade, inside, moved
from .noise import curl_noise, gradient_noise

STEPS = 4
_SECOND, _THIRD = np.uint32(0x9E3779B9), np.uint32(0x3C6EF372)
_HALF, _ZERO = np.float32(0.5), np.float32(0)
_H = np.float32(1 / 128)
"""Half the distance of central differences [wavelength]."""
_SLOPE = np.float32(64)
"""1 / 2 _H."""
_SAMPLES = np.array(
    [
        [0, 0, 0, 1],
        [1, 0, 0, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, -1, 0, 0], [0, 0, 1, 0], [0, 0, -1, 0],
    ],
    np.float32,
)  # fmt: skip
"""Offsets of central differences, and 1 for the point itself.

This is a table, as compilers unroll the loop seven times for conditions on its index.
"""


# --- 1. mathematics: one point ---------------------------------------------------------


@scalar
def three_noises(x, y, z, amount, seed):
    """Return the displacement by three noise fields, and its gradient."""
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
    """Return the displacement of a point that moves with a flow of speed 1 for a time of
    `amount`."""
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
def flow(x, y, z, amount, seed, samples):
    """Return `stirred` and, if `samples` is 7 instead of 1, its gradient by central differences."""
    dx, dy, dz = _ZERO, _ZERO, _ZERO
    j0, j1, j2, j3, j4, j5, j6, j7, j8 = (
        _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO,
    )  # fmt: skip
    # A loop instead of seven calls, as all calls are inlined and the noise is long.
    for sample in range(samples):
        hx, hy, hz = _SAMPLES[sample, 0], _SAMPLES[sample, 1], _SAMPLES[sample, 2]
        ax, ay, az = stirred(x + _H * hx, y + _H * hy, z + _H * hz, amount, seed)
        own = _SAMPLES[sample, 3]
        dx, dy, dz = dx + own * ax, dy + own * ay, dz + own * az
        hx, hy, hz = hx * _SLOPE, hy * _SLOPE, hz * _SLOPE
        j0, j1, j2 = j0 + ax * hx, j1 + ax * hy, j2 + ax * hz
        j3, j4, j5 = j3 + ay * hx, j4 + ay * hy, j5 + ay * hz
        j6, j7, j8 = j6 + az * hx, j7 + az * hy, j8 + az * hz
    return (dx, dy, dz), (j0, j1, j2, j3, j4, j5, j6, j7, j8)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="positions", writes=("positions", "gradient"))
def noise(i, amount, size, shift, seed, space, weight, reach, mask, positions, gradient):
    """Apply noise to all splats; for the other arguments see `deform.deform`.

    Args:
        amount: Scale of the displacement [unit].
        size: Wavelength [unit].
        shift: Offset of the noise along the axis, in wavelengths.
        seed: u32.
    """
    far = np.float32(amount / size)
    x, y, z = inside(positions, i, space)
    own = weight * mask[i] if len(mask) > 0 else weight
    w, gx, gy, gz = fade(x, y, z, own, reach)
    if w == 0.0:
        return
    u, v, t = np.float32(x / size), np.float32(y / size), np.float32(z / size - shift)
    d, j = three_noises(u, v, t, far, seed)
    d = (d[0] * size, d[1] * size, d[2] * size)
    moved(positions, gradient, i, space, d, j, w, gx, gy, gz)


@kernel(over="positions", writes=("positions", "gradient"))
def curl(i, amount, size, shift, seed, space, weight, reach, mask, positions, gradient):
    """Apply the flow to all splats; for the arguments see `noise`."""
    far = np.float32(amount / size)
    samples = 7 if len(gradient) > 0 else 1
    x, y, z = inside(positions, i, space)
    own = weight * mask[i] if len(mask) > 0 else weight
    w, gx, gy, gz = fade(x, y, z, own, reach)
    if w == 0.0:
        return
    u, v, t = np.float32(x / size), np.float32(y / size), np.float32(z / size - shift)
    d, j = flow(u, v, t, far, seed, samples)
    d = (d[0] * size, d[1] * size, d[2] * size)
    moved(positions, gradient, i, space, d, j, w, gx, gy, gz)
