"""One field from frame to frame: which stage of the simulation comes after which.

A frame has `sim:substeps` steps of one length. Each asks where splats want to be at its end, lets
them settle towards it or fly, lets the pattern grow and splats be born and die, and at last keeps
them out of the affectors, so that nothing is inside one where a sample is taken. The clock is the
number of steps; times are worked out from it and never added up.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from usdsplat.core.cloud import F32, I64
from usdsplat.core.errors import StageError
from usdsplat.kernels.device import CpuDevice
from usdsplat.sim import population
from usdsplat.sim.contact import Contacts
from usdsplat.sim.dissolve import Dissolve
from usdsplat.sim.drawn import Drawing
from usdsplat.sim.flight import fly
from usdsplat.sim.goal import Goal
from usdsplat.sim.influence import Influence, Influences
from usdsplat.sim.pattern import Pattern
from usdsplat.sim.settle import settle_back
from usdsplat.sim.specs import Moment, Recipe
from usdsplat.sim.state import FREE, PINNED, Frame, State
from usdsplat.sim.strain import Strain
from usdsplat.sim.uses import Uses

Lap = Callable[[str], None]
"""Told the name of each piece of work as it is finished."""


class Solver:
    """A simulation of one field.

    Args:
        recipe: The field and what acts on it.
        uses: What will be needed, as `uses_over` finds it.
        device: Computes.
        start: The first frame [time code].
        state: Of a checkpoint, as `checkpoint` gave it, to go on from; None begins.
        lap: Told what was done, for timing.

    Raises:
        StageError: If something on the stage cannot be simulated.
    """

    def __init__(
        self,
        recipe: Recipe,
        uses: Uses,
        *,
        device: CpuDevice,
        start: float,
        state: State | None = None,
        lap: Lap = lambda name: None,
    ) -> None:
        rest = recipe.rest
        if not len(rest):
            raise StageError(recipe.path, "a field without splats", "one with some")
        self._recipe, self._uses, self._device, self._lap = recipe, uses, device, lap
        first = recipe.at(start)
        sim = first.parameters.sim
        self._start, self._seed = start, sim.seed
        self._substeps = sim.substeps
        self._dt = 1.0 / (recipe.codes_per_second * sim.substeps)
        self.state = State.of(rest, recipe.selection) if state is None else state
        self._goal = Goal(device, recipe, first)
        self._pattern = Pattern(device, rest, uses, first)
        self._contacts = Contacts(device)
        self._influences = Influences(device)
        is_fixed = not (uses.grows or uses.bears)
        strain = Strain(device, is_fixed=is_fixed) if uses.collides else None
        self._drawing = Drawing(device, strain)
        if state is None:
            self._pattern.begin(self.state, first)
        else:
            self._goal.restore(self.state)
            self._pattern.restore(self.state)
        self._dissolve = None
        if uses.dissolves:
            self._dissolve = Dissolve.of(
                device, self.state, first.parameters.dissolve, seed=self._seed
            )
        self._moment = first if state is None else recipe.at(self.time)
        self._wanted = self._goal.at(self.state, self._moment, self.seconds)[0]
        self._influence = self._influences.at(self._moment.affectors, self.state.positions)
        if state is None:
            self._begin()

    @property
    def time(self) -> float:
        """Where the simulation is [time code]."""
        return self._time(self.state.step)

    @property
    def seconds(self) -> float:
        """Since the simulation's start [s]."""
        return self.state.step * self._dt

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know, a sentence each."""
        return self._pattern.remarks

    def advance(self) -> None:
        """Go on to the next frame."""
        for index in range(self._substeps):
            self._substep(is_first=index == 0)

    def frame(self) -> Frame:
        """What is seen now."""
        state, moment = self.state, self._moment
        wanted, gradient = self._goal.at(state, moment, self.seconds, gradient=True)
        alpha, size = self._fades(moment)
        frame = self._drawing.frame(
            state,
            moment,
            wanted,
            gradient,
            normals=self._pattern.normals(state),
            crowding=self._pattern.crowding(state),
            alpha=alpha,
            size=size,
            seconds=self.seconds,
        )
        self._lap("shape")
        return frame

    def checkpoint(self) -> State:
        """The state with all that is needed to go on from it, bit for bit."""
        self._goal.remember(self.state)
        self._pattern.remember(self.state)
        return self.state

    # --- private ---------------------------------------------------------------------------

    def _time(self, step: int) -> float:
        """Time code at the end of a substep."""
        return self._start + step / self._substeps

    def _begin(self) -> None:
        """Splats are where they want to be, but not inside of anything."""
        state = self.state
        state.positions = self._wanted.copy()
        self._place(self._moment, 0.0)
        self._contact(state.positions.copy(), self._moment, self._moment)

    def _substep(self, *, is_first: bool) -> None:
        state = self.state
        before = self._moment
        after = self._recipe.at(self._time(state.step + 1))
        sim = after.parameters.sim
        state.step += 1
        self._moment = after
        self._lap("stage")
        if not (sim.enabled and sim.start_time < after.time <= sim.end_time):
            self._wanted = self._goal.at(state, after, self.seconds)[0]
            return
        now, dt = self.seconds, self._dt
        started = state.positions.copy()
        wanted = self._goal.at(state, after, now)[0]
        self._lap("goal")
        self._influence = influence = self._influences.at(after.affectors, state.positions)
        if self._dissolve is not None and not self._assembles:
            self._dissolve.release(state, self._pattern.normals(state), now=now)
        if not after.parameters.particles.enabled:
            settle_back(
                self._device, state, self._wanted, wanted, after.parameters.settle, dt,
                max_speed=sim.max_speed,
            )  # fmt: skip
        self._lap("settle")
        if self._uses.flies and not self._assembles:
            fly(
                self._device, state, after.parameters.particles, to_world=after.to_world,
                now=now, dt=dt, seed=self._seed, air=influence.wind, max_speed=sim.max_speed,
            )  # fmt: skip
            self._lap("flight")
        self._wanted = wanted
        if self._uses.reacts or self._uses.crowds:
            started = self._live(after, influence, started, is_first=is_first)
        self._place(after, now)
        self._contact(started, before, after)

    def _live(self, moment: Moment, influence: Influence, started: F32, *, is_first: bool) -> F32:
        """Pattern, growth, births and deaths; returns where splats were, row by row."""
        state, growth, sim = self.state, moment.parameters.growth, moment.parameters.sim
        now, dt = self.seconds, self._dt
        if is_first:
            if self._uses.reacts:
                self._pattern.react(state, moment, influence)
            self._lap("reaction")
            if self._uses.crowds:
                self._pattern.crowd(state, moment)
                self._lap("neighbours")
        if not (self._uses.grows or self._uses.bears):
            return started
        off = state.positions - self._wanted
        if self._uses.grows:
            population.grow(
                self._device, state, growth, dt=dt, normals=self._pattern.normals(state),
                rate_factor=_product(influence.growth, self._weight()),
            )  # fmt: skip
        rows: list[I64] = []
        if self._uses.bears:
            rows = self._change_population(moment, now, dt, sim.max_count)
        for source in rows:
            off, started = off[source], started[source]
        self._wanted = self._goal.at(state, moment, now)[0]
        flying = (state.flags & FREE) != 0
        state.positions = np.where(flying[:, None], state.positions, self._wanted + off)
        self._lap("growth")
        return started

    def _change_population(self, moment: Moment, now: float, dt: float, maximum: int) -> list[I64]:
        """Births, then deaths; returns, for each change, the row that each row comes from."""
        state, growth = self.state, moment.parameters.growth
        changes: list[I64] = []
        parents = population.births(
            self._device, state, growth, crowding=self._pattern.crowding(state),
            normals=self._pattern.normals(state), dimension=self._pattern.dimension,
            target=moment.parameters.neighbors.target, h_target=self._pattern.usual_support,
            maximum=maximum, seed=self._seed, now=now, dt=dt,
        )  # fmt: skip
        if len(parents):
            self._goal.bear(parents, state)
            changes.append(np.concatenate([np.arange(len(state) - len(parents)), parents]))
        left = population.deaths(state, growth, now=now, dt=dt)
        if left is not None:
            self._goal.keep(left)
            changes.append(left)
        return changes

    def _place(self, moment: Moment, now: float) -> None:
        """Put those that are still to arrive on their way."""
        if self._dissolve is None or not self._assembles:
            return
        self._dissolve.place(
            self.state, self._wanted, self._pattern.normals(self.state),
            moment.parameters.particles, to_world=moment.to_world, now=now,
        )  # fmt: skip

    def _contact(self, started: F32, before: Moment, after: Moment) -> None:
        """Keep splats that are selected out of the affectors."""
        if not self._uses.collides:
            return
        state = self.state
        spared = np.flatnonzero(self._weight() <= 0)
        state.flags[spared] |= PINNED
        self._contacts.step(state, started, before.affectors, after.affectors, self._dt)
        state.flags[spared] &= ~PINNED
        self._lap("contact")

    def _fades(self, moment: Moment) -> tuple[F32 | None, F32 | None]:
        """Factors of opacity and of size, None where they are 1."""
        alpha = self._influence.opacity
        size: F32 | None = None
        if self._uses.bears:
            alphas, sizes = population.fades(self.state, moment.parameters.growth, now=self.seconds)
            alpha, size = _product(alpha, alphas), sizes
        if self._dissolve is not None:
            alphas, sizes = self._dissolve.fades(self.state, now=self.seconds)
            alpha, size = _product(alpha, alphas), _product(size, sizes)
        return alpha, _product(size, self._pattern.sizes(self.state, moment))

    @property
    def _assembles(self) -> bool:
        return self._dissolve is not None and self._dissolve.is_assembling

    def _weight(self) -> F32:
        """How much each splat is selected now, shape (n,)."""
        mask = self._influence.mask
        return self.state.weight if mask is None else self.state.weight * mask


def _product(first: F32 | None, second: F32 | None) -> F32 | None:
    """Of factors that may be 1."""
    if first is None or second is None:
        return second if first is None else first
    return first * second
