"""Return of splats to their target positions, by a critically damped spring."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim.settle import settle
from usdsplat.sim.contact import SINCE, contact_times
from usdsplat.sim.parameters import SettleParameters
from usdsplat.sim.state import State

SPEEDS = "settle:speeds"
"""In `State.memory`: velocity of the target positions [unit/s], shape (n, 3)."""
NOBODY = np.empty((0, 3), np.float32)


def settle_back(
    device: Device,
    state: State,
    before: F32,
    after: F32,
    parameters: SettleParameters,
    dt: float,
    *,
    max_speed: float = math.inf,
    factor: F32 | None = None,
) -> None:
    """Replace `positions`, `velocities` and `memory[SINCE]` of a state by those after one substep,
    and where targets move, update `memory[SPEEDS]`. If the latter is missing, the targets are
    assumed to have moved with the same velocity before this substep.

    A splat of weight w is attracted by a critically damped spring of omega w. With weight 0 or
    omega 0 it keeps its offset from the target. For `delay` after a contact only the damper acts.
    PINNED and FREE splats do not change.

    Args:
        before, after: Target positions at the start and the end of the substep [unit], shape
            (n, 3); the same array where they never move.
        dt: Duration [s], above 0.
        max_speed: [unit/s].
        factor: Factor of omega for each splat, shape (n,).
    """
    if before is not after and SPEEDS not in state.memory:
        state.memory[SPEEDS] = (after - before) / np.float32(dt)
    device.keep(after)
    positions, velocities = device.copied(state.positions), device.copied(state.velocities)
    since = device.copied(contact_times(state))
    device.run(
        settle,
        np.float32(parameters.omega),
        np.float32(parameters.delay),
        np.float32(max_speed),
        np.float32(dt),
        before,
        after,
        NOBODY if before is after else state.memory[SPEEDS],
        state.flags,
        state.weight if factor is None else state.weight * factor,
        positions,
        velocities,
        since,
    )
    state.positions, state.velocities, state.memory[SINCE] = map(
        device.publish, (positions, velocities, since)
    )
