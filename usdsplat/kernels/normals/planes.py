"""Planes through the neighbours of splats, each with its own extent.

Source: Hoppe et al. 1992, "Surface reconstruction from unorganized points"; Pauly et al. 2002,
"Efficient simplification of point-sampled surfaces", for flatness by eigenvalues.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.normals.axes import column, least_axis, thin_axis

FAR = 0.02
"""Weight of the farthest neighbour, relative to that of one at no distance."""
FAINT = 1e-6
"""Least weight of a neighbour, so that splats without opacity or area still have a plane."""
FEWEST = 6
"""Number of other splats below which a plane has no meaning."""
LONELY, ALONE = 2.0, 6.0
"""Distance to the sixth neighbour, relative to the mean of the neighbours' own, from which flatness
falls, and from which it is 0: the splat is a stray."""


# --- 1. mathematics ---------------------------------------------------------------------


@scalar
def extent_along(rotations, scales, j, axis, inverse):
    """Return an axis of a splat times its standard deviation, in units of the neighbourhood, not
    longer than 1."""
    length = min(np.float64(scales[j, axis]) * inverse, 1.0)
    x, y, z = column(rotations[j, 0], rotations[j, 1], rotations[j, 2], rotations[j, 3], axis)
    return x * length, y * length, z * length


@scalar
def companionship(distances, neighbors, i):
    """Return 1 for a splat as near to others as its neighbours are to each other, and 0 for a
    stray."""
    total, count = 0.0, 0
    for e in range(1, neighbors.shape[1]):
        j = neighbors[i, e]
        if j >= 0:
            total += distances[j, FEWEST]
            count += 1
    usual = total / max(count, 1)
    own = np.float64(distances[i, FEWEST])
    if not own > LONELY * usual:
        return 1.0
    return max(0.0, (ALONE - own / usual) / (ALONE - LONELY)) if usual > 0 else 0.0


# --- 2. CPU -----------------------------------------------------------------------------


@kernel(over="positions", writes=("axes", "flatness"))
def planes(i, positions, rotations, scales, weights, neighbors, distances, axes, flatness):
    """Compute the normal of the plane through each splat and its neighbours, of any sign.

    A neighbour counts by its weight times a factor that falls with distance, and with its own
    covariance.

    Args:
        positions: (n, 3) f32.
        rotations: Unit quaternions, (n, 4) f32.
        scales: (n, 3) f32.
        weights: Opacity times area [unit^2], (n,) f32.
        neighbors: Rows of the nearest splats, nearest first, the splat itself among them, -1 for
            none: (n, k) i32, k > FEWEST.
        distances: Their distances [unit], (n, k) f32.
        axes: Receives unit vectors, (n, 3) f32; the splat's own thin axis if there is no plane, and
            (0, 0, 1) if that is not finite.
        flatness: Receives 1 - l0 / l1 of the two smallest eigenvalues, (n,) f32: 1 on a sheet, 0 in
            a volume, for strays, and where there are too few neighbours.
    """
    x, y, z = thin_axis(rotations, scales, i)
    if not math.isfinite(x + y + z) or x * x + y * y + z * z == 0:
        x, y, z = np.float32(0), np.float32(0), np.float32(1)
    axes[i, 0], axes[i, 1], axes[i, 2] = x, y, z
    flatness[i] = 0
    last = neighbors.shape[1] - 1
    while last >= 0 and neighbors[i, last] < 0:
        last -= 1
    if last < 1 or not distances[i, last] > 0:
        return
    inverse = 1.0 / np.float64(distances[i, last])
    total, sx, sy, sz = 0.0, 0.0, 0.0, 0.0
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for e in range(last + 1):
        j = neighbors[i, e]
        t = distances[i, e] * inverse
        w = min(max(np.float64(weights[j]) * inverse * inverse, FAINT), 1.0)
        w *= max(1.0 - t * t, FAR)
        dx = (np.float64(positions[j, 0]) - positions[i, 0]) * inverse
        dy = (np.float64(positions[j, 1]) - positions[i, 1]) * inverse
        dz = (np.float64(positions[j, 2]) - positions[i, 2]) * inverse
        total += w
        sx, sy, sz = sx + w * dx, sy + w * dy, sz + w * dz
        xx, xy, xz = xx + w * dx * dx, xy + w * dx * dy, xz + w * dx * dz
        yy, yz, zz = yy + w * dy * dy, yz + w * dy * dz, zz + w * dz * dz
        for axis in range(3):
            dx, dy, dz = extent_along(rotations, scales, j, axis, inverse)
            xx, xy, xz = xx + w * dx * dx, xy + w * dx * dy, xz + w * dx * dz
            yy, yz, zz = yy + w * dy * dy, yz + w * dy * dz, zz + w * dz * dz
    sx, sy, sz = sx / total, sy / total, sz / total
    least, middle, x, y, z = least_axis(
        xx / total - sx * sx, xy / total - sx * sy, xz / total - sx * sz,
        yy / total - sy * sy, yz / total - sy * sz, zz / total - sz * sz,
    )  # fmt: skip
    if x * x + y * y + z * z > 0.5 and math.isfinite(x + y + z):
        axes[i, 0], axes[i, 1], axes[i, 2] = x, y, z
        if last >= FEWEST and middle > 0:
            flat = 1 - max(least, 0.0) / middle
            flatness[i] = flat * companionship(distances, neighbors, i)
