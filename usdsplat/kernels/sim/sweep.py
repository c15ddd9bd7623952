"""Continuous collision: splats that a moving solid passes during a substep are kept in front of it.

Each solid is swept separately, in its own frame, in which a splat moves along a segment. The first
point of the segment within the clearance is a hit. From there the rest of the segment is followed
along the surface, slowed by friction, until its direction leads away from it. Planes are
half-spaces, which nothing can pass; they are left to `contact`.

Source: Mirtich 1996, "Impulse-based dynamic simulation of rigid body systems", for conservative
advancement; ray and capsule after I. Quilez.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from usdsplat.kernels.jit import parallel, scalar, serial
from usdsplat.kernels.sim.blend_solids import (
    BLOCK,
    CLEARANCE,
    FIELD,
    FRICTION,
    HIGH,
    KIND,
    LOW,
    PLACE,
    PLACE_BEFORE,
    RESTITUTION,
    SIZE,
    SWEPT,
    THIN,
    TURN,
    TURN_BEFORE,
    into,
    local_solid,
    respond,
    surface_velocity,
    times,
)
from usdsplat.kernels.sim.contact import ALIVE_ONLY, PINNED_OR_DEAD
from usdsplat.kernels.sim.solids import MESH, ROUND

ADVANCES = 32
"""Largest number of steps towards a surface."""
SLIDES = 256
"""Largest number of steps along a surface."""
STRIKES = 4
"""Largest number of times that a splat may leave a solid and hit it again."""
COARSE, FINE = 1e-3, 1e-4
"""1 - cos of the angle between normals along a step: the step is halved above COARSE and doubled
below FINE."""
FLAT = 1e-10
"""1 - cos above which a step is not doubled beyond THIN, as slight turns may grow exponentially."""

# --- where the segment hits -----------------------------------------------------------------------


@scalar
def ball_hit(x, y, z, dx, dy, dz, radius):
    """Return the fraction of a segment at which it enters a ball around the origin, inf without a
    hit."""
    a = dx * dx + dy * dy + dz * dz
    b = x * dx + y * dy + z * dz
    c = x * x + y * y + z * z - radius * radius
    root = b * b - a * c
    if root < 0.0 or b >= 0.0:
        return np.inf
    return c / (math.sqrt(root) - b)


@scalar
def capsule_hit(x, y, z, dx, dy, dz, half, radius):
    """Return `ball_hit` for a capsule along z with equal ends; inf from inside."""
    first = np.inf
    if half > 0.0:
        a = dx * dx + dy * dy
        b = x * dx + y * dy
        c = x * x + y * y - radius * radius
        root = b * b - a * c
        if root >= 0.0 and b < 0.0 and c >= 0.0:
            t = c / (math.sqrt(root) - b)
            if abs(z + t * dz) <= half:
                first = t
        low = ball_hit(x, y, z + half, dx, dy, dz, radius)
        high = ball_hit(x, y, z - half, dx, dy, dz, radius)
        return min(first, min(low, high))
    return ball_hit(x, y, z, dx, dy, dz, radius)


@scalar
def box_gap(bodies, j, x, y, z):
    """Return the distance of a point from the box of solid j, in its frame."""
    u = max(max(bodies[j, LOW] - x, x - bodies[j, HIGH]), 0.0)
    v = max(max(bodies[j, LOW + 1] - y, y - bodies[j, HIGH + 1]), 0.0)
    w = max(max(bodies[j, LOW + 2] - z, z - bodies[j, HIGH + 2]), 0.0)
    return math.sqrt(u * u + v * v + w * w)


@serial
def first_hit(bodies, j, fields, voxels, clearance, x, y, z, dx, dy, dz):
    """Return the fraction of the path, 0 to 1, at which a point moving inwards reaches the
    clearance [unit] of solid j, in its frame; inf without a hit.
    """
    d, gx, gy, gz = local_solid(bodies, j, SIZE, FIELD, fields, voxels, x, y, z)
    is_in = dx * gx + dy * gy + dz * gz < 0.0
    if d <= clearance:
        return 0.0 if is_in else np.inf
    if bodies[j, KIND] == ROUND and bodies[j, SIZE + 1] == 0.0:
        t = capsule_hit(
            x, y, z, dx, dy, dz, bodies[j, SIZE + 2], bodies[j, SIZE] + clearance
        )  # fmt: skip
        return t if t <= 1.0 else np.inf
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    close = 1e-3 * bodies[j, THIN]
    t = 0.0
    for _ in range(ADVANCES):
        u, v, w = x + t * dx, y + t * dy, z + t * dz
        d, gx, gy, gz = local_solid(bodies, j, SIZE, FIELD, fields, voxels, u, v, w)
        is_in = dx * gx + dy * gy + dz * gz < 0.0
        if bodies[j, KIND] == MESH:
            # Outside its field a mesh is at least as far as its box; no better bound is known.
            far = box_gap(bodies, j, u, v, w)
            d = far if far > 0.0 else d
        gap = d - clearance
        if gap <= close:
            if is_in:
                return t
            gap = 0.5 * bodies[j, THIN]
        t += max(gap, close) / length
        if t > 1.0:
            return np.inf
    return t


# --- along the surface ----------------------------------------------------------------------------


@scalar
def creep(nx, ny, nz, dx, dy, dz, friction):
    """Return the part of a unit step (dx, dy, dz) that remains on a surface of normal n.

    The part inwards is removed, and the part along the surface is reduced by Coulomb friction.
    """
    out = dx * nx + dy * ny + dz * nz
    if out >= 0.0:
        return dx, dy, dz
    tx, ty, tz = dx - out * nx, dy - out * ny, dz - out * nz
    length = math.sqrt(tx * tx + ty * ty + tz * tz)
    keep = max(0.0, 1.0 + friction * out / length) if length > 1e-9 else 0.0
    return tx * keep, ty * keep, tz * keep


@serial
def slide(bodies, j, fields, voxels, clearance, x, y, z, dx, dy, dz, way):
    """Move a distance `way` [unit] in a unit direction from the surface of solid j, along it while
    pressed.

    Uses the midpoint rule. Steps start with a quarter of THIN and are adapted to the surface's
    curvature.

    Returns:
        position (3), normal there (3), remaining distance [unit], whether it is still pressed.
    """
    friction = bodies[j, FRICTION]
    step = least = 0.25 * bodies[j, THIN]
    least *= 0.125
    d, nx, ny, nz = local_solid(bodies, j, SIZE, FIELD, fields, voxels, x, y, z)
    if d < clearance:
        x, y, z = x + (clearance - d) * nx, y + (clearance - d) * ny, z + (clearance - d) * nz
        d, nx, ny, nz = local_solid(bodies, j, SIZE, FIELD, fields, voxels, x, y, z)
    for _ in range(SLIDES):
        if dx * nx + dy * ny + dz * nz >= 0.0:
            return x, y, z, nx, ny, nz, way, False
        tx, ty, tz = creep(nx, ny, nz, dx, dy, dz, friction)
        if way <= 0.0 or tx * tx + ty * ty + tz * tz < 1e-18:
            break
        step = min(step, way)
        u, v, w = x + 0.5 * step * tx, y + 0.5 * step * ty, z + 0.5 * step * tz
        _, mx, my, mz = local_solid(bodies, j, SIZE, FIELD, fields, voxels, u, v, w)
        tx, ty, tz = creep(mx, my, mz, dx, dy, dz, friction)
        u, v, w = x + step * tx, y + step * ty, z + step * tz
        d, mx, my, mz = local_solid(bodies, j, SIZE, FIELD, fields, voxels, u, v, w)
        turn = 1.0 - (mx * nx + my * ny + mz * nz)
        if turn > COARSE and step > least:
            step *= 0.5
            continue
        way -= step
        if turn < FINE and (step < bodies[j, THIN] or turn < FLAT):
            step *= 2.0
        # While pressed, the point stays on the surface. Before a corner it may have left it.
        if d < clearance or dx * mx + dy * my + dz * mz < 0.0:
            u, v, w = u + (clearance - d) * mx, v + (clearance - d) * my, w + (clearance - d) * mz
        x, y, z, nx, ny, nz = u, v, w, mx, my, mz
    return x, y, z, nx, ny, nz, 0.0, True


@serial
def sweep_row(bodies, j, fields, voxels, dt, clearance, i, started, positions, velocities):
    """Sweep solid j past splat i; return whether it hit the splat."""
    ax, ay, az = into(
        bodies, j, TURN_BEFORE, PLACE_BEFORE,
        np.float64(started[i, 0]), np.float64(started[i, 1]), np.float64(started[i, 2]),
    )  # fmt: skip
    bx, by, bz = into(
        bodies, j, TURN, PLACE,
        np.float64(positions[i, 0]), np.float64(positions[i, 1]), np.float64(positions[i, 2]),
    )  # fmt: skip
    dx, dy, dz = bx - ax, by - ay, bz - az
    way = math.sqrt(dx * dx + dy * dy + dz * dz)
    if not way > bodies[j, THIN]:
        return False
    dx, dy, dz = dx / way, dy / way, dz / way
    ends, others = (ax, ay, az), (bx, by, bz)
    for axis in range(3):
        if (
            min(ends[axis], others[axis]) > bodies[j, HIGH + axis] + clearance
            or max(ends[axis], others[axis]) < bodies[j, LOW + axis] - clearance
        ):
            return False
    nx, ny, nz = 0.0, 0.0, 0.0
    struck = pressed = False
    for _ in range(STRIKES):
        t = first_hit(
            bodies, j, fields, voxels, clearance, ax, ay, az, dx * way, dy * way, dz * way
        )
        if not t <= 1.0:
            break
        struck = True
        ax, ay, az = ax + t * way * dx, ay + t * way * dy, az + t * way * dz
        ax, ay, az, nx, ny, nz, way, pressed = slide(
            bodies, j, fields, voxels, clearance, ax, ay, az, dx, dy, dz, way - t * way
        )
        if pressed or way <= 0.0:
            break
    if not struck:
        return False
    x, y, z = times(bodies, j, TURN, ax + way * dx, ay + way * dy, az + way * dz)
    x, y, z = x + bodies[j, PLACE], y + bodies[j, PLACE + 1], z + bodies[j, PLACE + 2]
    if pressed:
        nx, ny, nz = times(bodies, j, TURN, nx, ny, nz)
        sx, sy, sz = surface_velocity(bodies, j, fields, voxels, 1.0 / dt, x, y, z)
        vx, vy, vz = respond(
            velocities[i, 0], velocities[i, 1], velocities[i, 2],
            sx, sy, sz, nx, ny, nz, bodies[j, FRICTION], bodies[j, RESTITUTION],
        )  # fmt: skip
        velocities[i, 0], velocities[i, 1], velocities[i, 2] = vx, vy, vz
    positions[i, 0], positions[i, 1], positions[i, 2] = x, y, z
    return True


# --- a block of splats ----------------------------------------------------------------------------


@scalar
def may_pass(bodies, j, before, after, far, reach):
    """Return whether solid j may pass a splat between two boxes, as (centre (3), half extent (3)),
    when no splat moves further than `far`."""
    bx, by, bz = into(bodies, j, TURN_BEFORE, PLACE_BEFORE, before[0], before[1], before[2])
    ax, ay, az = into(bodies, j, TURN, PLACE, after[0], after[1], after[2])
    cx, cy, cz = into(bodies, j, TURN_BEFORE, PLACE_BEFORE, after[0], after[1], after[2])
    total = 0.0
    first, last = (bx, by, bz), (ax, ay, az)
    misses = False
    for axis in range(3):
        own = reach
        was = reach
        for k in range(3):
            turn = bodies[j, TURN + 3 * k + axis]
            old = bodies[j, TURN_BEFORE + 3 * k + axis]
            own += abs(turn) * after[3 + k]
            was += abs(old) * before[3 + k]
            total += abs(turn - old) * after[3 + k]
        low = min(first[axis] - was, last[axis] - own)
        high = max(first[axis] + was, last[axis] + own)
        if low > bodies[j, HIGH + axis] or high < bodies[j, LOW + axis]:
            misses = True
    shift = math.sqrt((ax - cx) ** 2 + (ay - cy) ** 2 + (az - cz) ** 2)
    return not misses and shift + total + far > bodies[j, THIN]


@serial
def sweep_block(
    block, bodies, fields, voxels, dt, clearance, started, flags, scales, positions, velocities,
    since, struck, near, counts,
):  # fmt: skip
    """Sweep all solids past one block of splats; for the arguments see `sweep`."""
    n = positions.shape[0]
    start, end = block * BLOCK, min(n, (block + 1) * BLOCK)
    counts[block] = 0
    alx, aly, alz = started[start, 0], started[start, 1], started[start, 2]
    ahx, ahy, ahz = alx, aly, alz
    blx, bly, blz = positions[start, 0], positions[start, 1], positions[start, 2]
    bhx, bhy, bhz, largest, moved = blx, bly, blz, scales[start, 0], np.float32(0)
    for i in range(start, end):
        x, y, z = started[i, 0], started[i, 1], started[i, 2]
        alx, aly, alz = min(alx, x), min(aly, y), min(alz, z)
        ahx, ahy, ahz = max(ahx, x), max(ahy, y), max(ahz, z)
        u, v, w = positions[i, 0], positions[i, 1], positions[i, 2]
        blx, bly, blz = min(blx, u), min(bly, v), min(blz, w)
        bhx, bhy, bhz = max(bhx, u), max(bhy, v), max(bhz, w)
        u, v, w = u - x, v - y, w - z
        moved = max(moved, u * u + v * v + w * w)
        largest = max(largest, max(scales[i, 0], max(scales[i, 1], scales[i, 2])))
    before = (
        0.5 * (alx + ahx), 0.5 * (aly + ahy), 0.5 * (alz + ahz),
        0.5 * (ahx - alx), 0.5 * (ahy - aly), 0.5 * (ahz - alz),
    )  # fmt: skip
    after = (
        0.5 * (blx + bhx), 0.5 * (bly + bhy), 0.5 * (blz + bhz),
        0.5 * (bhx - blx), 0.5 * (bhy - bly), 0.5 * (bhz - blz),
    )  # fmt: skip
    found = np.int64(0)
    for j in range(bodies.shape[0]):
        if bodies[j, SWEPT] != 0.0 and may_pass(
            bodies, j, before, after, 1.001 * math.sqrt(moved), 1.001 * clearance * largest
        ):
            near[block, found] = j
            found += 1
    if found == 0:
        return
    for i in range(start, end):
        if flags[i] & PINNED_OR_DEAD != ALIVE_ONLY:
            continue
        sigma = np.float64(max(scales[i, 0], max(scales[i, 1], scales[i, 2])))
        for s in range(found):
            j = np.int64(near[block, s])
            if sweep_row(
                bodies, j, fields, voxels, dt, bodies[j, CLEARANCE] * sigma, i, started,
                positions, velocities,
            ):  # fmt: skip
                since[i] = 0.0
                struck[i] = 1
                counts[block] += 1


@parallel(
    writes=("positions", "velocities", "since", "struck", "near", "counts"), gpu="sim.sweep.sweep"
)
def sweep(
    bodies, fields, voxels, dt, clearance, started, flags, scales, positions, velocities, since,
    struck, near, counts,
):  # fmt: skip
    """Keep every solid with SWEPT set from passing a splat during a substep.

    For the arguments see `contact`. counts: receives the hits in each block, shape (blocks,) i64.
    struck: set to 1 for splats that were hit, shape (n,) u8.
    """
    for block in prange(counts.shape[0]):
        sweep_block(
            np.int64(block), bodies, fields, voxels, dt, clearance, started, flags, scales,
            positions, velocities, since, struck, near, counts,
        )  # fmt: skip
