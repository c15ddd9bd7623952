"""Compute the radiance of visible splats: harmonics in the view direction, in the blend space.

This stage runs after projection, which finds the visible splats, and before any pixel is drawn.
Light cached per splat would be added here.

Source: Sloan 2008, "Stupid Spherical Harmonics Tricks", app. A2; signs and the 0.5 offset are
    3DGS's.
"""

from __future__ import annotations

import math

import numpy as np

from .coefficients import coefficients
from .color import convert
from .jit import scalar
from .lanes import fetch
from .launch import kernel

AHEAD = 16
"""Number of splats between prefetching harmonics and reading them. In spatial order their rows are
scattered, and the CPU cannot predict them."""
LINE = 16
"""Number of floats of a cache line."""

C0 = np.float32(0.28209479177387814)
C1 = np.float32(0.4886025119029199)
C2A, C2B, C2C = (
    np.float32(1.0925484305920792),
    np.float32(0.31539156525252005),
    np.float32(0.5462742152960396),
)
C3A, C3B, C3C, C3D, C3E = (
    np.float32(0.5900435899266435),
    np.float32(2.890611442640554),
    np.float32(0.4570457994644658),
    np.float32(0.3731763325901154),
    np.float32(1.445305721320277),
)
C4A, C4B, C4C, C4D, C4E, C4F, C4G = (
    np.float32(2.5033429417967046),
    np.float32(1.7701307697799304),
    np.float32(0.9461746957575601),
    np.float32(0.6690465435572892),
    np.float32(0.10578554691520431),
    np.float32(0.47308734787878004),
    np.float32(0.6258357354491761),
)


# --- 1. mathematics: one splat, one channel --------------------------------------------


@scalar
def harmonics(sh, c, degree, x, y, z):
    """Return 0.5 plus the sum of harmonics up to `degree` of channel `c` in unit direction (x, y,
    z), clamped at 0."""
    value = np.float32(0.5) + C0 * sh[0, c]
    if degree >= 1:
        value += C1 * (z * sh[2, c] - y * sh[1, c] - x * sh[3, c])
    if degree >= 2:
        xx, yy, zz = x * x, y * y, z * z
        value += (
            C2A * (x * y * sh[4, c] - y * z * sh[5, c] - x * z * sh[7, c])
            + C2B * (zz + zz - xx - yy) * sh[6, c]
            + C2C * (xx - yy) * sh[8, c]
        )
        if degree >= 3:
            three, four, two = np.float32(3), np.float32(4), np.float32(2)
            value += (
                C3B * x * y * z * sh[10, c]
                - C3A * (y * (three * xx - yy) * sh[9, c] + x * (xx - three * yy) * sh[15, c])
                - C3C * (four * zz - xx - yy) * (y * sh[11, c] + x * sh[13, c])
                + C3D * z * (two * zz - three * (xx + yy)) * sh[12, c]
                + C3E * z * (xx - yy) * sh[14, c]
            )
            if degree >= 4:
                seven, one = np.float32(7), np.float32(1)
                value += (
                    C4A * x * y * (xx - yy) * sh[16, c]
                    - C4B
                    * z
                    * (y * (three * xx - yy) * sh[17, c] + x * (xx - three * yy) * sh[23, c])
                    + C4C * x * y * (seven * zz - one) * sh[18, c]
                    - C4D * z * (seven * zz - three) * (y * sh[19, c] + x * sh[21, c])
                    + C4E * (zz * (np.float32(35) * zz - np.float32(30)) + three) * sh[20, c]
                    + C4F * (xx - yy) * (seven * zz - one) * sh[22, c]
                    + C4G * (xx * (xx - three * yy) - yy * (three * xx - yy)) * sh[24, c]
                )
    # non-finite values become black, so that a broken splat does not spoil its pixels
    return value if np.float32(0) < value < np.float32(np.inf) else np.float32(0)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="found", writes=("paints",), team=True, exact=True)
def radiance(
    item, lane, lanes, sights, positions, sh, degree, conversion, converts, block, base, sources,
    found, paints, column,
):  # fmt: skip
    """Colour the visible splats of all instances of one field.

    Args:
        sights: Affine map from a splat's position to its view direction in the field's space,
            of any length, shape (m, 3, 4) f64, one per instance. It carries the inverse of the
            orthogonal factor of the field's transform, reflection included.
        positions, sh: The field's arrays.
        degree: Highest degree evaluated; at most what `sh` holds.
        conversion: 13 numbers, see `color`; read only if `converts`.
        block, base, found: See `project.project`.
        sources: Each slot's row in the field.
        paints, column: Receives the colour in three columns of each used slot, f32.
    """
    width = 3 * (degree + 1) * (degree + 1)
    stride = np.uint64(3 * sh.shape[1])
    blocks = (positions.shape[0] + block - 1) // block
    m = sights[item // blocks]
    slot = base + item * block
    x, y, z = np.float32(0), np.float32(0), np.float32(0)
    end = slot + found[item]
    for at in range(slot + lane, end, lanes):
        if at + AHEAD < end:
            later = np.uint64(sources[at + AHEAD])
            for c in range(0, width, LINE):
                fetch(sh, later * stride + np.uint64(c))
            fetch(sh, later * stride + np.uint64(width - 1))  # rows begin anywhere in a line
            if degree > 0:
                fetch(positions, later * np.uint64(3))
        i = sources[at]
        if degree > 0:
            px, py, pz = positions[i, 0], positions[i, 1], positions[i, 2]
            dx = m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3]
            dy = m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3]
            dz = m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3]
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
            inverse = 1.0 / length if length > 0.0 else 0.0
            x, y, z = (
                np.float32(dx * inverse),
                np.float32(dy * inverse),
                np.float32(dz * inverse),
            )
        row = coefficients(sh, np.uint64(i))
        r = harmonics(row, 0, degree, x, y, z)
        g = harmonics(row, 1, degree, x, y, z)
        b = harmonics(row, 2, degree, x, y, z)
        if converts:
            r, g, b = convert(r, g, b, conversion)
        paints[at, column], paints[at, column + 1], paints[at, column + 2] = r, g, b
