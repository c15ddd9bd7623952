"""Push splats out of the union of solids, rub them on it, and let their velocity know.

Blocks of rows are tested against boxes first; the splats of the blocks that remain are tested
against the near solids in float32, and only those that seem to touch are resolved, in float64 and
against all solids. A splat that is left outside by a row of this kernel is outside by float64
arithmetic on its float32 position.

Source: Macklin et al. 2014, "Unified particle physics", for friction by positions.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from usdsplat.kernels.jit import parallel, scalar, serial
from usdsplat.kernels.sim.blend_solids import (
    BLEND,
    BLOCK,
    CLEARANCE,
    FIELD,
    HIGH,
    KIND,
    LOW,
    PLACE,
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
    ROUND,
    box_distance,
    field_solid,
    round_distance,
)

NEWTON, MARCH = 4, 256
ROUNDING = 2.0**-23
"""Of a float32 coordinate: twice what rounding can move it by, relative."""
MARGIN = np.float32(2e-6)
"""By which contacts are sought further than they are, of the coordinates: errors of float32."""
GROWTH = 1.05
"""Of the least step of a march, from one to the next."""
TOUCHED, MARCHED, TRAPPED, COUNTS = 0, 1, 2, 3
"""What is counted for each block: contacts, those that Newton did not solve, and those that are
inside still."""
PINNED_OR_DEAD = 3  # bits ALIVE and PINNED of State.flags
ALIVE_ONLY = 1

# --- one splat ------------------------------------------------------------------------------------


@serial
def push_out(bodies, fields, voxels, x, y, z, sigma, reach, least):
    """Move a point out of the union, if it is inside.

    At most NEWTON steps along the gradient, then at most MARCH along the first of its directions:
    a constant direction leaves every bounded union.

    Args:
        least: Distance outside at which it is put [unit], beside what float32 rounds away.

    Returns:
        where (3), depth before [unit], 0 where it was outside already, and whether it marched and
        whether it is inside still.
    """
    d, gx, gy, gz, nx, ny, nz = union(bodies, fields, voxels, x, y, z, sigma, reach)
    if not d < 0.0:
        return x, y, z, 0.0, False, False
    depth = -d
    fx, fy, fz, slope = outward(gx, gy, gz, nx, ny, nz)
    px, py, pz = fx, fy, fz
    for _ in range(NEWTON):
        gap = ROUNDING * (abs(x) + abs(y) + abs(z)) + least
        step = (gap - d) / slope
        x, y, z = x + step * px, y + step * py, z + step * pz
        d, gx, gy, gz, nx, ny, nz = union(bodies, fields, voxels, x, y, z, sigma, reach)
        if d >= 0.75 * gap:
            return x, y, z, depth, False, False
        px, py, pz, slope = outward(gx, gy, gz, nx, ny, nz)
    floor = 4.0 * gap
    for _ in range(MARCH):
        gap = ROUNDING * (abs(x) + abs(y) + abs(z)) + least
        step = max(gap - d, floor)
        floor *= GROWTH
        x, y, z = x + step * fx, y + step * fy, z + step * fz
        d, _, _, _, _, _, _ = union(bodies, fields, voxels, x, y, z, sigma, reach)
        if d >= 0.75 * gap:
            return x, y, z, depth, True, False
    return x, y, z, depth, True, True


@serial
def contact_row(bodies, fields, voxels, dt, least, i, started, positions, velocities, sigma, reach):
    """Resolve splat i; returns whether it touched, marched and is trapped."""
    x, y, z = (
        np.float64(positions[i, 0]), np.float64(positions[i, 1]), np.float64(positions[i, 2])
    )  # fmt: skip
    x, y, z, depth, marched, trapped = push_out(
        bodies, fields, voxels, x, y, z, sigma, reach, least
    )
    if depth == 0.0:
        return False, False, False
    sx, sy, sz, friction, restitution = touch(
        bodies, fields, voxels, 1.0 / dt, x, y, z, sigma, reach
    )
    _, gx, gy, gz, nx, ny, nz = union(bodies, fields, voxels, x, y, z, sigma, reach)
    nx, ny, nz, _ = outward(gx, gy, gz, nx, ny, nz)
    rx = x - started[i, 0] - dt * sx
    ry = y - started[i, 1] - dt * sy
    rz = z - started[i, 2] - dt * sz
    out = rx * nx + ry * ny + rz * nz
    rx, ry, rz = rx - out * nx, ry - out * ny, rz - out * nz
    slid = np.sqrt(rx * rx + ry * ry + rz * rz)
    if friction > 0.0 and slid > 0.0:
        part = min(1.0, friction * depth / slid)
        x, y, z, _, again, trapped = push_out(
            bodies, fields, voxels, x - part * rx, y - part * ry, z - part * rz, sigma, reach, least
        )
        marched = marched or again
    vx, vy, vz = respond(
        velocities[i, 0], velocities[i, 1], velocities[i, 2],
        sx, sy, sz, nx, ny, nz, friction, restitution,
    )  # fmt: skip
    positions[i, 0], positions[i, 1], positions[i, 2] = x, y, z
    velocities[i, 0], velocities[i, 1], velocities[i, 2] = vx, vy, vz
    return True, marched, trapped


# --- a block of splats ----------------------------------------------------------------------------


@scalar
def is_near(bodies, j, turn, place, middle, half, reach):
    """Whether a box of the simulation's space may come within reach of the box of solid j."""
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


@scalar
def near_distances(bodies, j, fields, voxels, first, m, xs, ys, zs, sigmas, out):
    """Join the distances less clearance of m points from solid j with `out`, float32."""
    kind = int(bodies[j, KIND])
    a00, a01, a02 = (
        np.float32(bodies[j, TURN]),
        np.float32(bodies[j, TURN + 3]),
        np.float32(bodies[j, TURN + 6]),
    )
    a10, a11, a12 = (
        np.float32(bodies[j, TURN + 1]),
        np.float32(bodies[j, TURN + 4]),
        np.float32(bodies[j, TURN + 7]),
    )
    a20, a21, a22 = (
        np.float32(bodies[j, TURN + 2]),
        np.float32(bodies[j, TURN + 5]),
        np.float32(bodies[j, TURN + 8]),
    )
    ox, oy, oz = (
        np.float32(bodies[j, PLACE]),
        np.float32(bodies[j, PLACE + 1]),
        np.float32(bodies[j, PLACE + 2]),
    )
    a, b = np.float32(bodies[j, SIZE]), np.float32(bodies[j, SIZE + 1])
    c, d = np.float32(bodies[j, SIZE + 2]), np.float32(bodies[j, SIZE + 3])
    clearance, blend = np.float32(bodies[j, CLEARANCE]), np.float32(bodies[j, BLEND])
    field = int(bodies[j, FIELD])
    for i in range(m):
        x, y, z = xs[i] - ox, ys[i] - oy, zs[i] - oz
        u = a00 * x + a01 * y + a02 * z
        v = a10 * x + a11 * y + a12 * z
        w = a20 * x + a21 * y + a22 * z
        if kind == ROUND:
            e = round_distance(u, v, w, a, b, c, d)
        elif kind == BOX:
            e = box_distance(u, v, w, a, b, c)
        elif kind == MESH:
            e = np.float32(
                field_solid(np.float64(u), np.float64(v), np.float64(w), fields, field, voxels)[0]
            )
        else:
            e = w
        e -= clearance * sigmas[i]
        out[i] = e if first else join(out[i], e, blend)[1]


@parallel
def contact(
    bodies, fields, voxels, dt, blend, clearance, least, started, flags, scales, positions,
    velocities, since, near, counts,
):  # fmt: skip
    """Resolve all contacts at the end of a substep.

    Args:
        bodies: Shape (k, COLUMNS) f64; fields, voxels: as `field_solid` wants them.
        dt: Duration of the substep [s].
        blend: Largest of the solids' [unit]; clearance: likewise [sigma].
        least: Distance outside at which splats are put [unit].
        started: Positions at the start of the substep [unit], shape (n, 3) f32.
        flags: Those of State, shape (n,) u32.
        scales: Shape (n, 3) f32.
        positions: At its end, shape (n, 3) f32; written.
        velocities: [unit/s], shape (n, 3) f32; written.
        since: Time since the last contact [s], shape (n,) f32; set to 0 where there is one.
        near: Room for solids near each block, shape (blocks, k) i32.
        counts: Shape (blocks, COUNTS) i64; written.
    """
    n = positions.shape[0]
    for block in prange(counts.shape[0]):
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
        found = 0
        for j in range(bodies.shape[0]):
            if is_near(bodies, j, TURN, PLACE, middle, half, reach + 1e-5 * far):
                near[block, found] = j
                found += 1
                for axis in range(3):
                    slack = max(slack, np.float32(abs(bodies[j, PLACE + axis])))
        if found == 0:
            continue
        slack = MARGIN * (far + slack)
        xs, ys = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
        zs, sigmas = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
        gaps = np.empty(BLOCK, np.float32)
        for i in range(m):
            xs[i], ys[i] = positions[start + i, 0], positions[start + i, 1]
            zs[i] = positions[start + i, 2]
            sigmas[i] = max(scales[start + i, 0], max(scales[start + i, 1], scales[start + i, 2]))
        for s in range(found):
            near_distances(
                bodies, near[block, s], fields, voxels, s == 0, m, xs, ys, zs, sigmas, gaps
            )
        for i in range(m):
            if not gaps[i] < slack or flags[start + i] & PINNED_OR_DEAD != ALIVE_ONLY:
                continue
            sigma = np.float64(sigmas[i])
            touched, marched, trapped = contact_row(
                bodies, fields, voxels, dt, least, start + i, started, positions, velocities,
                sigma, 3.0 * blend + clearance * sigma,
            )  # fmt: skip
            if touched:
                since[start + i] = 0.0
                counts[block, TOUCHED] += 1
                counts[block, MARCHED] += marched
                counts[block, TRAPPED] += trapped
