"""Directions in which splats see the least matter, and their occlusion."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.launch import kernel
from usdsplat.kernels.normals.density import optical_depth

LIFT = 2.0
"""Distance from the plane of a splat at which its rays begin, so that they miss the sheet that it
is part of [cell]."""
START = 0.5
"""Length of the step before the first value along a ray [cell]."""
CONTRAST = 2.0
"""Factor on optical depths relative to the least one: how much the most open direction stands
out."""
THIN = 0.5
"""Factor on optical depths. Matter is denser in grids than along rays, which pass between
splats."""
BEST, LIGHT, SKY, VIEW = 0, 3, 6, 7
"""First columns of what a splat sees around it, and their number."""


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
            both sides, weighted by the cosine to the axis; in SKY the mean of these two.
    """
    i = s * stride
    x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
    ax, ay, az = np.float64(axes[i, 0]), np.float64(axes[i, 1]), np.float64(axes[i, 2])
    sx, sy, sz, least = 0.0, 0.0, 0.0, math.inf
    above, below, all_above, all_below = 0.0, 0.0, 0.0, 0.0
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
                above, all_above = above + side * math.exp(-THIN * depth), all_above + side
            else:
                below, all_below = below - side * math.exp(-THIN * depth), all_below - side
        above = above / all_above if all_above > 0 else 0.0
        below = below / all_below if all_below > 0 else 0.0
    scale = 4.0 / directions.shape[0]
    out[s, BEST], out[s, BEST + 1], out[s, BEST + 2] = sx * scale, sy * scale, sz * scale
    excess = above - below
    out[s, LIGHT], out[s, LIGHT + 1], out[s, LIGHT + 2] = excess * ax, excess * ay, excess * az
    out[s, SKY] = 0.5 * (above + below)


@kernel(over="normals", writes=("out",))
def occlusion(i, normals, views, out):
    """Compute the part of the sky above each splat that matter hides.

    Args:
        normals: Unit vectors, (n, 3) f32.
        views: Means of what splats see around them, (n, VIEW) f32, see `look_around`.
        out: Receives 0 under the open sky to 1, (n,) f32.
    """
    light = np.float64(0)
    for c in range(3):
        light += np.float64(normals[i, c]) * views[i, LIGHT + c]
    out[i] = min(max(1.0 - (views[i, SKY] + 0.5 * light), 0.0), 1.0)
