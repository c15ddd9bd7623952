"""Rigid pieces of matter: carriers that move as one body each, and keep apart.

Source: Müller et al. 2005, "Meshless deformations based on shape matching": rigid bodies as
clusters.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.launch import kernel
from usdsplat.kernels.sim.matrix import ONE, ZERO, quat_matrix
from usdsplat.kernels.sim.matter import HELD, TINY, rotation_of


@kernel(over="starts", writes=("turns", "shifts"), grain=1)
def match_pieces(p, poses, positions, flags, starts, counts, members, turns, shifts):
    """Find the rotation and the shift that bring a piece closest to the positions of its carriers.

    Args:
        poses, positions: [unit], shape (n, 3) f32.
        flags: Flags of State, shape (n,) u32: pieces of carriers that are held are left out.
        starts, counts: First entry of each piece in `members`, and their number, shape (pieces,)
            i64.
        members: Carriers, piece by piece, shape (n,) i32.
        turns: Unit quaternions of the last pass, replaced, shape (pieces, 4) f32.
        shifts: Receives the mean pose and the mean position [unit], shape (pieces, 6) f32.
    """
    first, count = starts[p], counts[p]
    if count == 0 or flags[members[first]] & HELD:
        return
    mx, my, mz, nx, ny, nz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for e in range(first, first + count):
        i = members[e]
        mx, my, mz = mx + poses[i, 0], my + poses[i, 1], mz + poses[i, 2]
        nx, ny, nz = nx + positions[i, 0], ny + positions[i, 1], nz + positions[i, 2]
    part = 1.0 / count
    ax, ay, az = np.float32(mx * part), np.float32(my * part), np.float32(mz * part)
    bx, by, bz = np.float32(nx * part), np.float32(ny * part), np.float32(nz * part)
    shifts[p, 0], shifts[p, 1], shifts[p, 2] = ax, ay, az
    shifts[p, 3], shifts[p, 4], shifts[p, 5] = bx, by, bz
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = (
        ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO,
    )  # fmt: skip
    for e in range(first, first + count):
        i = members[e]
        qx, qy, qz = poses[i, 0] - ax, poses[i, 1] - ay, poses[i, 2] - az
        px, py, pz = positions[i, 0] - bx, positions[i, 1] - by, positions[i, 2] - bz
        c0, c1, c2 = c0 + px * qx, c1 + px * qy, c2 + px * qz
        c3, c4, c5 = c3 + py * qx, c4 + py * qy, c5 + py * qz
        c6, c7, c8 = c6 + pz * qx, c7 + pz * qy, c8 + pz * qz
    turns[p, 0], turns[p, 1], turns[p, 2], turns[p, 3] = rotation_of(
        (c0, c1, c2, c3, c4, c5, c6, c7, c8), turns[p, 0], turns[p, 1], turns[p, 2], turns[p, 3]
    )


@kernel(over="positions", writes=("positions",))
def place_pieces(i, poses, flags, piece, counts, turns, shifts, positions):
    """Move a carrier to its place in its piece.

    Args:
        poses, flags: See `match_pieces`.
        piece: Piece of each carrier, shape (n,) i32.
        counts, turns, shifts: See `match_pieces`.
        positions: Shape (n, 3) f32; changed in place.
    """
    p = piece[i]
    if flags[i] & HELD or counts[p] < 2:
        return
    r = quat_matrix(turns[p, 0], turns[p, 1], turns[p, 2], turns[p, 3])
    x, y, z = poses[i, 0] - shifts[p, 0], poses[i, 1] - shifts[p, 1], poses[i, 2] - shifts[p, 2]
    positions[i, 0] = shifts[p, 3] + r[0] * x + r[1] * y + r[2] * z
    positions[i, 1] = shifts[p, 4] + r[3] * x + r[4] * y + r[5] * z
    positions[i, 2] = shifts[p, 5] + r[6] * x + r[7] * y + r[8] * z


@kernel(over="positions", writes=("out",))
def keep_apart(i, closest, poses, positions, flags, piece, order, rank, rows, neighbours, out):
    """Move carriers of different pieces apart where they are closer than at rest, and close.

    Args:
        closest: Distance of carriers [unit] from which they do not touch, f32.
        poses, positions: [unit], shape (n, 3) f32.
        flags: Flags of State, shape (n,) u32. piece: Piece of each carrier, shape (n,) i32.
        order, rank, rows, neighbours: Symmetric neighbour lists, see `Graph`.
        out: Receives positions, shape (n, 3) f32.
    """
    px, py, pz = positions[i, 0], positions[i, 1], positions[i, 2]
    out[i, 0], out[i, 1], out[i, 2] = px, py, pz
    if flags[i] & HELD:
        return
    slot = rank[i]
    cx, cy, cz, count = ZERO, ZERO, ZERO, ZERO
    for e in range(rows[slot], rows[slot + 1]):
        j = order[neighbours[e]]
        if piece[j] == piece[i]:
            continue
        bx, by, bz = px - positions[j, 0], py - positions[j, 1], pz - positions[j, 2]
        ax, ay, az = poses[i, 0] - poses[j, 0], poses[i, 1] - poses[j, 1], poses[i, 2] - poses[j, 2]
        rest = math.sqrt(ax * ax + ay * ay + az * az)
        length = math.sqrt(bx * bx + by * by + bz * bz)
        wanted = min(closest, rest)
        if length < wanted and length > TINY:
            share = ONE if flags[j] & HELD else np.float32(0.5)
            k = share * (wanted - length) / length
            cx, cy, cz, count = cx + k * bx, cy + k * by, cz + k * bz, count + ONE
    if count > ZERO:
        k = ONE / count
        out[i, 0], out[i, 1], out[i, 2] = px + k * cx, py + k * cy, pz + k * cz
