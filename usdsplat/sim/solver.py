"""Simulate one field from frame to frame: the order of the stages.

A frame has `sim:substeps` steps of equal length. Each computes target positions at its end, lets
splats settle towards them or fly, updates pattern, births and deaths, and finally resolves
collisions, so that no splat is inside an affector where a sample is taken. The clock is the number
of steps: times are computed from it and never accumulated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from usdsplat.core import edit
from usdsplat.core.cloud import F32, I64
from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding
from usdsplat.kernels.device import Device
from usdsplat.sim import population, styles
from usdsplat.sim.dissolve import Dissolve
from usdsplat.sim.flight import MASKED, fly
from usdsplat.sim.frame_state import Fades
from usdsplat.sim.influence import Influence
from usdsplat.sim.parts import Parts
from usdsplat.sim.settle import SPEEDS, settle_back
from usdsplat.sim.specs import Moment, Recipe
from usdsplat.sim.state import FREE, Frame, State
from usdsplat.sim.timeline import Step, Timeline
from usdsplat.sim.turnover import accrete, breed, fill, join
from usdsplat.sim.uses import Uses

Lap = Callable[[str], None]
"""Receives the name of each piece of work when it is finished."""
SEEN = "solver:seen"
"""In `State.globals`: last step at which the simulation was enabled; missing before the first."""


class Solver:
    """A simulation of one field.

    Args:
        recipe: The field and everything that acts on it.
        uses: What the simulation needs, from `uses_over`.
        device: Runs the kernels.
        start: The first frame [time code].
        state: State to continue from, made by `checkpoint`; None starts anew.
        lap: Receives the name of each piece of work, for timing.
        limit: Standard deviation above which splats are large [unit]; they are divided while they
            move, if the parameters ask for it.
        parents: Ids of the parents of the field's splats, -1 for none, shape (n,); None for none.

    Raises:
        StageError: If something on the stage cannot be simulated.
    """

    def __init__(
        self,
        recipe: Recipe,
        uses: Uses,
        *,
        device: Device,
        start: float,
        state: State | None = None,
        lap: Lap = lambda name: None,
        limit: float = math.inf,
        parents: I64 | None = None,
    ) -> None:
        rest = recipe.rest
        if not len(rest):
            raise StageError(recipe.path, "a field without splats", "one with some")
        self._recipe, self._uses, self._device, self._lap = recipe, uses, device, lap
        sim = recipe.at(start).parameters.sim
        self._timeline = Timeline.of(sim, start, recipe.codes_per_second)
        self._seed, self._dt = sim.seed, self._timeline.dt
        first = recipe.at(self._timeline.time(0))
        self.state = State.of(rest, recipe.selection) if state is None else state
        if state is None and parents is not None:
            self.state.parents = parents
        self._is_fixed = not (uses.grows or uses.varies)
        self._parts = parts = Parts.of(device, recipe, uses, first)
        self._masks, self._target_pose = parts.masks, parts.target_pose
        self._pattern, self._matter = parts.pattern, parts.matter
        self.trapped = 0
        """Largest number of splats that one step could not move out of the affectors."""
        self._last_on = -1
        """Last step at which the simulation was enabled; -1 before the first."""
        self._moment = first
        """Values of the stage at that step, or at the first frame."""
        if state is None:
            parts.begin(device, self.state, first)
        else:
            parts.restore(state)
        if uses.dissolves:
            Dissolve.of(
                device, self.state, first.parameters.dissolve, seed=self._seed,
                factor=lambda knob: self._factor(first, f"dissolve:{knob}"),
            )  # fmt: skip
        self._targets = self.state.rest_positions
        self._influence = Influence()
        if state is None:
            self._begin(first)
        elif SEEN in state.globals:
            self._last_on = int(state.globals[SEEN])
            self._moment = recipe.at(self._timeline.time(self._last_on))
            self._targets = self._target_pose.at(state, self._moment, self.seconds)[0]

    @property
    def time(self) -> float:
        """Current time [time code]."""
        return self._timeline.time(self.state.step)

    @property
    def seconds(self) -> float:
        """Time since the simulation's start, at the last step at which it was enabled [s]."""
        return self._timeline.seconds(self._last_on)

    @property
    def has_begun(self) -> bool:
        """Whether splats may differ from the capture."""
        return self._last_on >= 0

    @property
    def resolved(self) -> dict[str, float]:
        """Values that automatic parameters took."""
        return self._pattern.resolved(self.state)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings about the parameters; the path of each is that of the property."""
        return (*self._pattern.findings, *self._parts.findings)

    def advance(self) -> None:
        """Advance to the next frame."""
        for _ in range(self._timeline.substeps):
            self._substep()

    def frame(self) -> Frame:
        """Return the splats now. Shapes are updated here, so it must be called at each frame."""
        state, moment = self.state, self._moment
        if not self.has_begun:
            captured = edit.take(state.cloud(), np.arange(len(state)))
            return Frame(time=self.time, cloud=captured, uv=state.uv, births=state.births)
        wanted, gradient = self._target_pose.at(state, moment, self.seconds, gradient=True)
        if self._matter is not None:
            gradient = self._matter.carried(state, moment, wanted, gradient)
        frame = self._parts.evaluator.frame(
            state,
            self._target_pose.stretched(moment),
            wanted,
            gradient,
            normals=self._pattern.normals(state),
            crowding=self._pattern.crowding(state),
            fades=self._fades(moment),
            seconds=self.seconds,
        )
        frame = self._target_pose.finished(frame)
        self._lap("shape")
        if self._last_on == state.step:
            return frame
        still = replace(frame.cloud, velocities=np.zeros_like(state.velocities))
        return replace(frame, time=self.time, cloud=still)

    def checkpoint(self) -> State:
        """Return the state with everything needed to continue from it, bit for bit."""
        self._parts.remember(self.state)
        if self.has_begun:
            self.state.globals[SEEN] = np.array(self._last_on)
        return self.state

    # --- private ---------------------------------------------------------------------------

    def _is_on(self, moment: Moment) -> bool:
        """Return whether the simulation is enabled at the end of the last step."""
        sim = moment.parameters.sim
        return (
            sim.enabled and self.state.step >= self._timeline.begin and moment.time <= sim.end_time
        )

    def _begin(self, first: Moment) -> None:
        """Start, and simulate up to the first frame that is drawn."""
        if self._is_on(first):
            self._move_to_targets(first)
        for _ in range(self._timeline.lead):
            if self._timeline.is_frame(self.state.step):
                self.frame()
            self._substep()

    def _move_to_targets(self, moment: Moment) -> None:
        """Put splats at their target positions, outside of all affectors."""
        state = self.state
        self._moment, self._last_on = moment, state.step
        self._masks.update(state, moment, self.seconds)
        self._targets = self._target_pose.at(state, moment, self.seconds)[0]
        state.positions = self._targets.copy()
        self._masks.update(state, moment, self.seconds)  # those at current positions
        if self._matter is not None:
            self._matter.begin(moment, self.seconds)
        if self._uses.deforms:
            state.memory[SPEEDS] = np.zeros_like(state.positions)
        self._influence = self._influence_of(moment)
        self._place(moment, self.seconds)
        self._lap("beginning")
        self._contact(state.positions, moment, moment)

    def _substep(self) -> None:
        state, line = self.state, self._timeline
        is_first = line.is_frame(state.step)
        state.step += 1
        after = self._recipe.at(self.time)
        self._lap("stage")
        if not self._is_on(after):
            return
        if not self.has_begun:
            self._move_to_targets(after)
            return
        before = self._moment
        if self._last_on < state.step - 1:  # it was disabled in between
            before = self._recipe.at(line.time(state.step - 1))
            seconds = line.seconds(state.step - 1)
            self._targets = self._target_pose.at(state, before, seconds)[0]
        if self._uses.joins or self._uses.breaks:
            self._admit(after, line.seconds(state.step))
        self._moment, self._last_on = after, state.step
        sim, step = after.parameters.sim, Step(self.seconds, self._dt, self._seed)
        now, dt = step.now, step.dt
        started = state.positions
        self._masks.update(state, after, now)
        self._lap("masks")
        wanted = self._target_pose.at(state, after, now)[0]
        self._lap("goal")
        self._influence = influence = self._influence_of(after)
        dissolve = self._dissolving(after)
        assembles = self._uses.dissolves and after.parameters.dissolve.mode == "assemble"
        if dissolve is not None and not assembles:
            dissolve.follow(state, now=now)
            if dissolve.is_due(state, now=now):
                dissolve.release(state, self._parts.normals(state, after, now), now=now)
        if self._matter is not None:
            self._matter.advance(before, after, step)
            if line.is_frame(state.step):
                self._matter.place(state, after, wanted, line.substeps * dt)
        elif assembles or not after.parameters.particles.enabled:
            settle_back(
                self._device, state, self._targets, wanted, after.parameters.settle, dt,
                max_speed=sim.max_speed, factor=self._factor(after, "settle:omega"),
            )  # fmt: skip
        self._lap("settle")
        if self._uses.flies and not assembles:
            fly(
                self._device, state, after.parameters.particles, step, to_world=after.to_world,
                air=influence.wind, max_speed=sim.max_speed,
                factors=[self._factor(after, f"particles:{knob}") for knob in MASKED],
            )  # fmt: skip
            self._lap("flight")
        self._targets = wanted
        if self._uses.reacts or self._uses.needs_neighbors:
            started = self._update_population(after, step, influence, started, is_first=is_first)
        self._place(after, now)
        if self._matter is None:
            self._contact(started, before, after)
        elif line.is_frame(state.step):  # splats must end outside; their carriers were pushed
            solid = self._matter.affectors(after)
            self._contact(state.positions, solid, solid)

    def _admit(self, moment: Moment, now: float) -> None:
        """Let splats join: those of another capture, and the filling of pieces that broke off."""
        state, n = self.state, len(self.state)
        joined = join(self._parts, state, moment, now)
        if not fill(self._parts, state, moment, now) and not joined:
            return
        self._masks.update(state, self._moment, self.seconds)
        self._targets = self._target_pose.at(state, self._moment, self.seconds)[0]
        state.positions[n:] = self._targets[n:]
        self._lap("joining")

    def _update_population(
        self, moment: Moment, step: Step, influence: Influence, started: F32, *, is_first: bool
    ) -> F32:
        """Update pattern, growth, births and deaths; return the positions at the start of the step
        for the rows that the state has then."""
        state, growth, sim = self.state, moment.parameters.growth, moment.parameters.sim
        reacts = moment.parameters.rd.enabled
        if is_first:
            if reacts:
                rates = styles.reaction_of(moment.parameters)
                self._pattern.react(
                    state, moment, influence, step.now,
                    feed_factor=self._factor(moment, "rd:feed", rates),
                    kill_factor=self._factor(moment, "rd:kill", rates),
                )  # fmt: skip
            self._lap("reaction")
            if self._uses.needs_neighbors:
                self._pattern.update_density(state, moment)
                self._lap("neighbours")
        rises, accretes = reacts and growth.rate, reacts and is_first and self._uses.accretes
        if self._is_fixed or not (rises or accretes or self._uses.breeds):
            return started
        off = state.positions - self._targets
        if rises:
            mask = self._factor(moment, "growth:rate")
            population.grow(
                self._device, state, growth, dt=step.dt, normals=self._pattern.normals(state),
                rate_factor=_product(influence.growth, _product(state.weight, mask)),
            )  # fmt: skip
        if accretes:
            for source in accrete(self._parts, state, moment, step):
                off, started = self._selected(source, off, started)
            self._lap("new matter")
        if self._uses.breeds:
            mask = self._factor(moment, "growth:birthRate")
            rows = breed(
                self._device, self._parts, state, moment, step,
                maximum=sim.max_count if reacts and growth.birth_rate > 0 else 0,
                rate_factor=_product(self._influence.growth, _product(state.weight, mask)),
            )  # fmt: skip
            for source in rows:
                off, started = self._selected(source, off, started)
        self._targets = self._target_pose.at(state, moment, step.now)[0]
        flying = (state.flags & FREE) != 0
        state.positions = np.where(flying[:, None], state.positions, self._targets + off)
        self._lap("growth")
        return started

    def _selected(self, rows: I64, *arrays: F32) -> Iterator[F32]:
        """Yield rows of arrays, and keep the effects of affectors at these rows."""
        self._influence = self._influence.selected(rows)
        return (array.take(rows, axis=0) for array in arrays)

    def _dissolving(self, moment: Moment) -> Dissolve | None:
        """Return the active dissolve or assemble, or None."""
        knobs = moment.parameters.dissolve
        if not (self._uses.dissolves and knobs.enabled):
            return None
        return Dissolve(
            self._device, knobs, self._seed,
            lambda knob: self._factor(moment, f"dissolve:{knob}"),
        )  # fmt: skip

    def _place(self, moment: Moment, now: float) -> None:
        """Place the splats that have not arrived yet."""
        dissolve = self._dissolving(moment)
        if dissolve is None or not dissolve.is_assembling:
            return
        dissolve.place(
            self.state, self._targets, self._parts.normals(self.state, moment, now),
            moment.parameters.particles, to_world=moment.to_world, now=now,
        )  # fmt: skip

    def _contact(self, started: F32, before: Moment, after: Moment) -> None:
        """Move selected splats out of the affectors."""
        if not self._uses.collides:
            return
        state, amount = self.state, np.float32(after.parameters.sim.contact)
        weight = state.weight if amount == 1 else state.weight * amount
        if (mask := self._factor(after, "sim:contact")) is not None:
            weight = weight * mask
        counts = self._parts.contacts.step(
            state, started, before.affectors, after.affectors, self._dt, weight=weight
        )
        self.trapped = max(self.trapped, counts.trapped)
        self._lap("contact")

    def _fades(self, moment: Moment) -> Fades:
        """Return the factors of opacity and of size at a time."""
        alpha = self._influence_of(moment, "opacity").opacity
        alpha = _product(alpha, self._target_pose.opacity)
        size: F32 | None = None
        if self._uses.has_births:
            alphas, sizes = population.fades(self.state, moment.parameters.growth, now=self.seconds)
            alpha, size = _product(alpha, alphas), sizes
        dissolve = self._dissolving(moment)
        if dissolve is not None:
            alphas, sizes = dissolve.fades(self.state, now=self.seconds)
            alpha, size = _product(alpha, alphas), _product(size, sizes)
        masked = self._factor(moment, "growth:sizeFollow")
        return Fades(alpha, _product(size, self._pattern.sizes(self.state, moment, masked)))

    def _factor(self, moment: Moment, knob: str, of: object = None) -> F32 | None:
        """Return the factor of a masked parameter, see `Masks.factor`."""
        return self._masks.factor(self.state, moment, knob, of)

    def _influence_of(self, moment: Moment, *roles: str) -> Influence:
        """Return the effects of affectors at the splats, of some roles or all."""
        chosen = [each for each in moment.affectors if not roles or each.parameters.role in roles]
        return self._parts.influences.at(
            tuple(chosen),
            self.state.positions,
            lambda each: self._factor(moment, f"{each.path}.affector:amount", each.parameters),
        )


def _product(first: F32 | None, second: F32 | None) -> F32 | None:
    """Multiply factors, of which None is 1."""
    if first is None or second is None:
        return second if first is None else first
    return first * second
