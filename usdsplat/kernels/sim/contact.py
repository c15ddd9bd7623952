"""Move splats out of the union of solids, apply friction, and update their velocities.

Blocks of rows are tested against boxes first. The splats of the remaining blocks are tested against
the near solids in float32. Those that may touch are resolved in float64 against all solids. A splat
that this kernel leaves outside is outside in float64 arithmetic on its float32 position.

Source: Macklin et al. 2014, "Unified particle physics", for friction by positions.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from usdsplat.kernels.jit import parallel, scalar, serial
from usdsplat.kernels.sim.blend_solids import (
    BLEND,
    BLOCK,
    BOUND,
    CLEARANCE,
    FIELD,
    HIGH,
    KIND,
    LOW,
    PLACE,
    RIDGE,
    SIZE,
    TURN,
    into,
    join,
    outward,
    respond,
    touch,
    union,
)
from usdsplat.kernels.sim.solids import (
    BOX,
    MESH,
    PLANE,
    ROUND,
    box_distance,
    field_solid,
    round_distance,
)

NEWTON, MARCH = 4, 256
ROUNDING = 2.0**-23
"""Bound of the relative rounding error of a float32 coordinate, doubled."""
MARGIN = np.float32(2e-6)
"""Extra search distance for contacts, relative to coordinates, for float32 errors."""
GROWTH = 1.05
"""Growth of the smallest step of a march, from one step to the next."""
STEEP = 0.5
"""Least cosine of the angle between the direction of a march and the normal of a plane, while the
march is under the plane. A march at a larger angle continues along the normal."""
FAR = 4.0
"""Longest way out of the solids, relative to the sum of the depth and of the radii of all bounded
solids."""
TOUCHED, MARCHED, TRAPPED, COUNTS = 0, 1, 2, 3
"""Columns of the counts of each block: contacts, those that Newton's method did not solve, and
splats that remain inside."""
PINNED_OR_DEAD = 3  # bits ALIVE and PINNED of State.flags
ALIVE_ONLY = 1

# --- one splat ------------------------------------------------------------------------------------


@serial
def lifted(bodies, rows, count, x, y, z, sigma, fx, fy, fz):
    """Return the direction of a march: the given one, or the normal of a plane that the point is
    under and that this direction leads deeper into, or hardly out of."""
    for s in range(count):
        j = np.int64(rows[s])
        if bodies[j, KIND] != PLANE:
            continue
        nx, ny, nz = bodies[j, TURN + 2], bodies[j, TURN + 5], bodies[j, TURN + 8]
        _, _, height = into(bodies, j, TURN, PLACE, x, y, z)
        if height < bodies[j, CLEARANCE] * sigma and fx * nx + fy * ny + fz * nz < STEEP:
            fx, fy, fz = nx, ny, nz
    return fx, fy, fz


@serial
def farthest(bodies, rows, count, depth):
    """Return the longest way out of the union [unit] that a point at this depth may need."""
    total = depth
    for s in range(count):
        j = np.int64(rows[s])
        if bodies[j, KIND] != PLANE:
            total += bodies[j, BOUND]
    return FAR * total


@serial
def push_out(bodies, rows, count, fields, voxels, x, y, z, sigma, reach, least):
    """Move a point out of the union, if it is inside.

    Makes at most NEWTON steps along the gradient, then at most MARCH steps along the first
    direction. A march in a constant direction leaves every bounded union; planes are left along
    their normals. A point whose way out would be longer than FAR allows stays where it was.

    Args:
        least: Smallest distance outside [unit] after the move, in addition to a margin for float32
            rounding.

    Returns:
        position (3), outward direction there (3), depth before [unit], 0 if the point was outside,
        whether it marched, and whether it is still inside.
    """
    d, gx, gy, gz, nx, ny, nz = union(bodies, rows, count, fields, voxels, x, y, z, sigma, reach)
    px, py, pz, slope = outward(gx, gy, gz, nx, ny, nz)
    if not d < 0.0:
        return x, y, z, px, py, pz, 0.0, False, False
    depth = -d
    fx, fy, fz, floor, most = px, py, pz, 0.0, 0.0
    ox, oy, oz = x, y, z
    for k in range(NEWTON + MARCH):
        gap = ROUNDING * (abs(x) + abs(y) + abs(z)) + least
        if k < NEWTON:
            # Blended gradients are short deep inside only. A full first step could overshoot.
            step = (gap - d) / (slope if k > 0 else 1.0)
            floor = 4.0 * gap
        else:
            if k == NEWTON:
                most = farthest(bodies, rows, count, depth)
            fx, fy, fz = lifted(bodies, rows, count, x, y, z, sigma, fx, fy, fz)
            px, py, pz = fx, fy, fz
            step = max((gap - d) / max(gx * fx + gy * fy + gz * fz, RIDGE), floor)
            floor *= GROWTH
        x, y, z = x + step * px, y + step * py, z + step * pz
        d, gx, gy, gz, nx, ny, nz = union(
            bodies, rows, count, fields, voxels, x, y, z, sigma, reach
        )
        px, py, pz, slope = outward(gx, gy, gz, nx, ny, nz)
        if d >= 0.75 * gap:
            return x, y, z, px, py, pz, depth, k >= NEWTON, False
        if k >= NEWTON:
            away = (x - ox) * (x - ox) + (y - oy) * (y - oy) + (z - oz) * (z - oz)
            if not away <= most * most:  # also where it is not a number
                return ox, oy, oz, fx, fy, fz, depth, True, True
    return x, y, z, px, py, pz, depth, True, True


@serial
def contact_row(
    bodies,
    rows,
    count,
    everyone,
    fields,
    voxels,
    dt,
    least,
    i,
    started,
    positions,
    velocities,
    sigma,
    reach,
    rubs,
):
    """Resolve splat i, first against the near solids, then against all, with friction if `rubs`.

    Return whether it touched, marched and is trapped.
    """
    total = everyone.shape[0]
    x, y, z = np.float64(positions[i, 0]), np.float64(positions[i, 1]), np.float64(positions[i, 2])
    x, y, z, nx, ny, nz, depth, marched, trapped = push_out(
        bodies, rows, count, fields, voxels, x, y, z, sigma, reach, least
    )
    if depth == 0.0:
        return False, False, False
    sx, sy, sz, friction, restitution = touch(
        bodies, rows, count, fields, voxels, 1.0 / dt, x, y, z, sigma, reach
    )
    rx = x - started[i, 0] - dt * sx
    ry = y - started[i, 1] - dt * sy
    rz = z - started[i, 2] - dt * sz
    out = rx * nx + ry * ny + rz * nz
    rx, ry, rz = rx - out * nx, ry - out * ny, rz - out * nz
    slid = math.sqrt(rx * rx + ry * ry + rz * rz)
    if rubs and friction > 0.0 and slid > 0.0:
        part = min(1.0, friction * depth / slid)
        x, y, z = x - part * rx, y - part * ry, z - part * rz
    x, y, z, _, _, _, _, again, trapped = push_out(
        bodies, everyone, total, fields, voxels, x, y, z, sigma, reach, least
    )
    vx, vy, vz = respond(
        velocities[i, 0], velocities[i, 1], velocities[i, 2],
        sx, sy, sz, nx, ny, nz, friction, restitution,
    )  # fmt: skip
    positions[i, 0], positions[i, 1], positions[i, 2] = x, y, z
    velocities[i, 0], velocities[i, 1], velocities[i, 2] = vx, vy, vz
    return True, marched or again, trapped


# --- a block of splats ----------------------------------------------------------------------------


@scalar
def is_near(bodies, j, turn, place, middle, half, reach):
    """Return whether a box in simulation space may come within reach of the box of solid j."""
    x, y, z = into(bodies, j, turn, place, middle[0], middle[1], middle[2])
    centre = (x, y, z)
    for axis in range(3):
        size = reach + (
            abs(bodies[j, turn + axis]) * half[0]
            + abs(bodies[j, turn + 3 + axis]) * half[1]
            + abs(bodies[j, turn + 6 + axis]) * half[2]
        )
        if centre[axis] - size > bodies[j, HIGH + axis]:
            return False
        if centre[axis] + size < bodies[j, LOW + axis]:
            return False
    return True


@serial
def gaps_to(bodies, j, fields, voxels, m, xs, ys, zs, out):
    """Compute the distances of m points from solid j, float32."""
    kind, field = int(bodies[j, KIND]), int(bodies[j, FIELD])
    r00, r01, r02 = bodies[j, TURN], bodies[j, TURN + 1], bodies[j, TURN + 2]
    r10, r11, r12 = bodies[j, TURN + 3], bodies[j, TURN + 4], bodies[j, TURN + 5]
    r20, r21, r22 = bodies[j, TURN + 6], bodies[j, TURN + 7], bodies[j, TURN + 8]
    a00, a01, a02 = np.float32(r00), np.float32(r10), np.float32(r20)
    a10, a11, a12 = np.float32(r01), np.float32(r11), np.float32(r21)
    a20, a21, a22 = np.float32(r02), np.float32(r12), np.float32(r22)
    ox, oy = np.float32(bodies[j, PLACE]), np.float32(bodies[j, PLACE + 1])
    oz = np.float32(bodies[j, PLACE + 2])
    a, b = np.float32(bodies[j, SIZE]), np.float32(bodies[j, SIZE + 1])
    c, d = np.float32(bodies[j, SIZE + 2]), np.float32(bodies[j, SIZE + 3])
    if kind == ROUND:
        for i in range(m):
            x, y, z = xs[i] - ox, ys[i] - oy, zs[i] - oz
            out[i] = round_distance(
                a00 * x + a01 * y + a02 * z,
                a10 * x + a11 * y + a12 * z,
                a20 * x + a21 * y + a22 * z,
                a, b, c, d,
            )  # fmt: skip
    elif kind == BOX:
        for i in range(m):
            x, y, z = xs[i] - ox, ys[i] - oy, zs[i] - oz
            out[i] = box_distance(
                a00 * x + a01 * y + a02 * z,
                a10 * x + a11 * y + a12 * z,
                a20 * x + a21 * y + a22 * z,
                a, b, c,
            )  # fmt: skip
    elif kind == MESH:
        for i in range(m):
            x, y, z = np.float64(xs[i]), np.float64(ys[i]), np.float64(zs[i])
            x, y, z = into(bodies, j, TURN, PLACE, x, y, z)
            out[i] = field_solid(x, y, z, fields, field, voxels)[0]
    else:
        for i in range(m):
            out[i] = a20 * (xs[i] - ox) + a21 * (ys[i] - oy) + a22 * (zs[i] - oz)


@serial
def contact_block(
    block, bodies, everyone, fields, voxels, dt, blend, clearance, least, started, flags, scales,
    positions, velocities, since, struck, near, counts,
):  # fmt: skip
    """Resolve the contacts of one block; for the arguments see `contact`."""
    n = positions.shape[0]
    start, end = block * BLOCK, min(n, (block + 1) * BLOCK)
    m = end - start
    counts[block, TOUCHED], counts[block, MARCHED], counts[block, TRAPPED] = 0, 0, 0
    lx, ly, lz = positions[start, 0], positions[start, 1], positions[start, 2]
    hx, hy, hz, largest = lx, ly, lz, scales[start, 0]
    for i in range(start, end):
        x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
        lx, ly, lz = min(lx, x), min(ly, y), min(lz, z)
        hx, hy, hz = max(hx, x), max(hy, y), max(hz, z)
        largest = max(largest, max(scales[i, 0], max(scales[i, 1], scales[i, 2])))
    far = max(max(abs(lx), abs(hx)), max(max(abs(ly), abs(hy)), max(abs(lz), abs(hz))))
    slack = np.float32(0)
    reach = 3.0 * blend + clearance * largest
    middle = (0.5 * (lx + hx), 0.5 * (ly + hy), 0.5 * (lz + hz))
    half = (0.5 * (hx - lx), 0.5 * (hy - ly), 0.5 * (hz - lz))
    found = np.int64(0)  # a plain 0 would have another type
    for j in range(bodies.shape[0]):
        if is_near(bodies, j, TURN, PLACE, middle, half, reach + 1e-5 * far):
            near[block, found] = j
            found += 1
            for axis in range(3):
                slack = max(slack, np.float32(abs(bodies[j, PLACE + axis])))
    if found == 0:
        return
    slack = MARGIN * (far + slack)
    xs, ys = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    zs, sigmas = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    gaps, others = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    for i in range(m):
        xs[i], ys[i] = positions[start + i, 0], positions[start + i, 1]
        zs[i] = positions[start + i, 2]
        sigmas[i] = max(scales[start + i, 0], max(scales[start + i, 1], scales[start + i, 2]))
    for s in range(found):
        j = np.int64(near[block, s])
        gaps_to(bodies, j, fields, voxels, m, xs, ys, zs, others)
        own, joined = np.float32(bodies[j, CLEARANCE]), np.float32(bodies[j, BLEND])
        if s == 0:
            for i in range(m):
                gaps[i] = others[i] - own * sigmas[i]
        else:
            for i in range(m):
                gaps[i] = join(gaps[i], others[i] - own * sigmas[i], joined)[1]
    for i in range(m):
        if not gaps[i] < slack or flags[start + i] & PINNED_OR_DEAD != ALIVE_ONLY:
            continue
        sigma = np.float64(sigmas[i])
        touched, marched, trapped = contact_row(
            bodies, near[block], found, everyone, fields, voxels, dt, least, start + i, started,
            positions, velocities, sigma, 3.0 * blend + clearance * sigma,
            struck[start + i] == 0,
        )  # fmt: skip
        if touched:
            since[start + i] = 0.0
            counts[block, TOUCHED] += 1
            counts[block, MARCHED] += marched
            counts[block, TRAPPED] += trapped


@parallel(writes=("positions", "velocities", "since", "near", "counts"), gpu="sim.contact.contact")
def contact(
    bodies, everyone, fields, voxels, dt, blend, clearance, least, started, flags, scales,
    positions, velocities, since, struck, near, counts,
):  # fmt: skip
    """Resolve all contacts at the end of a substep.

    Args:
        bodies: Table of solids, shape (k, COLUMNS) f64. everyone: The numbers 0 to k - 1, i32.
        fields, voxels: See `field_solid`.
        dt: Duration of the substep [s].
        blend: Largest blending distance of the solids [unit]. clearance: Largest clearance [sigma].
        least: Smallest distance outside [unit] after a contact.
        started: Positions at the start of the substep [unit], shape (n, 3) f32.
        flags: Flags of State, shape (n,) u32.
        scales: Shape (n, 3) f32.
        positions: Positions at the end of the substep, shape (n, 3) f32; changed in place.
        velocities: [unit/s], shape (n, 3) f32; changed in place.
        since: Time since the last contact [s], shape (n,) f32; set to 0 at a contact.
        struck: 1 for splats that `sweep` moved, to which friction was applied already, shape (n,)
            u8.
        near: Scratch for the solids near each block, shape (blocks, k) i32.
        counts: Receives counts, shape (blocks, COUNTS) i64.
    """
    for block in prange(counts.shape[0]):
        contact_block(
            np.int64(block), bodies, everyone, fields, voxels, dt, blend, clearance, least, started,
            flags, scales, positions, velocities, since, struck, near, counts,
        )  # fmt: skip
