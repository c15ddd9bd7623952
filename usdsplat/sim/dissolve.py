"""Dissolve: splats detach one after the other and vanish. Assemble: the same, reversed in time.

The time at which a splat detaches depends on its rest position and its identity alone, or on a
mask. Times are kept in the state's memory, so that they do not change when rest positions grow, and
children detach with their parents. Where the order is a mask that changes, a splat detaches as soon
as the mask is low enough for the time. Assemble runs arrivals from `start` to `start + duration` in
the opposite order. Before its arrival, a splat is where a flight without turbulence would take it
in the time that is left.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import StageError
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import dissolve as kernels
from usdsplat.sim.flight import from_world
from usdsplat.sim.parameters import DissolveParameters, ParticlesParameters
from usdsplat.sim.settle import SPEEDS
from usdsplat.sim.state import FREE, PINNED, State

TIMES, GONE = "dissolve:times", "dissolve:gone"
"""In `State.memory`: time at which each splat detaches or arrives [s], float32; whether it has
detached, uint8."""

UNSELECTED = 0.5
"""Selection weight below which a splat stays."""

_BY = {"noise": kernels.NOISE, "distance": kernels.DISTANCE, "random": kernels.RANDOM}


def _unmasked(knob: str) -> None:
    """Return that a parameter has no mask."""


@dataclass(frozen=True, slots=True, eq=False)
class Dissolve:
    """A dissolve or assemble of one state."""

    device: Device
    parameters: DissolveParameters
    seed: int
    factor: Callable[[str], F32 | None] = _unmasked
    """Returns the factor of a parameter by its name, such as "speed", shape (n,); None where it has
    no mask. That of "by" is the order."""

    @classmethod
    def of(
        cls,
        device: Device,
        state: State,
        parameters: DissolveParameters,
        *,
        seed: int,
        factor: Callable[[str], F32 | None] = _unmasked,
    ) -> Dissolve:
        """Return a dissolve; compute the times unless the state has them.

        Args:
            device: Runs the kernels.
            state: At rest or resumed; its memory changes.
            parameters: Start, duration, order and impulse must not change over time.
            seed: Seed of the simulation.
            factor: Factors of masked parameters at the beginning.

        Raises:
            StageError: If the order is a mask, and there is none.
        """
        made = cls(device, parameters, seed, factor)
        if TIMES not in state.memory:
            state.memory[TIMES] = made._times(state)
            state.memory[GONE] = np.zeros(len(state), np.uint8)
        return made

    @property
    def is_assembling(self) -> bool:
        """Whether the mode is assemble."""
        return self.parameters.mode == "assemble"

    def _times(self, state: State) -> F32:
        """Return the time at which each splat detaches or arrives; unselected ones never detach, or
        have always been there."""
        p = self.parameters
        if p.by == "mask":
            return self._masked_times(state)
        origin = np.array(p.origin if p.by == "distance" else (0, 0, 0), np.float32)
        per_length = 1 / p.size
        if p.by == "distance":
            far = np.sqrt(np.square(state.rest_positions - origin).sum(-1).max(initial=0))
            per_length = 1 / far if far > 0 else 0.0
        turn = np.empty(len(state), np.float32)
        self.device.run(
            kernels.turns,
            self.device.upload(state.rest_positions),
            self.device.upload(state.ids),
            _BY[p.by],
            origin,
            np.float32(per_length),
            self.seed,
            turn,
        )
        if self.is_assembling:
            turn = 1 - turn
        times = p.start + turn.astype(np.float64) * p.duration
        return self._selected(state, times)

    def _masked_times(self, state: State) -> F32:
        """Return the time at which each splat detaches or arrives by the mask now."""
        p, order = self.parameters, self.factor("by")
        if order is None:
            where = "splatSim:dissolve:by"
            raise StageError(where, "mask", "splatSim:dissolve:by:mask with the name of a mask")
        turn = order.astype(np.float64)
        return self._selected(
            state, p.start + (1 - turn if self.is_assembling else turn) * p.duration
        )

    def _selected(self, state: State, times: F64) -> F32:
        """Return times that unselected splats never reach, or have always been at."""
        never = -math.inf if self.is_assembling else math.inf
        return np.where(state.weight < UNSELECTED, never, times).astype(np.float32)

    @property
    def _impulse(self) -> tuple[F32, np.float32]:
        """Return the speed of all splats or of each, and the cosine of the cone's half angle."""
        p, factor = self.parameters, self.factor("speed")
        speeds = np.array([p.speed], np.float32)
        if factor is not None:
            speeds = speeds * factor
        return self.device.upload(speeds), np.float32(math.cos(math.radians(p.spread)))

    def follow(self, state: State, *, now: float) -> None:
        """Update the times of splats that have not detached, if their order is a mask that has
        changed. Those that should have detached before do so now.

        Args:
            state: Its memory changes.
            now: Time since the simulation's start [s].
        """
        if self.parameters.by != "mask":
            return
        times, new = state.memory[TIMES], self._masked_times(state)
        changed = (new != times) & (state.memory[GONE] == 0)
        late = np.maximum(new, np.float32(now))
        state.memory[TIMES] = np.where(changed, np.where(new <= now, late, new), times)

    def is_due(self, state: State, *, now: float) -> bool:
        """Return whether `release` would detach any splat."""
        late = state.memory[TIMES] <= np.float32(now)
        return bool((late & (state.memory[GONE] == 0)).any())

    def release(self, state: State, normals: F32, *, now: float) -> None:
        """Detach the splats whose time has come, with their impulse (mode dissolve).

        Args:
            state: Its velocities and flags (FREE) change.
            normals: Normals now, shape (n, 3).
            now: Time since the simulation's start [s].
        """
        velocities = self.device.copied(state.velocities)
        self.device.run(
            kernels.let_go,
            velocities,
            state.flags,
            state.memory[GONE],
            self.device.upload(state.memory[TIMES]),
            self.device.upload(state.ids),
            self.device.upload(normals),
            np.float32(now),
            *self._impulse,
            FREE,
            PINNED,
            self.seed,
        )
        state.velocities = self.device.publish(velocities)

    def place(
        self,
        state: State,
        goals: F32,
        normals: F32,
        particles: ParticlesParameters,
        *,
        to_world: F64,
        now: float,
    ) -> None:
        """Place splats before their arrival on their paths, and those that just arrived at their
        goals (mode assemble). Splats on their path are FREE; others do not change.

        Args:
            state: Its positions, velocities and flags (FREE) change.
            goals: Target positions now, shape (n, 3).
            normals: Normals there, shape (n, 3).
            particles: Parameters of the flight, without its turbulence.
            to_world: From the simulation's space to the stage's, shape (4, 4).
            now: Time since the simulation's start [s].

        Raises:
            StageError: If `to_world` is singular.
        """
        back = from_world(to_world)
        push = back @ particles.gravity + particles.drag * (back @ particles.wind)
        flew = state.flags & FREE
        positions = self.device.copied(state.positions)
        velocities = self.device.copied(state.velocities)
        self.device.run(
            kernels.come,
            positions,
            velocities,
            state.flags,
            self.device.upload(goals),
            self.device.upload(state.memory[TIMES]),
            self.device.upload(state.ids),
            self.device.upload(normals),
            float(now),
            *self._impulse,
            push,
            float(particles.drag),
            FREE,
            PINNED,
            self.seed,
        )
        state.positions, state.velocities = map(self.device.publish, (positions, velocities))
        if SPEEDS in state.memory:  # splats that have arrived move with their targets
            there = (flew & ~state.flags) != 0
            if there.any():
                speeds = state.memory[SPEEDS]
                state.velocities = np.where(there[:, None], speeds, state.velocities)

    def fades(self, state: State, *, now: float) -> tuple[F32, F32]:
        """Return the factors of opacity and size, each of shape (n,).

        They depend on the time since a splat detached (mode dissolve) or until it arrives (mode
        assemble).
        """
        times = state.memory[TIMES]
        p, longer, less = self.parameters, self.factor("fade"), self.factor("shrink")
        n = len(times)
        if p.fade <= 0:
            return np.ones(n, np.float32), np.ones(n, np.float32)
        away = times - np.float32(now) if self.is_assembling else np.float32(now) - times
        if longer is None:
            part = np.clip(away / np.float32(p.fade), 0, 1)
        else:  # a splat whose time is 0 stays visible
            spans = np.float32(p.fade) * longer
            part = np.where(spans > 0, np.clip(away / np.where(spans > 0, spans, 1), 0, 1), 0)
        gone = part * part * (3 - 2 * part)
        shrink = np.float32(p.shrink) if less is None else np.float32(p.shrink) * less
        return (1 - gone).astype(np.float32), (1 - shrink * gone).astype(np.float32)
