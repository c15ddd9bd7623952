"""Splats go back to where they want to be."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim.settle import settle
from usdsplat.sim.contact import contact_times
from usdsplat.sim.parameters import SettleParameters
from usdsplat.sim.state import State

SPEEDS = "settle:speeds"
"""In `State.memory`: velocity of where splats want to be [unit/s], shape (n, 3)."""
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
) -> None:
    """Change `positions` and `velocities` of a state by one substep, `memory[SINCE]` and, where
    goals move, `memory[SPEEDS]`; without that, goals have moved evenly before.

    A splat of weight w is drawn by a critically damped spring of omega w; of weight 0, or with
    omega 0, it stays as far off its target as it is. For `delay` after a contact the spring is off
    and only the damper acts. Pinned splats stay, and free ones are left to their flight.

    Args:
        before, after: Where the splats want to be at the start and the end of the substep [unit],
            shape (n, 3); the same array where they never move.
        dt: Its duration [s], above 0.
        max_speed: [unit/s].
    """
    if before is not after and SPEEDS not in state.memory:
        state.memory[SPEEDS] = (after - before) / np.float32(dt)
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
        state.weight,
        state.positions,
        state.velocities,
        contact_times(state),
    )
