"""Collisions: no splat ends a substep inside an affector, and no fast affector passes through
one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim.blend_solids import BLOCK, SWEPT
from usdsplat.kernels.sim.contact import COUNTS, contact
from usdsplat.kernels.sim.sweep import sweep
from usdsplat.sim.bodies import pack_bodies
from usdsplat.sim.fields import Fields
from usdsplat.sim.specs import Affector
from usdsplat.sim.state import State

SINCE = "contact:since"
"""In `State.memory`: time since each splat's last contact [s], inf for none."""
SIGMA = "contact:sigma"
"""In `State.globals`: largest standard deviation that clearance is measured in [unit], shape
(1,)."""
USUAL = 3.0
"""Upper limit of the standard deviations that clearance is measured in, as a multiple of the median
of each splat's largest one. Without the limit, the few huge, faint splats of a capture would be
pushed from far away. On real captures the limit is about the 95th percentile."""
LEAST = 1e-7
"""Distance outside a solid at which splats are put, in radii of the smallest solid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactCounts:
    """Counts of one substep."""

    touched: int = 0
    """Splats that were pushed out."""
    struck: int = 0
    """Hits by solids that would have passed a splat."""
    marched: int = 0
    """Splats that Newton's method did not move out, so that many small steps were used."""
    trapped: int = 0
    """Splats that are still inside, between solids without a way out."""


class Contacts:
    """Collisions with all affectors of one simulation.

    Args:
        device: Runs the kernels.
        fields: Distance fields of the simulation's meshes; None makes new ones.
    """

    def __init__(self, device: Device, fields: Fields | None = None) -> None:
        self._device = device
        self._fields = Fields(device) if fields is None else fields

    def step(
        self,
        state: State,
        started: F32,
        before: Sequence[Affector],
        after: Sequence[Affector],
        dt: float,
    ) -> ContactCounts:
        """End a substep: change `positions`, `velocities` and `memory[SINCE]` of the state.

        Pinned splats stay. All others end outside every enabled affector of the role collide, at
        least by its clearance times their size at rest. The current size is not used, because a
        contact that stretches a splat would then push it farther away.

        Args:
            started: Positions at the start of the substep [unit], shape (n, 3).
            before, after: All affectors at its start and its end.
            dt: Its duration [s].

        Raises:
            StageError, UsageError: If a mesh has no distance field, as `bake_field`.
        """
        since = contact_times(state)
        pairs = [
            (old, new)
            for old, new in zip(before, after, strict=True)
            if new.parameters.enabled and new.parameters.role == "collide"
        ]
        bodies = pack_bodies(self._fields, [old for old, _ in pairs], [new for _, new in pairs], dt)
        if not len(bodies) or not len(state):
            return ContactCounts()
        blocks = -(-len(state) // BLOCK)
        near = self._device.resident((blocks, len(bodies)), np.int32)
        table, fields = bodies.table, (bodies.fields.headers, bodies.fields.voxels, float(dt))
        struck = np.zeros(len(state), np.uint8)
        arrays = (
            started, state.flags, _sizes(state), state.positions, state.velocities, since, struck,
            near,
        )  # fmt: skip
        strikes = np.zeros(blocks, np.int64)
        if table[:, SWEPT].any():
            self._device.run(sweep, table, *fields, bodies.clearance, *arrays, strikes)
        counts = self._device.empty((blocks, COUNTS), np.int64)
        least = LEAST * bodies.size if np.isfinite(bodies.size) else 0.0
        everyone = np.arange(len(bodies), dtype=np.int32)
        self._device.run(
            contact, table, everyone, *fields, bodies.blend, bodies.clearance, least, *arrays,
            counts,
        )  # fmt: skip
        touched, marched, trapped = (int(total) for total in counts.sum(axis=0))
        return ContactCounts(
            touched=touched, struck=int(strikes.sum()), marched=marched, trapped=trapped
        )


def _sizes(state: State) -> F32:
    """Return the deviations that clearance is measured in [unit], shape (n, 3)."""
    if SIGMA not in state.globals:
        largest = state.rest_scales.max(axis=1)
        state.globals[SIGMA] = np.array([USUAL * np.median(largest)], np.float32)
    return np.minimum(state.rest_scales, state.globals[SIGMA])


def contact_times(state: State) -> F32:
    """Return `state.memory[SINCE]`, shape (n,); add it if it is missing."""
    if SINCE not in state.memory:
        state.memory[SINCE] = np.full(len(state), np.inf, np.float32)
    return state.memory[SINCE]
