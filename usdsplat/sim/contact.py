"""Collisions: no splat ends a substep inside an affector, and no fast affector passes through
one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim.blend_solids import BLOCK, SWEPT
from usdsplat.kernels.sim.contact import COUNTS, contact
from usdsplat.kernels.sim.sweep import sweep
from usdsplat.sim.bodies import Bodies, pack_bodies
from usdsplat.sim.fields import Fields
from usdsplat.sim.specs import Affector
from usdsplat.sim.state import PINNED, State

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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Particles:
    """n particles as affectors see them; arrays of the host or of the device."""

    flags: Any
    """See `State.flags`, shape (n,)."""
    sizes: Any
    """Standard deviations in which clearance is measured [unit], shape (n, 3)."""
    positions: Any
    """[unit], shape (n, 3)."""
    velocities: Any
    """[unit/s], shape (n, 3)."""
    since: Any
    """Time since the last contact [s], shape (n,)."""


class Contacts:
    """Collisions with all affectors of one simulation.

    Args:
        device: Runs the kernels.
        fields: Distance fields of the simulation's meshes; None makes new ones.
    """

    def __init__(self, device: Device, fields: Fields | None = None) -> None:
        self._device = device
        self._fields = Fields(device) if fields is None else fields
        self._limited: tuple[F32, F32] | None = None
        """Scales at rest, and the deviations that clearance is measured in."""

    def step(
        self,
        state: State,
        started: F32,
        before: Sequence[Affector],
        after: Sequence[Affector],
        dt: float,
        *,
        weight: F32 | None = None,
    ) -> ContactCounts:
        """End a substep: replace `positions`, `velocities` and `memory[SINCE]` of the state.

        Pinned splats stay, and those without a weight. All others end outside every enabled
        affector of the role collide, at least by its clearance times their size at rest. The
        current size is not used, because a contact that stretches a splat would then push it
        farther away.

        Args:
            started: Positions at the start of the substep [unit], shape (n, 3).
            before, after: All affectors at its start and its end.
            dt: Its duration [s].
            weight: Selection weight of each splat, shape (n,); None selects all.

        Raises:
            StageError, UsageError: If a mesh has no distance field, as `bake_field`.
        """
        since = contact_times(state)
        bodies = self.packed(before, after, dt)
        if not len(bodies) or not len(state):
            return ContactCounts()
        flags, device = state.flags, self._device
        if weight is not None and not (weight > 0).all():
            flags = np.where(weight > 0, flags, flags | np.uint32(PINNED))
        particles = Particles(
            flags=flags, sizes=self._sizes(state), positions=device.copied(state.positions),
            velocities=device.copied(state.velocities), since=device.copied(since),
        )  # fmt: skip
        counts, strikes = self.push(bodies, started, particles, dt)
        state.positions, state.velocities, state.memory[SINCE] = map(
            device.publish, (particles.positions, particles.velocities, particles.since)
        )
        touched, marched, trapped = (int(each) for each in self._device.fetch(counts).sum(axis=0))
        return ContactCounts(
            touched=touched,
            struck=int(self._device.fetch(strikes).sum()),
            marched=marched,
            trapped=trapped,
        )

    def packed(self, before: Sequence[Affector], after: Sequence[Affector], dt: float) -> Bodies:
        """Return the solids that collide; for the arguments see `step`."""
        pairs = [
            (old, new)
            for old, new in zip(before, after, strict=True)
            if new.parameters.enabled and new.parameters.role == "collide"
        ]
        return pack_bodies(self._fields, [old for old, _ in pairs], [new for _, new in pairs], dt)

    def push(self, bodies: Bodies, started: Any, particles: Particles, dt: float) -> Any:
        """Move particles out of solids; their positions, velocities and `since` change.

        Args:
            bodies: Result of `packed`, not empty.
            started: Positions at the start of the substep [unit], shape (n, 3).
            particles: At its end; arrays of the host or of the device.
            dt: Its duration [s].

        Returns:
            Counts of each block, shape (blocks, COUNTS), and hits, shape (blocks,), on the device.
        """
        n = particles.positions.shape[0]
        blocks = -(-n // BLOCK)
        near = self._device.resident((blocks, len(bodies)), np.int32)
        table, fields = bodies.table, (bodies.fields.headers, bodies.fields.voxels, float(dt))
        struck = self._device.move(np.zeros(n, np.uint8))
        arrays = (
            started, particles.flags, particles.sizes, particles.positions, particles.velocities,
            particles.since, struck, near,
        )  # fmt: skip
        strikes = self._device.move(np.zeros(blocks, np.int64))
        if table[:, SWEPT].any():
            self._device.run(sweep, table, *fields, bodies.clearance, *arrays, strikes)
        counts = self._device.resident((blocks, COUNTS), np.int64)
        least = LEAST * bodies.size if np.isfinite(bodies.size) else 0.0
        everyone = np.arange(len(bodies), dtype=np.int32)
        self._device.run(
            contact, table, everyone, *fields, bodies.blend, bodies.clearance, least, *arrays,
            counts,
        )  # fmt: skip
        return counts, strikes

    def _sizes(self, state: State) -> F32:
        """Return the deviations that clearance is measured in [unit], shape (n, 3)."""
        if SIGMA not in state.globals:
            largest = state.rest_scales.max(axis=1)
            state.globals[SIGMA] = np.array([USUAL * np.median(largest)], np.float32)
        if self._limited is None or self._limited[0] is not state.rest_scales:
            limited = np.minimum(state.rest_scales, state.globals[SIGMA])
            self._device.keep(limited)
            self._limited = state.rest_scales, limited
        return self._limited[1]


def contact_times(state: State) -> F32:
    """Return `state.memory[SINCE]`, shape (n,); add it if it is missing."""
    if SINCE not in state.memory:
        state.memory[SINCE] = np.full(len(state), np.inf, np.float32)
    return state.memory[SINCE]
