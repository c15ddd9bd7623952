"""Optical density of splats on nested grids, and optical depths along rays.

The grids have the same number of cells and the same centre; each is twice as wide as the one
before. Rays take longer steps in coarser grids the farther they are, like the cones of Crassin et
al. 2011, "Interactive indirect illumination using voxel cone tracing".
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from usdsplat.kernels.jit import parallel, scalar
from usdsplat.kernels.normals.axes import column

HALF_WIDTH = math.sqrt(3)
"""Distance of the outer points of the quadrature of a Gaussian [standard deviation], whose weights
are 1/6, 2/3, 1/6 (Gauss-Hermite)."""
SPREAD = 0.4
"""Width of a cone at distance 1."""
DARK = 20.0
"""Optical depth at which a ray ends."""


# --- 1. mathematics: one ray ------------------------------------------------------------


@scalar
def level_at(x, y, z, levels, cells):
    """Return the finest grid that contains a point; coordinates in finest cells from the centre."""
    most = max(abs(x), abs(y), abs(z))
    half = 0.5 * cells - 1.0
    level = 0
    while level < levels - 1 and most > half:
        half *= 2
        level += 1
    return level


@scalar
def density_at(density, level, x, y, z):
    """Interpolate the density of a grid at a point; 0 outside.

    Args:
        density: See `deposit`.
        level: Number of the grid.
        x, y, z: In finest cells from the centre.
    """
    cells = density.shape[1]
    inverse = 0.5**level
    middle = 0.5 * cells - 0.5
    u, v, w = x * inverse + middle, y * inverse + middle, z * inverse + middle
    if not (u >= 0 and v >= 0 and w >= 0 and u < cells - 1 and v < cells - 1 and w < cells - 1):
        return 0.0
    i, j, k = np.uint64(u), np.uint64(v), np.uint64(w)
    one = np.uint64(1)
    a, b, c = u - np.float64(i), v - np.float64(j), w - np.float64(k)
    near = (density[level, k, j, i] * (1 - a) + density[level, k, j, i + one] * a) * (1 - b) + (
        density[level, k, j + one, i] * (1 - a) + density[level, k, j + one, i + one] * a
    ) * b
    k += one
    far = (density[level, k, j, i] * (1 - a) + density[level, k, j, i + one] * a) * (1 - b) + (
        density[level, k, j + one, i] * (1 - a) + density[level, k, j + one, i + one] * a
    ) * b
    return near * (1 - c) + far * c


@scalar
def optical_depth(density, x, y, z, dx, dy, dz, first, reach):
    """Return the optical depth along a ray, at most about DARK.

    Args:
        density: See `deposit`.
        x, y, z: Origin, in finest cells from the centre.
        dx, dy, dz: Unit direction.
        first, reach: Distances between which matter counts [finest cell].
    """
    levels, cells = density.shape[0], density.shape[1]
    t, depth = first, 0.0
    while t < reach and depth < DARK:
        px, py, pz = x + dx * t, y + dy * t, z + dz * t
        level = level_at(px, py, pz, levels, cells)
        step = 2.0**level
        while level < levels - 1 and 2 * step <= SPREAD * t:
            level += 1
            step *= 2
        step = min(step, reach - t)
        depth += density_at(density, level, px, py, pz) * step
        t += step
    return depth


# --- 2. CPU -----------------------------------------------------------------------------


@parallel(writes=("density",))
def deposit(positions, rotations, scales, masses, density):
    """Fill the grids: each splat is nine points on its ellipse.

    Args:
        positions: In finest cells from the centre, (n, 3) f32; those that are not finite count
            nowhere.
        rotations: Unit quaternions, (n, 4) f32.
        scales: [finest cell], (n, 3) f32.
        masses: Integral of the optical depth over the splat's area [finest cell^2], (n,) f32.
        density: Receives optical depth per length [1 / finest cell], (levels, cells, cells, cells)
            f32, with axes level, z, y, x.
    """
    levels, cells = density.shape[0], density.shape[1]
    for level in prange(levels):
        inverse = 0.5**level
        density[level] = 0
        for i in range(positions.shape[0]):
            thin = 0
            for a in range(1, 3):
                if scales[i, a] < scales[i, thin]:
                    thin = a
            p, q = (thin + 1) % 3, (thin + 2) % 3
            w, x, y, z = rotations[i, 0], rotations[i, 1], rotations[i, 2], rotations[i, 3]
            ax, ay, az = column(w, x, y, z, p)
            bx, by, bz = column(w, x, y, z, q)
            along, across = HALF_WIDTH * scales[i, p], HALF_WIDTH * scales[i, q]
            for point in range(9):
                u, v = point % 3 - 1, point // 3 - 1
                part = (2 / 3 if u == 0 else 1 / 6) * (2 / 3 if v == 0 else 1 / 6)
                s, t = u * along, v * across
                gx = (positions[i, 0] + s * ax + t * bx) * inverse + 0.5 * cells
                gy = (positions[i, 1] + s * ay + t * by) * inverse + 0.5 * cells
                gz = (positions[i, 2] + s * az + t * bz) * inverse + 0.5 * cells
                if (
                    gx >= 0 and gy >= 0 and gz >= 0 and gx < cells and gy < cells and gz < cells
                ):  # fmt: skip
                    density[level, np.int64(gz), np.int64(gy), np.int64(gx)] += (
                        part * masses[i] * (inverse * inverse * inverse)
                    )
