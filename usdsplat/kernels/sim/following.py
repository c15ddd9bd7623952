"""Move splats with the carriers around them, each by its carriers' local affine maps.

A carrier k has a pose Y_k without the motion that is followed, a displacement d_k from it, and the
gradient A_k of the motion around it. A splat at y moves by the weighted mean of
d_k + (A_k − I)(y − Y_k), and its gradient is the weighted mean of A_k. Without motion both are
exact. Carriers that moved elsewhere than the map of the nearest one says, as across a tear, lose
their weight.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.launch import kernel
from usdsplat.kernels.sim.matrix import (
    ONE,
    ZERO,
    by_columns,
    decompose,
    determinant,
    product,
    transposed,
)

APART_FROM, APART_TO = np.float32(0.5), np.float32(1.5)
"""Difference between the place of a carrier and where the nearest one's map puts it, in spacings,
between which its weight falls to 0."""


@kernel(over="maps", writes=("maps",))
def limit(i, least, most, maps):
    """Clamp the singular values of gradients.

    Args:
        least, most: Band of the singular values, f32. Gradients within it are not changed;
            those that mirror become rotations.
        maps: Shape (c, 3, 3) f32, changed in place.
    """
    f = (
        maps[i, 0, 0], maps[i, 0, 1], maps[i, 0, 2],
        maps[i, 1, 0], maps[i, 1, 1], maps[i, 1, 2],
        maps[i, 2, 0], maps[i, 2, 1], maps[i, 2, 2],
    )  # fmt: skip
    u, (x, y, z), v = decompose(f)
    is_sound = determinant(f) > ZERO
    inside = min(x, min(y, z)) >= least and max(x, max(y, z)) <= most
    if is_sound and inside:
        return
    if is_sound:
        x, y, z = min(max(x, least), most), min(max(y, least), most), min(max(z, least), most)
    else:
        x, y, z = ONE, ONE, ONE
    f = product(by_columns(u, x, y, z), transposed(v))
    for row in range(3):
        for column in range(3):
            maps[i, row, column] = f[3 * row + column]


@kernel(over="out", writes=("out",))
def undeformed(i, out):
    """Set gradients to the identity.

    Args:
        out: Receives gradients, shape (n, 3, 3).
    """
    for row in range(3):
        for column in range(3):
            out[i, row, column] = ONE if row == column else ZERO


@kernel(over="positions", writes=("positions", "velocities"))
def arrive(i, before, flags, free, seconds, positions, velocities):
    """Compute the velocity of splats that have moved; those with the flag `free` have not.

    Args:
        before: Positions before [unit], shape (n, 3).
        flags: See `State.flags`, shape (n,) u32.
        free: Flag of splats that do not follow.
        seconds: Duration of the motion [s], f32.
        positions: Positions now [unit], shape (n, 3); replaced by those before for free splats.
        velocities: [unit/s], shape (n, 3); changed except for free splats.
    """
    if flags[i] & free != 0:
        for axis in range(3):
            positions[i, axis] = before[i, axis]
        return
    for axis in range(3):
        velocities[i, axis] = (positions[i, axis] - before[i, axis]) / seconds


@kernel(over="positions", writes=("positions", "gradient"))
def follow(i, near, weights, poses, displacements, maps, spacing, positions, gradient):
    """Move splat `i` with its carriers.

    Args:
        near: Carriers of each splat, the nearest first, -1 after the last, shape (n, m) i32.
        weights: Their weights, which sum to 1, or to 0 for splats without carriers, shape (n, m).
        poses: Positions of the carriers without the motion [unit], shape (c, 3).
        displacements: Displacements of the carriers [unit], shape (c, 3).
        maps: Gradients of the motion around the carriers, shape (c, 3, 3).
        spacing: Distance of neighbouring carriers [unit], f32.
        positions: Positions of the splats without the motion [unit], shape (n, 3); changed.
        gradient: Gradients so far, shape (n, 3, 3), multiplied from the left; or (0, 3, 3).
    """
    first = near[i, 0]
    if first < 0 or weights[i, 0] <= ZERO:
        return
    px, py, pz = positions[i, 0], positions[i, 1], positions[i, 2]
    mx, my, mz, total = ZERO, ZERO, ZERO, ZERO
    f0, f1, f2, f3, f4, f5, f6, f7, f8 = (
        ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO,
    )  # fmt: skip
    for e in range(near.shape[1]):
        k = near[i, e]
        weight = weights[i, e]
        if k < 0 or weight <= ZERO:
            continue
        x, y, z = px - poses[k, 0], py - poses[k, 1], pz - poses[k, 2]
        if e > 0:
            # where the map of the nearest carrier puts this one, less where it is
            rx = poses[k, 0] - poses[first, 0]
            ry = poses[k, 1] - poses[first, 1]
            rz = poses[k, 2] - poses[first, 2]
            ax = displacements[first, 0] - displacements[k, 0]
            ay = displacements[first, 1] - displacements[k, 1]
            az = displacements[first, 2] - displacements[k, 2]
            ax += (maps[first, 0, 0] - ONE) * rx + maps[first, 0, 1] * ry + maps[first, 0, 2] * rz
            ay += maps[first, 1, 0] * rx + (maps[first, 1, 1] - ONE) * ry + maps[first, 1, 2] * rz
            az += maps[first, 2, 0] * rx + maps[first, 2, 1] * ry + (maps[first, 2, 2] - ONE) * rz
            apart = math.sqrt(ax * ax + ay * ay + az * az) / spacing
            s = min(max((apart - APART_FROM) / (APART_TO - APART_FROM), ZERO), ONE)
            weight *= ONE - s * s * (np.float32(3) - np.float32(2) * s)
        total += weight
        a0, a1, a2 = maps[k, 0, 0] - ONE, maps[k, 0, 1], maps[k, 0, 2]
        a3, a4, a5 = maps[k, 1, 0], maps[k, 1, 1] - ONE, maps[k, 1, 2]
        a6, a7, a8 = maps[k, 2, 0], maps[k, 2, 1], maps[k, 2, 2] - ONE
        mx += weight * (displacements[k, 0] + a0 * x + a1 * y + a2 * z)
        my += weight * (displacements[k, 1] + a3 * x + a4 * y + a5 * z)
        mz += weight * (displacements[k, 2] + a6 * x + a7 * y + a8 * z)
        f0, f1, f2 = f0 + weight * a0, f1 + weight * a1, f2 + weight * a2
        f3, f4, f5 = f3 + weight * a3, f4 + weight * a4, f5 + weight * a5
        f6, f7, f8 = f6 + weight * a6, f7 + weight * a7, f8 + weight * a8
    if total <= ZERO:
        return
    k = ONE / total
    positions[i, 0] = px + k * mx
    positions[i, 1] = py + k * my
    positions[i, 2] = pz + k * mz
    if len(gradient) == 0:
        return
    f = (ONE + k * f0, k * f1, k * f2, k * f3, ONE + k * f4, k * f5, k * f6, k * f7, ONE + k * f8)
    g = product(
        f,
        (
            gradient[i, 0, 0], gradient[i, 0, 1], gradient[i, 0, 2],
            gradient[i, 1, 0], gradient[i, 1, 1], gradient[i, 1, 2],
            gradient[i, 2, 0], gradient[i, 2, 1], gradient[i, 2, 2],
        ),
    )  # fmt: skip
    for row in range(3):
        for column in range(3):
            gradient[i, row, column] = g[3 * row + column]
