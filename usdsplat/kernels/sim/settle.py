"""The way back: a critically damped spring towards a target that may move, solved exactly.

With y and w the place and velocity relative to the target, e = exp(-omega dt) and
tau = w + omega y: y' = (y + tau dt) e, w' = (w - omega tau dt) e. It is stable at any step and
never passes the target from rest.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from usdsplat.kernels.jit import parallel, scalar

BLOCK = 1024
SKIPPED = 10  # bits PINNED and FREE of State.flags


@scalar
def settle_axis(x, v, before, after, omega, decay, dt, per_dt):
    """Place and velocity along one axis after dt; decay is exp(-omega dt), per_dt 1 / dt."""
    speed = (after - before) * per_dt
    y, w = x - before, v - speed
    tau = w + omega * y
    return after + (y + tau * dt) * decay, (w - omega * tau * dt) * decay + speed


@scalar
def follow_axis(x, before, after, per_dt):
    """Likewise without a spring: as far off the target as it is."""
    return after + (x - before), (after - before) * per_dt


@scalar
def rest_axis(x, v, omega, decay, dt):
    """Likewise with the spring off and the damper left on: x'' = -2 omega x'."""
    square = decay * decay
    return x + v * (np.float32(1) - square) / (omega + omega), v * square


@parallel
def settle(omega, delay, fastest, dt, before, after, flags, weights, positions, velocities, since):
    """One substep of every splat that is neither pinned nor free.

    Args:
        omega: [1/s], times the splat's weight; where that is 0 a splat stays as far off its target
            as it is.
        delay: Time after the last contact in which the spring is off [s].
        fastest: Largest speed [unit/s], inf for none.
        dt: [s]. All four are float32.
        before, after: Target at the start and the end [unit], shape (n, 3) f32.
        flags: Those of State, shape (n,) u32; weights: shape (n,) f32.
        positions, velocities: Shape (n, 3) f32; written.
        since: Time since the last contact [s], shape (n,) f32; dt is added.
    """
    n = positions.shape[0]
    per_dt = np.float32(1) / dt
    for block in prange((n + BLOCK - 1) // BLOCK):
        for i in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            rests = since[i] < delay
            since[i] += dt
            if flags[i] & SKIPPED != 0:
                continue
            own = omega * weights[i]
            decay = np.exp(-own * dt)
            for axis in range(3):
                x, v = positions[i, axis], velocities[i, axis]
                if own == np.float32(0):
                    x, v = follow_axis(x, before[i, axis], after[i, axis], per_dt)
                elif rests:
                    x, v = rest_axis(x, v, own, decay, dt)
                else:
                    x, v = settle_axis(
                        x, v, before[i, axis], after[i, axis], own, decay, dt, per_dt
                    )
                positions[i, axis], velocities[i, axis] = x, v
            vx, vy, vz = velocities[i, 0], velocities[i, 1], velocities[i, 2]
            speed = np.sqrt(vx * vx + vy * vy + vz * vz)
            if speed > fastest:
                part = fastest / speed
                velocities[i, 0], velocities[i, 1], velocities[i, 2] = (
                    vx * part, vy * part, vz * part,
                )  # fmt: skip
