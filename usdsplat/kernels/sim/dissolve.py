"""Dissolve: release times of splats, their initial velocities, and the reverse motion for
assembling.

All results depend only on ids and rest positions, so any time can be computed without the times
before it.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .directions import around, is_normal
from .flight import flight
from .noise import gradient_noise
from .philox import DISSOLVE, IMPULSE, uniforms

NOISE, DISTANCE, RANDOM = range(3)
"""Criteria that order the release of splats."""

NOISE_DEVIATION = 0.27
"""Standard deviation of the gradient noise over space."""

_ZERO, _HALF, _ONE, _TWO = np.float32(0), np.float32(0.5), np.float32(1), np.float32(2)
_SQUASH = 1 / (NOISE_DEVIATION * math.sqrt(2))


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def turn_of(by, identity, x, y, z, per_length, seed):
    """Return a splat's position in the order of release, [0, 1), float32.

    NOISE is distributed evenly over 0 to 1 through the normal distribution, which it nearly has.
    DISTANCE is the length of (x, y, z) times `per_length`, 1 / the largest length.
    """
    if by == RANDOM:
        return uniforms(seed, DISSOLVE, identity, 0, 0)[0]
    if by == DISTANCE:
        return min(_ONE, np.float32(math.sqrt(x * x + y * y + z * z) * per_length))
    value = gradient_noise(x * per_length, y * per_length, z * per_length, seed)[0]
    return np.float32(0.5 + 0.5 * math.erf(value * _SQUASH))


@scalar
def impulse(identity, nx, ny, nz, speed, cosine, seed):
    """Return the velocity [unit/s] of a released splat, evenly distributed over the cone around its
    normal.

    cosine: cosine of half the cone's angle. A splat without a normal may go in any direction.
    """
    up, turn, _, _ = uniforms(seed, IMPULSE, identity, 0, 0)
    if not is_normal(nx, ny, nz):
        cosine = -_ONE
    x, y, z = around(nx, ny, nz, _ONE - up * (_ONE - cosine), turn)
    return x * speed, y * speed, z * speed


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="rest", writes=("out",))
def turns(i, rest, ids, by, origin, per_length, seed, out):
    """Compute `turn_of` of each splat: rest (n, 3) f32, origin (3,) f32, per_length f32, out (n,)
    f32."""
    x, y, z = rest[i, 0] - origin[0], rest[i, 1] - origin[1], rest[i, 2] - origin[2]
    out[i] = turn_of(by, ids[i], x, y, z, per_length, seed)


@kernel(over="velocities", writes=("velocities", "flags", "gone"))
def let_go(
    i, velocities, flags, gone, times, ids, normals, now, speeds, cosine, free, pinned, seed
):
    """Release splats at their release times: set the flag `free` and the initial velocity, once.

    Args:
        velocities: (n, 3) f32. flags: (n,) u32. gone: (n,) u8, 1 for splats released already.
        times: Release times, (n,) f32. now: f32.
        normals: (n, 3) f32.
        speeds: Of each splat, (n,) f32, or of all, (1,). cosine: f32. See `impulse`.
    """
    speed = speeds[i] if len(speeds) > 1 else speeds[0]
    if gone[i] or not times[i] <= now or flags[i] & pinned:
        return
    x, y, z = impulse(ids[i], normals[i, 0], normals[i, 1], normals[i, 2], speed, cosine, seed)
    velocities[i, 0] += x
    velocities[i, 1] += y
    velocities[i, 2] += z
    flags[i] |= free
    gone[i] = 1


@kernel(over="positions", writes=("positions", "velocities", "flags"))
def come(
    i, positions, velocities, flags, goals, times, ids, normals, now, speeds, cosine, push, drag,
    free, pinned, seed,
):  # fmt: skip
    """Place splats that have not arrived yet on their reversed flights; put arrived ones at rest.

    Args:
        positions, velocities: (n, 3) f32, of splats in flight or just arrived. flags: (n,) u32.
        goals: Positions at arrival, (n, 3) f32.
        times: Arrival times, (n,) f32. now: f64.
        normals: (n, 3) f32.
        speeds: Of each splat, (n,) f32, or of all, (1,). cosine: f32. See `impulse`.
        push: Gravity + drag times wind, (3,) f64. drag: f64 [1/s].
    """
    if flags[i] & pinned:
        return
    left = times[i] - now
    speed = speeds[i] if len(speeds) > 1 else speeds[0]
    if left > 0.0:
        vx, vy, vz = impulse(
            ids[i], normals[i, 0], normals[i, 1], normals[i, 2], speed, cosine, seed
        )
        x, vx = flight(vx, push[0], drag, left)
        y, vy = flight(vy, push[1], drag, left)
        z, vz = flight(vz, push[2], drag, left)
        positions[i, 0] = goals[i, 0] + x
        positions[i, 1] = goals[i, 1] + y
        positions[i, 2] = goals[i, 2] + z
        velocities[i, 0], velocities[i, 1], velocities[i, 2] = -vx, -vy, -vz
        flags[i] |= free
    elif flags[i] & free:
        positions[i, 0], positions[i, 1] = goals[i, 0], goals[i, 1]
        positions[i, 2] = goals[i, 2]
        velocities[i, 0], velocities[i, 1], velocities[i, 2] = _ZERO, _ZERO, _ZERO
        flags[i] &= ~free
