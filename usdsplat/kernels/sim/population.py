"""Growth of splats along their normals, probability of new splats, and their positions."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .directions import around, carried, is_normal
from .philox import BIRTH, uniforms

STEP_MAX = 0.2
"""Longest growth in a step, relative to the radius of the neighbourhood."""

_ZERO, _HALF, _ONE, _TWO = np.float32(0), np.float32(0.5), np.float32(1), np.float32(2)
_THREE = np.float32(3)
_STEP = np.float32(STEP_MAX)


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def activity(v, low, high):
    """Return the activity of a pattern value v: smoothstep from low to high, or a step if they are
    equal."""
    if high <= low:
        return _ONE if v >= low else _ZERO
    t = min(_ONE, max(_ZERO, (v - low) / (high - low)))
    return t * t * (_THREE - _TWO * t)


@scalar
def spacing(support, target, dimension):
    """Return the distance between neighbours [unit] if the support contains `target` of them,
    float32.

    It is sqrt(pi / k) h on a surface and cbrt(4 pi / 3k) h in a volume.
    """
    if dimension == 2:
        return support * np.float32(math.sqrt(math.pi / target))
    return support * np.float32((4 * math.pi / (3 * target)) ** (1 / 3))


@scalar
def direction(identity, step, nx, ny, nz, dimension, seed):
    """Return the direction from a splat to its child.

    It is random and perpendicular to the normal; in a volume or without a normal, it is any
    direction.
    """
    turn, up, _, _ = uniforms(seed, BIRTH, identity, step, 0)
    flat = dimension == 2 and is_normal(nx, ny, nz)
    return around(nx, ny, nz, _ZERO if flat else _ONE - _TWO * up, turn)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="positions", writes=("positions", "rest_positions"))
def grow(
    i, positions, rest_positions, rotations, rest_rotations, uv, support, normals, factor, flags,
    way, low, high, alive, held,
):  # fmt: skip
    """Move splats along their normals, both at rest and, rotated like the splat, now.

    Args:
        positions, rest_positions, normals: (n, 3) f32. rotations, rest_rotations: (n, 4) f32.
        uv: (n, 2) f32. support: (n,) f32. factor: Factor on the distance, (n,) f32, or (0,).
        flags: (n,) u32; splats move that have `alive` and none of `held`.
        way: Speed times dt, f32. low, high: See `activity`, f32.
    """
    if flags[i] & (alive | held) != alive:
        return
    far = way * activity(uv[i, 1], low, high)
    if len(factor):
        far *= factor[i]
    most = _STEP * support[i]
    far = min(most, max(-most, far))
    if far == _ZERO:
        return
    x, y, z = far * normals[i, 0], far * normals[i, 1], far * normals[i, 2]
    rest_positions[i, 0] += x
    rest_positions[i, 1] += y
    rest_positions[i, 2] += z
    q, r = rotations[i], rest_rotations[i]
    x, y, z = carried(q[0], q[1], q[2], q[3], r[0], r[1], r[2], r[3], x, y, z)
    positions[i, 0] += x
    positions[i, 1] += y
    positions[i, 2] += z


@kernel(over="progress", writes=("progress", "ripe"))
def ripen(
    i, progress, ids, uv, support, crowding, factor, flags, chance, low, high, h_target, dimension,
    crowd_max, alive, held, seed, ripe,
):  # fmt: skip
    """Add the probability of a child in a step, and mark the splats that are due and have space.

    Args:
        progress: (n,) f32, limited to 1 for splats without space. Values below 0 are initialized
            with random numbers from 0 to 1, so that equal splats are not due at the same time.
        ids: (n,) i64.
        uv: (n, 2) f32. support, crowding: (n,) f32. factor: Factor on the probability, (n,) f32, or
            (0,); splats with 0 are never due.
        flags: (n,) u32, see `grow`.
        chance: Rate times dt. low, high: See `activity`. h_target, crowd_max: Limits. All f32.
        dimension: 2 or 3.
        ripe: Receives 1 or 0, (n,) u8.
    """
    ripe[i] = 0
    if flags[i] & (alive | held) != alive:
        return
    room = support[i] / h_target
    room = room * room if dimension == 2 else room * room * room
    before = progress[i]
    if before < _ZERO:
        before = uniforms(seed, BIRTH, ids[i], 0, 1)[0]
    part = factor[i] if len(factor) else _ONE
    total = before + part * chance * activity(uv[i, 1], low, high) * room
    if total >= _ONE:
        if crowding[i] < crowd_max and part > _ZERO:
            ripe[i] = 1
        else:
            total = _ONE
    progress[i] = total


@kernel(over="parents", writes=("rest", "now"))
def put(
    k, parents, ids, support, normals, rotations, rest_rotations, target, dimension, seed, step,
    rest, now,
):  # fmt: skip
    """Move children half a spacing from their parents.

    Args:
        parents: Rows of the parents, (b,) i64. Arrays of the parents: ids (n,) i64, support (n,)
            f32, normals (n, 3) f32 at rest, rotations and rest_rotations (n, 4) f32.
        target: Target number of neighbours, f64. dimension: 2 or 3. seed, step: See `uniforms`.
        rest, now: Positions of the children at rest and now, initially copies of the parents', (b,
            3) f32.
    """
    i = parents[k]
    x, y, z = direction(ids[i], step, normals[i, 0], normals[i, 1], normals[i, 2], dimension, seed)
    far = _HALF * spacing(support[i], target, dimension)
    x, y, z = far * x, far * y, far * z
    rest[k, 0] += x
    rest[k, 1] += y
    rest[k, 2] += z
    q, r = rotations[i], rest_rotations[i]
    x, y, z = carried(q[0], q[1], q[2], q[3], r[0], r[1], r[2], r[3], x, y, z)
    now[k, 0] += x
    now[k, 1] += y
    now[k, 2] += z
