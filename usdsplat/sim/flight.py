"""Free flight: gravity, wind, turbulence and drag."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import StageError
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import flight as kernels
from usdsplat.kernels.sim.philox import NOISE
from usdsplat.sim.parameters import ParticlesParameters
from usdsplat.sim.state import ALIVE, FREE, PINNED, State
from usdsplat.sim.timeline import Step

MASKED = ("gravity", "wind", "turbulence", "drag")
"""Parameters that may differ from splat to splat."""


def from_world(to_world: F64) -> F64:
    """Return the matrix of vectors from the stage to the simulation, shape (3, 3).

    Raises:
        StageError: If the field's transform is singular.
    """
    linear = to_world[:3, :3]
    if not np.isfinite(linear).all() or np.linalg.matrix_rank(linear) < 3:
        raise StageError("the field's transform", "one that is singular", "an invertible one")
    back: F64 = np.linalg.inv(linear).astype(np.float64)
    return back


def fly(
    device: Device,
    state: State,
    particles: ParticlesParameters,
    step: Step,
    *,
    to_world: F64,
    air: F32 | None = None,
    max_speed: float = math.inf,
    factors: Sequence[F32 | None] = (None,) * len(MASKED),
) -> None:
    """Advance flying splats by one substep: gravity, then drag towards the air, then motion.

    Splats with the flag FREE fly, or all if `particles.enabled`; PINNED ones never do.

    Args:
        device: Runs the kernels.
        state: Its positions and velocities are replaced.
        particles: Gravity, wind and turbulence in the space of the stage; drag is exact for any dt.
        step: The substep; turbulence depends on its time.
        to_world: From the simulation's space to the stage's, shape (4, 4).
        air: Wind of affectors in the simulation's space [unit/s], shape (n, 3).
        max_speed: [unit/s].
        factors: Factors of the parameters of `MASKED`, each of shape (n,) or None.

    Raises:
        StageError: If `to_world` is singular.
    """
    back = from_world(to_world)
    positions, velocities = device.copied(state.positions), device.copied(state.velocities)
    device.run(
        kernels.fly,
        positions,
        velocities,
        device.upload(state.flags),
        ALIVE if particles.enabled else ALIVE | FREE,
        PINNED,
        (back @ particles.gravity * step.dt).astype(np.float32),
        (back @ particles.wind).astype(np.float32),
        device.upload(np.empty((0, 3), np.float32) if air is None else air),
        np.ascontiguousarray(to_world, np.float64),
        back,
        np.float32(particles.turbulence),
        1 / particles.turbulence_scale,
        step.now * particles.turbulence_speed,
        np.float32(math.exp(-particles.drag * step.dt)),
        np.float32(particles.drag),
        device.upload(_table(factors, len(state))),
        np.float32(step.dt),
        np.float32(max_speed),
        np.uint32((step.seed + NOISE * 0x9E3779B9) & 0xFFFFFFFF),
    )
    state.positions, state.velocities = map(device.publish, (positions, velocities))


def _table(factors: Sequence[F32 | None], count: int) -> F32:
    """Return the factors of the parameters of `MASKED`, shape (n, 4); (0, 4) if all are 1."""
    if all(each is None for each in factors):
        return np.empty((0, len(MASKED)), np.float32)
    table = np.ones((count, len(MASKED)), np.float32)
    for column, each in enumerate(factors):
        if each is not None:
            table[:, column] = each
    return table
