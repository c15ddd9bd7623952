"""Smooth union of moving solids: its distance, gradient, velocity and contact response at a point.

Solids are joined in the order of their table by the quadratic smooth minimum, each with its own
blending distance. The union starts with the first solid: starting with a large number would cancel
all digits of the distances joined to it.

Source: I. Quilez 2013, "Smooth minimum".
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar, serial
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.sim.solids import HALF, ONE, ROUND, ZERO, round_distance, solid

BLOCK = 1024
NOTHING = 1e30
"""Distance [unit] if there is no solid."""
TINY = np.float32(1e-30)
RIDGE = 0.3
"""Length of the blended gradient under which it is not used for the outward direction."""

(
    KIND,
    FIELD,
    FIELD_BEFORE,
    BLEND,
    CLEARANCE,
    FRICTION,
    RESTITUTION,
    SWEPT,
    THIN,
    RESHAPES,
    BOUND,
) = range(11)
CENTRE, SIZE, SIZE_BEFORE, LOW, HIGH = 11, 14, 18, 22, 25
TURN, PLACE, TURN_BEFORE, PLACE_BEFORE, SLIP, SHIFT = 28, 37, 40, 49, 52, 61
COLUMNS = 64
"""Columns of the table of solids, float64. Values are those at the end of a substep, if not stated
otherwise.

KIND: see solids.py. FIELD, FIELD_BEFORE: index of the distance field at the end and at the start.
BLEND [unit]. CLEARANCE [sigma]. FRICTION: coefficient. RESTITUTION. SWEPT: whether splats are
swept, see sweep.py. THIN: motion [unit] above which the solid may pass a splat unnoticed. RESHAPES:
whether its shape at the start differs. BOUND: radius [unit] of a bounding sphere about CENTRE (3,
simulation space). SIZE, SIZE_BEFORE (4): arguments a to d of `solid`. LOW, HIGH (3): bounding box
in the solid's frame. TURN (9, row-major), PLACE (3): transformation from the solid's frame to
simulation space; TURN_BEFORE, PLACE_BEFORE: the same at the start. SLIP (9), SHIFT (3): the
velocity [unit/s] of its material at x is SLIP x + SHIFT."""


@scalar
def join(d, e, blend):
    """Return the weight of e, 0 to 1, in the smooth minimum of d and e, and that minimum."""
    part = min(max(HALF + HALF * (d - e) / max(blend, TINY), ZERO), ONE)
    return part, d + (e - d) * part - blend * part * (ONE - part)


@scalar
def into(bodies, j, turn, place, x, y, z):
    """Transform a point from simulation space to the frame of solid j."""
    x, y, z = x - bodies[j, place], y - bodies[j, place + 1], z - bodies[j, place + 2]
    return (
        bodies[j, turn] * x + bodies[j, turn + 3] * y + bodies[j, turn + 6] * z,
        bodies[j, turn + 1] * x + bodies[j, turn + 4] * y + bodies[j, turn + 7] * z,
        bodies[j, turn + 2] * x + bodies[j, turn + 5] * y + bodies[j, turn + 8] * z,
    )


@scalar
def times(bodies, j, first, x, y, z):
    """Multiply a vector by one of the matrices of solid j."""
    return (
        bodies[j, first] * x + bodies[j, first + 1] * y + bodies[j, first + 2] * z,
        bodies[j, first + 3] * x + bodies[j, first + 4] * y + bodies[j, first + 5] * z,
        bodies[j, first + 6] * x + bodies[j, first + 7] * y + bodies[j, first + 8] * z,
    )


@serial
def local_solid(bodies, j, size, field, fields, voxels, x, y, z):
    """Return distance and gradient of solid j at a point in its own frame."""
    return solid(
        int(bodies[j, KIND]), x, y, z,
        bodies[j, size], bodies[j, size + 1], bodies[j, size + 2], bodies[j, size + 3],
        fields, int(bodies[j, field]), voxels,
    )  # fmt: skip


@scalar
def is_far(bodies, j, reach, x, y, z):
    """Return whether solid j is certainly further than `reach` [unit]."""
    x, y, z = x - bodies[j, CENTRE], y - bodies[j, CENTRE + 1], z - bodies[j, CENTRE + 2]
    limit = bodies[j, BOUND] + reach
    return x * x + y * y + z * z > limit * limit


@serial
def union(bodies, rows, count, fields, voxels, x, y, z, sigma, reach):
    """Return the distance to the union less the clearance, and the outward direction.

    Args:
        bodies: Table of solids, shape (k, COLUMNS) f64.
        rows: Solids to join, ascending: the first `count` entries, i32.
        fields, voxels: See `field_solid`.
        x, y, z: Point in simulation space [unit], float64.
        sigma: Largest standard deviation of the splat [unit].
        reach: Solids further than this [unit] are skipped. With at least three times the largest
            blending distance plus the clearance, negative results do not change.

    Returns:
        distance less clearance [unit], its gradient (3), outward direction of the solid in which
        the point is deepest (3).
    """
    d, gx, gy, gz = NOTHING, 0.0, 0.0, 0.0
    least, nx, ny, nz = NOTHING, 0.0, 0.0, 1.0
    for s in range(count):
        j = np.int64(rows[s])
        if is_far(bodies, j, reach, x, y, z):
            continue
        u, v, w = into(bodies, j, TURN, PLACE, x, y, z)
        if bodies[j, KIND] == ROUND and d != NOTHING:
            # Most solids do not change the union. Their distance alone is enough to test it.
            e = round_distance(
                u, v, w,
                bodies[j, SIZE], bodies[j, SIZE + 1], bodies[j, SIZE + 2], bodies[j, SIZE + 3],
            )  # fmt: skip
            if e - bodies[j, CLEARANCE] * sigma > least + bodies[j, BLEND]:
                continue
        e, u, v, w = local_solid(bodies, j, SIZE, FIELD, fields, voxels, u, v, w)
        u, v, w = times(bodies, j, TURN, u, v, w)
        e -= bodies[j, CLEARANCE] * sigma
        if e < least:
            least = e
            length = math.sqrt(u * u + v * v + w * w)
            if length > 1e-6:
                nx, ny, nz = u / length, v / length, w / length
            else:
                nx, ny, nz = 0.0, 0.0, 1.0
        if d == NOTHING:
            d, gx, gy, gz = e, u, v, w
            continue
        part, d = join(d, e, bodies[j, BLEND])
        gx, gy, gz = gx + (u - gx) * part, gy + (v - gy) * part, gz + (w - gz) * part
    return d, gx, gy, gz, nx, ny, nz


@scalar
def outward(gx, gy, gz, nx, ny, nz):
    """Return the outward unit vector for the results of `union`, and the slope of the distance
    along it."""
    length = math.sqrt(gx * gx + gy * gy + gz * gz)
    if length < RIDGE:
        return nx, ny, nz, 1.0
    return gx / length, gy / length, gz / length, length


@serial
def surface_velocity(bodies, j, fields, voxels, per_dt, x, y, z):
    """Return the velocity [unit/s] of the surface of solid j at x: the mean velocity of its
    material over the substep plus that of its change of shape, if any.

    per_dt: 1 / duration of the substep [1/s].
    """
    sx, sy, sz = times(bodies, j, SLIP, x, y, z)
    sx, sy, sz = sx + bodies[j, SHIFT], sy + bodies[j, SHIFT + 1], sz + bodies[j, SHIFT + 2]
    if bodies[j, RESHAPES] != 0.0:
        u, v, w = into(bodies, j, TURN, PLACE, x, y, z)
        old, _, _, _ = local_solid(bodies, j, SIZE_BEFORE, FIELD_BEFORE, fields, voxels, u, v, w)
        new, u, v, w = local_solid(bodies, j, SIZE, FIELD, fields, voxels, u, v, w)
        speed = (old - new) * per_dt
        u, v, w = times(bodies, j, TURN, u, v, w)
        sx, sy, sz = sx + u * speed, sy + v * speed, sz + w * speed
    return sx, sy, sz


@serial
def touch(bodies, rows, count, fields, voxels, per_dt, x, y, z, sigma, reach):
    """Return velocity and contact coefficients of the joined surface at a point.

    They are blended like distances in `union`.

    Returns:
        velocity (3) [unit/s], coefficient of friction, restitution.
    """
    d, sx, sy, sz, friction, restitution = NOTHING, 0.0, 0.0, 0.0, 0.0, 0.0
    for s in range(count):
        j = np.int64(rows[s])
        if is_far(bodies, j, reach, x, y, z):
            continue
        u, v, w = into(bodies, j, TURN, PLACE, x, y, z)
        e, _, _, _ = local_solid(bodies, j, SIZE, FIELD, fields, voxels, u, v, w)
        e -= bodies[j, CLEARANCE] * sigma
        u, v, w = surface_velocity(bodies, j, fields, voxels, per_dt, x, y, z)
        f, r = bodies[j, FRICTION], bodies[j, RESTITUTION]
        if d == NOTHING:
            d, sx, sy, sz, friction, restitution = e, u, v, w, f, r
            continue
        part, d = join(d, e, bodies[j, BLEND])
        sx, sy, sz = sx + (u - sx) * part, sy + (v - sy) * part, sz + (w - sz) * part
        friction = friction + (f - friction) * part
        restitution = restitution + (r - restitution) * part
    return sx, sy, sz, friction, restitution


@scalar
def respond(vx, vy, vz, sx, sy, sz, nx, ny, nz, friction, restitution):
    """Return the velocity after contact with a surface of normal n and velocity s: outwards at
    least as fast as the surface, with Coulomb friction along it."""
    vx, vy, vz = vx - sx, vy - sy, vz - sz
    out = vx * nx + vy * ny + vz * nz
    if out >= 0.0:
        return vx + sx, vy + sy, vz + sz
    push = -(1.0 + restitution) * out
    tx, ty, tz = vx - out * nx, vy - out * ny, vz - out * nz
    speed = math.sqrt(tx * tx + ty * ty + tz * tz)
    keep = max(0.0, 1.0 - friction * push / speed) if speed > 0.0 else 0.0
    out = -restitution * out
    return tx * keep + out * nx + sx, ty * keep + out * ny + sy, tz * keep + out * nz + sz


@kernel(over="positions", writes=("out",))
def union_distances(i, bodies, rows, fields, voxels, positions, out):
    """Compute the distance [unit] of every point from the union of all `rows`.

    positions: (n, 3) f32. out: (n,) f32.
    """
    out[i] = union(
        bodies, rows, rows.shape[0], fields, voxels,
        np.float64(positions[i, 0]), np.float64(positions[i, 1]),
        np.float64(positions[i, 2]), 0.0, np.inf,
    )[0]  # fmt: skip
