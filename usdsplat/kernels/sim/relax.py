"""Relaxation to even spacing: splats that are too close repel each other, along their surface.

Source: Turk 1991, "Generating textures on arbitrary surfaces using reaction-diffusion", for
repulsion; Lagae & Dutré 2008 on measures of evenness; Müller et al. 2007, "Position based
dynamics", for simultaneous moves.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import reduction

from .grid import squared_distance
from .support import falloff

RANGE = np.float32(1.8)
"""Distance from which splats do not repel each other, in spacings."""
LONGEST = np.float32(0.25)
"""Longest step of a sweep, in spacings."""
ASIDE = np.float32(0.1)
"""Distance from the neighbours' centroid, in radii, from which a splat may be on a border.

On a straight border it is 0.26.
"""
CONE = np.float32(0.5)
"""Cosine of the half angle of a cone around the direction away from the centroid. A splat with a
neighbour in this cone is not on a border."""
RETURN = np.float32(0.5)
"""Fraction of the distance to the surface by which a sweep moves splats back."""

# --- 1. mathematics ---------------------------------------------------------------------


@scalar
def push(d2, own, other):
    """Return the fraction of the offset from a neighbour by which a splat is pushed away, f32.

    own, other: spacings of the two [unit].
    """
    reach = RANGE * np.float32(0.5) * (own + other)
    d = np.float32(math.sqrt(d2))
    if not (d > 0 and d < reach):
        return np.float32(0)
    return (np.float32(1) - d / reach) / d


# --- 2. CPU -----------------------------------------------------------------------------


@reduction(over="positions", by="sum", writes=("out",))
def sweep(s, positions, support, normals, order, rows, neighbors, unit, strength, out):
    """Move a splat once, relative to the old positions of others, and return its step, in spacings.

    The kernel's result is the sum over all splats.

    Args:
        positions, support, order, rows, neighbors: Those of a graph with lists within either's
            radius.
        normals: By slot, (n, 3) f32. Splats move in the plane, and half of the distance back to the
            surface of their neighbours. Splats with zeros move in any direction.
        unit: Spacing relative to the radius, f32.
        strength: Factor on the step, in spacings, f32.
        out: Receives positions by row, (n, 3) f32.
    """
    zero = np.float32(0)
    x, y, z = positions[s, 0], positions[s, 1], positions[s, 2]
    nx, ny, nz = normals[s, 0], normals[s, 1], normals[s, 2]
    spacing = unit * support[s]
    i = order[s]
    out[i, 0], out[i, 1], out[i, 2] = x, y, z
    if not (spacing > 0 and rows[s + 1] > rows[s]):
        return 0.0
    inverse = np.float32(1) / (support[s] * support[s])
    fx, fy, fz = zero, zero, zero
    weights, height, mx, my, mz = zero, zero, zero, zero, zero
    cx, cy, cz = zero, zero, zero
    for e in range(rows[s], rows[s + 1]):
        j = neighbors[e]
        px, py, pz = positions[j, 0], positions[j, 1], positions[j, 2]
        d2 = squared_distance(px, py, pz, x, y, z)
        dx, dy, dz = x - px, y - py, z - pz
        f = push(d2, spacing, unit * support[j])
        fx, fy, fz = fx + f * dx, fy + f * dy, fz + f * dz
        ox, oy, oz = normals[j, 0], normals[j, 1], normals[j, 2]
        w = falloff(d2 * inverse)
        side = w if ox * nx + oy * ny + oz * nz >= 0 else -w
        ox, oy, oz = w * nx + side * ox, w * ny + side * oy, w * nz + side * oz
        weights += w
        cx, cy, cz = cx + w * dx, cy + w * dy, cz + w * dz
        height += ox * dx + oy * dy + oz * dz
        mx, my, mz = mx + ox, my + oy, mz + oz
    along = fx * nx + fy * ny + fz * nz
    fx, fy, fz = fx - along * nx, fy - along * ny, fz - along * nz
    along = cx * nx + cy * ny + cz * nz
    cx, cy, cz = cx - along * nx, cy - along * ny, cz - along * nz
    away = np.float32(math.sqrt(cx * cx + cy * cy + cz * cz))
    # Splats on a border do not move outwards: repulsion from one side only would make the surface
    # grow without limit.
    if away > ASIDE * weights * support[s]:
        cx, cy, cz = cx / away, cy / away, cz / away
        outward = fx * cx + fy * cy + fz * cz
        is_border = outward > 0
        for e in range(rows[s], rows[s + 1]):
            j = neighbors[e]
            dx, dy, dz = positions[j, 0] - x, positions[j, 1] - y, positions[j, 2] - z
            d2 = dx * dx + dy * dy + dz * dz
            d = np.float32(math.sqrt(d2))
            ahead = dx * cx + dy * cy + dz * cz > CONE * d
            is_border &= not (ahead and d < support[s])
        if is_border:
            fx, fy, fz = fx - outward * cx, fy - outward * cy, fz - outward * cz
    length = np.float32(math.sqrt(fx * fx + fy * fy + fz * fz))
    step = strength * spacing * min(np.float32(1), LONGEST / max(strength * length, LONGEST))
    fx, fy, fz = step * fx, step * fy, step * fz
    # A chord makes equal angles with both normals of an arc, so the mean of both normals keeps a
    # splat of a sphere on it. The centroid of its neighbours would move it inwards.
    back = zero
    if weights > 0:
        back = -RETURN * np.float32(0.5) * (height + mx * fx + my * fy + mz * fz) / weights
    out[i, 0] = x + fx + back * nx
    out[i, 1] = y + fy + back * ny
    out[i, 2] = z + fz + back * nz
    return np.float64(step * length / spacing)
