"""Return to the rest position: a critically damped spring to a target that may move, solved
exactly.

With y and w the position and velocity relative to the target, e = exp(-omega dt) and tau = w +
omega y: y' = (y + tau dt) e, w' = (w - omega tau dt) e. The solution is stable for any step, and a
splat that starts at rest never overshoots. A target that accelerates carries its splats along: at
the start of a step, w is relative to the target's velocity in the step before.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

SKIPPED = 10  # bits PINNED and FREE of State.flags


@scalar
def settle_axis(x, v, before, after, carried, speed, omega, decay, dt):
    """Return position and velocity along one axis after dt.

    decay is exp(-omega dt). The target's velocity was `carried` in the last step and is `speed`
    now.
    """
    y, w = x - before, v - carried
    tau = w + omega * y
    return after + (y + tau * dt) * decay, (w - omega * tau * dt) * decay + speed


@scalar
def follow_axis(x, before, after, speed):
    """Return position and velocity without a spring: the offset from the target stays the same."""
    return after + (x - before), speed


@scalar
def rest_axis(x, v, omega, decay, dt):
    """Return position and velocity with damping but without the spring: x'' = -2 omega x'."""
    square = decay * decay
    return x + v * (np.float32(1) - square) / (omega + omega), v * square


@kernel(over="positions", writes=("speeds", "positions", "velocities", "since"))
def settle(
    i, omega, delay, fastest, dt, before, after, speeds, flags, weights, positions, velocities,
    since,
):  # fmt: skip
    """Make one substep of every splat that is neither pinned nor free.

    Args:
        omega: [1/s], multiplied by the splat's weight. Where this is 0, a splat keeps its offset
            from the target.
        delay: Time after the last contact without spring [s].
        fastest: Largest speed [unit/s], inf for none.
        dt: [s]. All four are float32.
        before, after: Targets at the start and the end [unit], shape (n, 3) f32.
        speeds: Velocities of the targets [unit/s] in the last substep, replaced by those in this
            one, shape (n, 3) f32; or (0, 3) for targets that never move.
        flags: Flags of State, shape (n,) u32. weights: Shape (n,) f32.
        positions, velocities: Shape (n, 3) f32; changed in place.
        since: Time since the last contact [s], shape (n,) f32; dt is added.
    """
    per_dt = np.float32(1) / dt
    rests = since[i] < delay
    since[i] += dt
    if flags[i] & SKIPPED != 0:
        for axis in range(len(speeds) and 3):
            speeds[i, axis] = (after[i, axis] - before[i, axis]) * per_dt
        return
    own = omega * weights[i]
    decay = math.exp(-own * dt)
    for axis in range(3):
        x, v = positions[i, axis], velocities[i, axis]
        carried = speed = np.float32(0)
        if len(speeds):
            carried, speed = speeds[i, axis], (after[i, axis] - before[i, axis]) * per_dt
            speeds[i, axis] = speed
        if own == np.float32(0):
            x, v = follow_axis(x, before[i, axis], after[i, axis], speed)
        elif rests:
            x, v = rest_axis(x, v, own, decay, dt)
        else:
            x, v = settle_axis(
                x, v, before[i, axis], after[i, axis], carried, speed, own, decay, dt
            )
        positions[i, axis], velocities[i, axis] = x, v
    vx, vy, vz = velocities[i, 0], velocities[i, 1], velocities[i, 2]
    rate = math.sqrt(vx * vx + vy * vy + vz * vz)
    if rate > fastest:
        part = fastest / rate
        velocities[i, 0], velocities[i, 1], velocities[i, 2] = (
            vx * part, vy * part, vz * part,
        )  # fmt: skip
