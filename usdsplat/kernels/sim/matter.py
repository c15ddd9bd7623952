"""Matter: carriers as oriented particles that keep the shapes of their neighbourhoods.

Each carrier has a pose Y, which deformers or a skeleton may move, and a position x. Its
neighbourhood matches the shape that the poses have: `match` finds the rotation R and the shift that
bring it closest to the positions, and `correct` moves each carrier towards the mean of the places
that the neighbourhoods around it want it at. Edges beyond a limit are shortened in the same pass.
Both passes gather: a carrier reads its neighbours and writes only itself, so that the result does
not depend on the order. Offsets of edges that plastic matter has taken on are kept for each edge.

Everything is relative to the pose, so that matter at rest stays at rest bit for bit.

Source: Müller et al. 2005, "Meshless deformations based on shape matching"; Müller & Chentanez
2011, "Solid simulation with oriented particles"; Müller et al. 2016, "A robust method to extract
the rotational part of deformations"; Macklin et al. 2016, "XPBD"; Macklin et al. 2014, "Unified
particle physics", for averaged corrections.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.sim.matrix import ONE, ZERO, quat_matrix
from usdsplat.kernels.sim.settle import settle_axis

HELD = np.uint32(2)
"""PINNED of State.flags: a carrier that stays on its pose."""
TURNS = 4
"""Iterations of the rotation, which starts from that of the last pass."""
TINY = np.float32(1e-12)


# --- 1. mathematics: one carrier --------------------------------------------------------


@scalar
def rotation_of(c, w, x, y, z):
    """Return the unit quaternion of the rotation nearest to a matrix, starting from another.

    c: nine numbers. It may be singular, and may mirror: the result is a rotation near the start.
    """
    for _ in range(TURNS):
        r = quat_matrix(w, x, y, z)
        # sum of the cross products of the columns of R and of C, and of their scalar products
        ox = r[3] * c[6] - r[6] * c[3] + r[4] * c[7] - r[7] * c[4] + r[5] * c[8] - r[8] * c[5]
        oy = r[6] * c[0] - r[0] * c[6] + r[7] * c[1] - r[1] * c[7] + r[8] * c[2] - r[2] * c[8]
        oz = r[0] * c[3] - r[3] * c[0] + r[1] * c[4] - r[4] * c[1] + r[2] * c[5] - r[5] * c[2]
        d = (
            r[0] * c[0] + r[3] * c[3] + r[6] * c[6] + r[1] * c[1] + r[4] * c[4] + r[7] * c[7]
            + r[2] * c[2] + r[5] * c[5] + r[8] * c[8]
        )  # fmt: skip
        k = ONE / (abs(d) + TINY)
        ox, oy, oz = ox * k, oy * k, oz * k
        angle = math.sqrt(ox * ox + oy * oy + oz * oz)
        if not angle > np.float32(1e-7):
            break
        half = np.float32(0.5) * angle
        s = math.sin(half) / angle
        a, b, e, f = math.cos(half), s * ox, s * oy, s * oz
        w, x, y, z = (
            a * w - b * x - e * y - f * z,
            a * x + b * w + e * z - f * y,
            a * y - b * z + e * w + f * x,
            a * z + b * y - e * x + f * w,
        )
        k = ONE / math.sqrt(w * w + x * x + y * y + z * z)
        w, x, y, z = w * k, x * k, y * k, z * k
    return w, x, y, z


# --- 2. loops ---------------------------------------------------------------------------


@kernel(over="positions", writes=("speeds", "positions", "velocities"))
def predict(
    i, omega, drag, dt, gravity, before, after, speeds, flags, weights, positions, velocities
):
    """Move a carrier without constraints: gravity, drag, and the spring to its pose.

    Args:
        omega: Critically damped spring to the pose [1/s], multiplied by the weight. drag: Rate at
            which the velocity of the pose is taken on [1/s]. dt: [s]. All f32.
        gravity: [unit/s^2], shape (3,) f32.
        before, after: Poses at the start and the end [unit], shape (n, 3) f32.
        speeds: Velocities of the poses in the last step [unit/s], replaced, shape (n, 3) f32.
        flags: Flags of State, shape (n,) u32. weights: Selection weight, shape (n,) f32.
        positions, velocities: [unit], [unit/s], shape (n, 3) f32; changed in place.
    """
    own = omega * weights[i]
    decay, slow = math.exp(-own * dt), math.exp(-drag * dt)
    for axis in range(3):
        carried, speed = speeds[i, axis], (after[i, axis] - before[i, axis]) / dt
        speeds[i, axis] = speed
        if flags[i] & HELD:
            positions[i, axis], velocities[i, axis] = after[i, axis], speed
            continue
        x, v = positions[i, axis], velocities[i, axis] + gravity[axis] * dt
        if drag > ZERO:
            v = carried + (v - carried) * slow
        if own > ZERO:
            x, v = settle_axis(
                x, v, before[i, axis], after[i, axis], carried, speed, own, decay, dt
            )
        else:
            x += v * dt
        positions[i, axis], velocities[i, axis] = x, v


@kernel(over="positions", writes=("flags", "out"))
def slip(i, reach, settled, bit, alive, poses, positions, flags, out):
    """Mark the carriers that slip off what pushes them, and copy all positions.

    Args:
        reach: Distance from the pose at which a carrier slips [unit], f32; infinity for never.
        settled: Distance at which it can be pushed again [unit], f32.
        bit, alive: Bits of the flags, u32: it slips; affectors push it.
        poses, positions: [unit], shape (n, 3) f32.
        flags: Flags of State, shape (n,) u32; changed in place.
        out: Receives the positions, shape (n, 3) f32.
    """
    square = ZERO
    for axis in range(3):
        away = positions[i, axis] - poses[i, axis]
        square += away * away
        out[i, axis] = positions[i, axis]
    if square > reach * reach:
        flags[i] = (flags[i] | bit) & ~alive
    elif square < settled * settled or not reach < np.float32(np.inf):
        flags[i] = (flags[i] & ~bit) | alive


@kernel(over="positions", writes=("turns", "shifts"))
def match(i, shortest, longest, poses, positions, rows, neighbours, cut, offsets, turns, shifts):
    """Find the rotation and the shift that bring the shape of a neighbourhood to its positions.

    Args:
        shortest, longest: See `correct`.
        poses, positions: [unit], shape (n, 3) f32.
        rows, neighbours: Neighbours of each carrier, (n + 1,) i64 and (edges,) i32.
        cut: 1 for edges that have torn, shape (edges,) u8.
        offsets: What plastic matter has added to the offset of each neighbour, shape (edges, 3)
            f32, or (0, 3).
        turns: Unit quaternions of the last pass, replaced, shape (n, 4) f32.
        shifts: Receives the mean offset of the shape and the mean displacement [unit], 1 / the
            number of members, and the number of edges beyond the limits, shape (n, 8) f32.
    """
    yx, yy, yz = poses[i, 0], poses[i, 1], poses[i, 2]
    dx, dy, dz = positions[i, 0] - yx, positions[i, 1] - yy, positions[i, 2] - yz
    rx, ry, rz, ex, ey, ez, count, moved = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ONE, False
    beyond = ZERO
    for e in range(rows[i], rows[i + 1]):
        if cut[e]:
            continue
        j = neighbours[e]
        count += ONE
        ax, ay, az = poses[j, 0] - yx, poses[j, 1] - yy, poses[j, 2] - yz
        ux = positions[j, 0] - poses[j, 0] - dx
        uy = positions[j, 1] - poses[j, 1] - dy
        uz = positions[j, 2] - poses[j, 2] - dz
        if len(offsets) > 0:
            ax, ay, az = ax + offsets[e, 0], ay + offsets[e, 1], az + offsets[e, 2]
            ux, uy, uz = ux - offsets[e, 0], uy - offsets[e, 1], uz - offsets[e, 2]
        if (ux != ZERO) | (uy != ZERO) | (uz != ZERO):
            moved = True
            rest = ax * ax + ay * ay + az * az
            bx, by, bz = ax + ux, ay + uy, az + uz
            square = bx * bx + by * by + bz * bz
            if square > longest * longest * rest or square < shortest * shortest * rest:
                beyond += ONE
        rx, ry, rz = rx + ax, ry + ay, rz + az
        ex, ey, ez = ex + ux, ey + uy, ez + uz
    part = ONE / count
    rx, ry, rz, ex, ey, ez = rx * part, ry * part, rz * part, ex * part, ey * part, ez * part
    shifts[i, 0], shifts[i, 1], shifts[i, 2] = rx, ry, rz
    shifts[i, 3], shifts[i, 4], shifts[i, 5] = dx + ex, dy + ey, dz + ez
    shifts[i, 6], shifts[i, 7] = part, beyond
    if not moved:
        turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3] = ONE, ZERO, ZERO, ZERO
        return
    # the carrier itself is at offset 0 with displacement 0
    px, py, pz, qx, qy, qz = -rx - ex, -ry - ey, -rz - ez, -rx, -ry, -rz
    c0, c1, c2 = px * qx, px * qy, px * qz
    c3, c4, c5 = py * qx, py * qy, py * qz
    c6, c7, c8 = pz * qx, pz * qy, pz * qz
    for e in range(rows[i], rows[i + 1]):
        if cut[e]:
            continue
        j = neighbours[e]
        qx, qy, qz = poses[j, 0] - yx - rx, poses[j, 1] - yy - ry, poses[j, 2] - yz - rz
        if len(offsets) > 0:
            qx, qy, qz = qx + offsets[e, 0], qy + offsets[e, 1], qz + offsets[e, 2]
        px = positions[j, 0] - positions[i, 0] - rx - ex
        py = positions[j, 1] - positions[i, 1] - ry - ey
        pz = positions[j, 2] - positions[i, 2] - rz - ez
        c0, c1, c2 = c0 + px * qx, c1 + px * qy, c2 + px * qz
        c3, c4, c5 = c3 + py * qx, c4 + py * qy, c5 + py * qz
        c6, c7, c8 = c6 + pz * qx, c7 + pz * qy, c8 + pz * qz
    turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3] = rotation_of(
        (c0, c1, c2, c3, c4, c5, c6, c7, c8), turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3]
    )


@kernel(over="positions", writes=("out",))
def correct(
    i, pull, shortest, longest, relaxation, poses, positions, flags, rows, neighbours, twins, cut,
    offsets, turns, shifts, out,
):  # fmt: skip
    """Move a carrier to where the neighbourhoods around it want it, and shorten long edges.

    Each neighbourhood moves its members by the same factor, and each edge its ends by the same, so
    that the sum of all moves is zero: momentum is conserved where nothing is held.

    Args:
        pull: Part of the way to the mean of the wanted places, 0 to 1, f32.
        shortest, longest: Limits of the length of an edge, relative to that of the shape, f32.
        relaxation: Factor of the mean correction of edges beyond the limits, f32.
        poses, positions, rows, neighbours, cut, offsets: See `match`.
        flags: Flags of State, shape (n,) u32.
        twins: The edge back, shape (edges,) i32.
        turns, shifts: Results of `match`.
        out: Receives positions, shape (n, 3) f32.
    """
    px, py, pz = positions[i, 0], positions[i, 1], positions[i, 2]
    if flags[i] & HELD:
        out[i, 0], out[i, 1], out[i, 2] = px, py, pz
        return
    yx, yy, yz = poses[i, 0], poses[i, 1], poses[i, 2]
    dx, dy, dz = px - yx, py - yy, pz - yz
    # the own neighbourhood: the carrier is at offset 0 of the shape
    r = quat_matrix(turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3])
    mx, my, mz = shifts[i, 0], shifts[i, 1], shifts[i, 2]
    gx = shifts[i, 3] - ((r[0] - ONE) * mx + r[1] * my + r[2] * mz) - dx
    gy = shifts[i, 4] - (r[3] * mx + (r[4] - ONE) * my + r[5] * mz) - dy
    gz = shifts[i, 5] - (r[6] * mx + r[7] * my + (r[8] - ONE) * mz) - dz
    part = shifts[i, 6]
    gx, gy, gz = part * gx, part * gy, part * gz
    cx, cy, cz = ZERO, ZERO, ZERO
    for e in range(rows[i], rows[i + 1]):
        if cut[e]:
            continue
        j = neighbours[e]
        ax, ay, az = yx - poses[j, 0], yy - poses[j, 1], yz - poses[j, 2]
        ox, oy, oz = ZERO, ZERO, ZERO
        if len(offsets) > 0:
            t = twins[e]
            ox, oy, oz = offsets[t, 0], offsets[t, 1], offsets[t, 2]
            ax, ay, az = ax + ox, ay + oy, az + oz
        if pull > ZERO:
            r = quat_matrix(turns[j, 0], turns[j, 1], turns[j, 2], turns[j, 3])
            mx, my, mz = ax - shifts[j, 0], ay - shifts[j, 1], az - shifts[j, 2]
            part = shifts[j, 6]
            gx += part * (shifts[j, 3] + (r[0] - ONE) * mx + r[1] * my + r[2] * mz - dx + ox)
            gy += part * (shifts[j, 4] + r[3] * mx + (r[4] - ONE) * my + r[5] * mz - dy + oy)
            gz += part * (shifts[j, 5] + r[6] * mx + r[7] * my + (r[8] - ONE) * mz - dz + oz)
        bx, by, bz = positions[j, 0] - px, positions[j, 1] - py, positions[j, 2] - pz
        length = math.sqrt(bx * bx + by * by + bz * bz)
        rest = math.sqrt(ax * ax + ay * ay + az * az)
        allowed = min(max(length, shortest * rest), longest * rest)
        if allowed != length and length > TINY:
            share = ONE if flags[j] & HELD else np.float32(0.5)
            many = max(ONE, max(shifts[i, 7], shifts[j, 7]))
            k = relaxation * share * (length - allowed) / (length * many)
            cx, cy, cz = cx + k * bx, cy + k * by, cz + k * bz
    out[i, 0] = px + pull * gx + cx
    out[i, 1] = py + pull * gy + cy
    out[i, 2] = pz + pull * gz + cz


@kernel(over="positions", writes=("velocities",))
def finish(i, fastest, dt, flags, predicted, positions, velocities):
    """Add what the constraints have changed to the velocity.

    Args:
        fastest: Largest speed [unit/s]. dt: [s]. Both f32.
        flags: Flags of State, shape (n,) u32.
        predicted: Positions before the constraints [unit], shape (n, 3) f32.
        positions: Positions after them, shape (n, 3) f32.
        velocities: [unit/s], shape (n, 3) f32; changed in place.
    """
    if flags[i] & HELD:
        return
    vx = velocities[i, 0] + (positions[i, 0] - predicted[i, 0]) / dt
    vy = velocities[i, 1] + (positions[i, 1] - predicted[i, 1]) / dt
    vz = velocities[i, 2] + (positions[i, 2] - predicted[i, 2]) / dt
    rate = math.sqrt(vx * vx + vy * vy + vz * vz)
    k = fastest / rate if rate > fastest else ONE
    velocities[i, 0], velocities[i, 1], velocities[i, 2] = vx * k, vy * k, vz * k


@kernel(over="positions", writes=("cut",))
def tear(i, strongest, poses, positions, rows, neighbours, twins, offsets, cut):
    """Cut edges that are stretched too far, in both directions.

    Args:
        strongest: Length relative to that of the shape from which an edge tears, f32.
        For the others see `correct`.
        cut: Shape (edges,) u8; changed in place.
    """
    for e in range(rows[i], rows[i + 1]):
        if cut[e]:
            continue
        j = neighbours[e]
        bx = positions[j, 0] - positions[i, 0]
        by = positions[j, 1] - positions[i, 1]
        bz = positions[j, 2] - positions[i, 2]
        ax, ay, az = poses[j, 0] - poses[i, 0], poses[j, 1] - poses[i, 1], poses[j, 2] - poses[i, 2]
        first = ax * ax + ay * ay + az * az
        second = first
        if len(offsets) > 0:
            t = twins[e]
            ux, uy, uz = ax + offsets[e, 0], ay + offsets[e, 1], az + offsets[e, 2]
            wx, wy, wz = -ax + offsets[t, 0], -ay + offsets[t, 1], -az + offsets[t, 2]
            first = ux * ux + uy * uy + uz * uz
            second = wx * wx + wy * wy + wz * wz
        rest = max(first, second)  # the same number from both ends
        if bx * bx + by * by + bz * bz > strongest * strongest * rest:
            cut[e] = 1


@kernel(over="positions", writes=("offsets",))
def flow(i, start, rate, dt, poses, positions, rows, neighbours, cut, turns, offsets):
    """Let the shape of a neighbourhood take on its deformation.

    Args:
        start: Deviation of an offset, relative to its length, from which it flows, f32.
        rate: Part of the excess that flows in a second [1/s], f32. dt: [s], f32.
        offsets: Changed in place, shape (edges, 3) f32.
        For the others see `match`.
    """
    part = ONE - math.exp(-rate * dt)
    r = quat_matrix(turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3])
    for e in range(rows[i], rows[i + 1]):
        if cut[e]:
            continue
        j = neighbours[e]
        ax = poses[j, 0] - poses[i, 0] + offsets[e, 0]
        ay = poses[j, 1] - poses[i, 1] + offsets[e, 1]
        az = poses[j, 2] - poses[i, 2] + offsets[e, 2]
        bx = positions[j, 0] - positions[i, 0]
        by = positions[j, 1] - positions[i, 1]
        bz = positions[j, 2] - positions[i, 2]
        ux = r[0] * bx + r[3] * by + r[6] * bz - ax
        uy = r[1] * bx + r[4] * by + r[7] * bz - ay
        uz = r[2] * bx + r[5] * by + r[8] * bz - az
        off = math.sqrt(ux * ux + uy * uy + uz * uz)
        least = start * math.sqrt(ax * ax + ay * ay + az * az)
        if off > least:
            k = part * (off - least) / off
            offsets[e, 0], offsets[e, 1], offsets[e, 2] = (
                offsets[e, 0] + k * ux, offsets[e, 1] + k * uy, offsets[e, 2] + k * uz,
            )  # fmt: skip
