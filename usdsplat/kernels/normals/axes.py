"""Axes of splats, and of planes through points.

Source: Smith 1961, "Eigenvalues of a symmetric 3x3 matrix".
"""

from __future__ import annotations

import math

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

DOUBLE = 1e-12
"""Two eigenvalues count as equal if their difference, relative to the spread, is below the square
root of this. The formula has half of float64's digits there."""

# --- 1. mathematics ---------------------------------------------------------------------


@scalar
def column(w, x, y, z, axis):
    """Return a column of the rotation matrix of a unit quaternion."""
    if axis == 0:
        return 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
    if axis == 1:
        return 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)
    return 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)


@scalar
def cross(ax, ay, az, bx, by, bz):
    """Return a x b and its squared length."""
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return x, y, z, x * x + y * y + z * z


@scalar
def least_axis(xx, xy, xz, yy, yz, zz):
    """Return the two smallest eigenvalues of a symmetric matrix and the unit eigenvector of the
    smallest.

    All are float64. The eigenvector is (0, 0, 0) if it is not unique.
    """
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    spread = math.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    if not spread > 1e-12 * mean:
        return mean, mean, 0.0, 0.0, 0.0
    det = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    angle = math.acos(min(max(det / (2 * spread * spread * spread), -1.0), 1.0)) / 3
    least = mean + 2 * spread * math.cos(angle + 2 * math.pi / 3)
    most = mean + 2 * spread * math.cos(angle)
    middle = 3 * mean - least - most
    a, b, c = xx - least, yy - least, zz - least
    x, y, z, best = cross(a, xy, xz, xy, b, yz)
    u, v, w, size = cross(a, xy, xz, xz, yz, c)
    if size > best:
        x, y, z, best = u, v, w, size
    u, v, w, size = cross(xy, b, yz, xz, yz, c)
    if size > best:
        x, y, z, best = u, v, w, size
    if not best > DOUBLE * spread * spread * spread * spread:
        return least, middle, 0.0, 0.0, 0.0
    size = 1 / math.sqrt(best)
    return least, middle, x * size, y * size, z * size


@scalar
def thin_axis(rotations, scales, i):
    """Return the axis along which splat `i` is thinnest."""
    axis = 0
    for a in range(1, 3):
        if scales[i, a] < scales[i, axis]:
            axis = a
    return column(rotations[i, 0], rotations[i, 1], rotations[i, 2], rotations[i, 3], axis)


# --- 2. CPU -----------------------------------------------------------------------------


@kernel(over="scales", writes=("out",))
def thin_axes(i, rotations, scales, out):
    """Compute the axis along which each splat is thinnest.

    Args:
        rotations: Unit quaternions, (n, 4) f32.
        scales: (n, 3) f32.
        out: Receives unit vectors, (n, 3) f32.
    """
    out[i, 0], out[i, 1], out[i, 2] = thin_axis(rotations, scales, i)
