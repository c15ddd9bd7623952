"""Directions in which splats see the least matter, and their occlusion."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.normals.density import optical_depth

LIFT = 2.0
"""Distance from the plane of a splat at which its rays begin, so that they miss the sheet that it is
part of [cell]."""
START = 0.5
"""Length of the step before the first value along a ray [cell]."""
CONTRAST = 2.0
"""Factor on optical depths relative to the least one: how much the most open direction stands out."""
THIN = 0.5
"""Factor on optical depths. Matter is denser in grids than along rays, which pass between splats."""
BEST, LIGHT, SKY, VIEW = 0, 3, 6, 7
"""First columns of what a splat sees around it, and their number."""


# --- 1. mathematics ---------------------------------------------------------------------


@scalar
def tangents(x, y, z):
    """Return two unit vectors that form a right-handed frame with the unit vector (x, y, z).

    Source: Duff et al. 2017, "Building an orthonormal basis, revisited".
    """
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return 1.0 + sign * x * x * a, sign * b, -sign * x, b, sign + y * y * a, -y


# --- 2. CPU -----------------------------------------------------------------------------


@kernel(over="out", writes=("out",))
def look_around(s, positions, axes, stride, density, directions, reach, out):
    """Compute which directions are open, for each `stride`-th splat.

    Args:
        positions: In finest cells from the centre, (n, 3) f32.
        axes: Normals of any sign, (n, 3) f32.
        stride: Number of splats that share a result.
        density: See `density.deposit`.
        directions: Unit vectors all around, (m, 3) f32.
        reach: Length of the rays [cell].
        out: Receives (n / stride, VIEW) f32: in columns BEST the mean of the directions, weighted
            by transmittance relative to the most open one, times 4, which is about 1 long on a
            closed surface; in LIGHT the axis times the difference of the mean transmittances of
            both sides; in SKY the mean of these two.
    """
    i = s * stride
    x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
    ax, ay, az = np.float64(axes[i, 0]), np.float64(axes[i, 1]), np.float64(axes[i, 2])
    sx, sy, sz, least = 0.0, 0.0, 0.0, math.inf
    above, below, rays = 0.0, 0.0, 0
    if math.isfinite(x + y + z):
        for k in range(directions.shape[0]):
            dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
            side = ax * dx + ay * dy + az * dz
            lift = LIFT if side > 0 else -LIFT
            depth = optical_depth(
                density, x + lift * ax, y + lift * ay, z + lift * az, dx, dy, dz, START, reach
            )
            if depth < least:
                scale = math.exp(CONTRAST * (depth - least))
                sx, sy, sz, least = sx * scale, sy * scale, sz * scale, depth
            weight = math.exp(CONTRAST * (least - depth))
            sx, sy, sz = sx + weight * dx, sy + weight * dy, sz + weight * dz
            if side > 0:
                above, rays = above + math.exp(-THIN * depth), rays + 1
            else:
                below += math.exp(-THIN * depth)
        above /= max(rays, 1)
        below /= max(directions.shape[0] - rays, 1)
    scale = 4.0 / directions.shape[0]
    out[s, BEST], out[s, BEST + 1], out[s, BEST + 2] = sx * scale, sy * scale, sz * scale
    excess = above - below
    out[s, LIGHT], out[s, LIGHT + 1], out[s, LIGHT + 2] = excess * ax, excess * ay, excess * az
    out[s, SKY] = 0.5 * (above + below)


@kernel(over="normals", writes=("out",))
def occlusion(i, positions, normals, density, directions, lift, reach, out):
    """Compute which part of the hemisphere about its normal is hidden from each splat.

    Args:
        positions: In finest cells from the centre, (n, 3) f32.
        normals: Unit vectors, (n, 3) f32.
        density: See `density.deposit`.
        directions: Unit vectors about +z, distributed as their cosine, (m, 3) f32.
        lift: Distance from the splat along its normal at which rays begin [cell].
        reach: Length of the rays [cell].
        out: Receives 1 - mean transmittance, (n,) f32; 1 for splats that are not finite.
    """
    nx, ny, nz = np.float64(normals[i, 0]), np.float64(normals[i, 1]), np.float64(normals[i, 2])
    ax, ay, az, bx, by, bz = tangents(nx, ny, nz)
    x = positions[i, 0] + lift * nx
    y = positions[i, 1] + lift * ny
    z = positions[i, 2] + lift * nz
    total = 0.0
    if math.isfinite(x + y + z):
        for k in range(directions.shape[0]):
            u, v, w = directions[k, 0], directions[k, 1], directions[k, 2]
            dx = u * ax + v * bx + w * nx
            dy = u * ay + v * by + w * ny
            dz = u * az + v * bz + w * nz
            total += math.exp(-optical_depth(density, x, y, z, dx, dy, dz, START, reach))
    out[i] = 1.0 - total / directions.shape[0]
