"""Signed distance and gradient of one solid in its own frame, negative inside.

Spheres and capsules are one family: the union of balls of radius `middle - grow * s` around the
points (0, 0, s), |s| <= half. All constants are exact in float32, so that the same code computes in
the precision of its arguments: float32 to find contacts, float64 to resolve them.

Source: the formulae by I. Quilez for a box and a round cone. For the round cone, the foot of the
normal on the axis is clamped instead of distinguishing three cases.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar

ROUND, BOX, PLANE, MESH = range(4)
"""Kinds of solids, as used in tables."""

FIELD_X, FIELD_Y, FIELD_Z, FIELD_VOXEL, FIELD_NX, FIELD_NY, FIELD_NZ, FIELD_START = range(8)
FIELD_COLUMNS = 8
"""Columns of a table of distance fields: centre of the first voxel [unit], edge of a voxel [unit],
number of voxels along each axis, and index of the first one in the array of all voxels."""

ZERO, HALF, ONE = np.float32(0), np.float32(0.5), np.float32(1)


@scalar
def round_foot(x, y, z, half, slope):
    """Return the point on the axis from which the normal through a point starts, and its
    distance."""
    across = math.sqrt(x * x + y * y)
    foot = min(max(z - across * slope, -half), half)
    along = z - foot
    return foot, math.sqrt(x * x + y * y + along * along)


@scalar
def round_distance(x, y, z, middle, grow, half, slope):
    """Return the distance to a capsule with ends of different radii.

    middle: mean radius [unit]. half: half the distance between the ends' centres [unit]. grow:
    decrease of the radius along z, |grow| < 1. slope: grow / sqrt(1 - grow^2).
    """
    foot, length = round_foot(x, y, z, half, slope)
    return length - (middle - grow * foot)


@scalar
def round_solid(x, y, z, middle, grow, half, slope):
    """Return `round_distance` with its gradient; on the axis, one of the possible gradients."""
    foot, length = round_foot(x, y, z, half, slope)
    distance = length - (middle - grow * foot)
    if length > ZERO:
        return distance, x / length, y / length, (z - foot) / length
    return distance, ONE + ZERO * x, ZERO * x, ZERO * x


@scalar
def box_distance(x, y, z, a, b, c):
    """Return the distance to a box with half edges (a, b, c) [unit]."""
    x, y, z = abs(x) - a, abs(y) - b, abs(z) - c
    u, v, w = max(x, ZERO), max(y, ZERO), max(z, ZERO)
    return math.sqrt(u * u + v * v + w * w) + min(max(x, max(y, z)), ZERO)


@scalar
def box_solid(x, y, z, a, b, c):
    """Return `box_distance` with its gradient; inside, the gradient for the nearest face."""
    u, v, w = abs(x) - a, abs(y) - b, abs(z) - c
    deepest = max(u, max(v, w))
    if deepest > ZERO:
        p, q, r = max(u, ZERO), max(v, ZERO), max(w, ZERO)
        length = math.sqrt(p * p + q * q + r * r)
    else:
        p = ONE if u == deepest else ZERO
        q = ONE if v == deepest and u != deepest else ZERO
        r = ONE - p - q
        length = ONE
        p, q, r = p + ZERO * x, q + ZERO * x, r + ZERO * x
    distance = length if deepest > ZERO else deepest
    return (
        distance,
        math.copysign(p / length, x),
        math.copysign(q / length, y),
        math.copysign(r / length, z),
    )


@scalar
def _cell(u, count):
    """Return the voxel before a coordinate [voxels] within the field, and the fraction after it."""
    first = min(int(u), count - 2)
    return first, u - first


@scalar
def field_solid(x, y, z, fields, field, voxels):
    """Return the distance to a mesh by its distance field, and the gradient of this distance.

    Between voxels it is trilinear. Outside the field it is the distance to the surface point that
    belongs to the field's nearest point, an upper bound with a small error.

    fields: shape (f, FIELD_COLUMNS) f64. voxels: voxels of all fields, x fastest, flat.
    """
    size = fields[field, FIELD_VOXEL]
    nx, ny = int(fields[field, FIELD_NX]), int(fields[field, FIELD_NY])
    nz = int(fields[field, FIELD_NZ])
    u = (x - fields[field, FIELD_X]) / size
    v = (y - fields[field, FIELD_Y]) / size
    w = (z - fields[field, FIELD_Z]) / size
    # Written so that NaN is read from inside the field, too.
    cu = min(u, nx - 1.0) if u > 0.0 else 0.0
    cv = min(v, ny - 1.0) if v > 0.0 else 0.0
    cw = min(w, nz - 1.0) if w > 0.0 else 0.0
    i, s = _cell(cu, nx)
    j, t = _cell(cv, ny)
    k, r = _cell(cw, nz)
    at = int(fields[field, FIELD_START]) + (k * ny + j) * nx + i
    up = at + nx * ny
    a, b, c, d = voxels[at], voxels[at + 1], voxels[at + nx], voxels[at + nx + 1]
    e, f, g, h = voxels[up], voxels[up + 1], voxels[up + nx], voxels[up + nx + 1]
    ab, cd, ef, gh = a + s * (b - a), c + s * (d - c), e + s * (f - e), g + s * (h - g)
    low, high = ab + t * (cd - ab), ef + t * (gh - ef)
    distance = low + r * (high - low)
    dx = (1.0 - r) * ((1.0 - t) * (b - a) + t * (d - c)) + r * ((1.0 - t) * (f - e) + t * (h - g))
    dy = (1.0 - r) * (cd - ab) + r * (gh - ef)
    dz = high - low
    ou, ov, ow = (u - cu) * size, (v - cv) * size, (w - cw) * size
    dx, dy, dz = dx / size, dy / size, dz / size
    slope = math.sqrt(dx * dx + dy * dy + dz * dz)
    if ou * ou + ov * ov + ow * ow > 0.0:
        # The surface point that is nearest to the field's nearest point.
        back = distance / slope if slope > 0.0 and distance > 0.0 else 0.0
        ou, ov, ow = ou + back * dx, ov + back * dy, ow + back * dz
        distance = math.sqrt(ou * ou + ov * ov + ow * ow)
        return distance, ou / distance, ov / distance, ow / distance
    return distance, dx, dy, dz


@scalar
def solid(kind, x, y, z, a, b, c, d, fields, field, voxels):
    """Return distance and gradient of a solid of any kind (float64).

    a, b, c, d: for ROUND: middle, grow, half, slope of `round_distance`; for BOX: half edges,
    unused; not used for PLANE (all z < 0 is inside) and MESH.
    """
    if kind == ROUND:
        return round_solid(x, y, z, a, b, c, d)
    if kind == BOX:
        return box_solid(x, y, z, a, b, c)
    if kind == MESH:
        return field_solid(x, y, z, fields, field, voxels)
    return z, 0.0 * z, 0.0 * z, ONE + 0.0 * z
