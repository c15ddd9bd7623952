"""All fields of a stage's simulations, advanced together. Bakes and previews use it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any

from pxr import Usd

from usdsplat.core.cloud import I64
from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding
from usdsplat.core.progress import Phase, phase
from usdsplat.kernels.device import Device
from usdsplat.sim.solver import Solver
from usdsplat.sim.stage import refined_layer
from usdsplat.sim.stage.field_space import changed_arrays, to_field_space
from usdsplat.sim.stage.plan import BakedField
from usdsplat.sim.stage.recipe import UNGUARDED, StageRecipe, find_simulations, recipes
from usdsplat.sim.stage.refinement import Refining, refine
from usdsplat.sim.stage.twins import leave_session
from usdsplat.sim.state import Frame, State
from usdsplat.sim.uses import Uses, uses_over

REFINING = Refining()
LEAD = 100_000
"""Largest number of frames that are simulated before the first requested one."""


class Simulation:
    """All fields of a stage's simulations.

    Args:
        stage: With at least one SplatSim prim. It must not change, except between frames or while
            `reading` is not entered.
        frames: Every frame, ascending, one apart [time code]. Features that the stage uses only at
            other times are not prepared, so a run without end must pass all frames that it may
            need.
        device: Runs the kernels.
        lap: Receives the name of each piece of work when it is finished.
        reading: Entered whenever the stage is read.
        kind: Class of the recipes; None is `StageRecipe`.
        refining: How large splats are divided.

    Raises:
        UsdSplatError: If something on the stage cannot be simulated.
    """

    def __init__(
        self,
        stage: Usd.Stage,
        frames: Sequence[float],
        *,
        device: Device,
        lap: Callable[[str], None] = lambda name: None,
        reading: AbstractContextManager[Any] = UNGUARDED,
        kind: Callable[..., StageRecipe] | None = None,
        refining: Refining = REFINING,
    ) -> None:
        self.captured = stage  # keeps the stage alive for its prims
        """The stage without refined captures."""
        self.frames, self.device, self.reading = frames, device, reading
        self._lap = lap
        with phase("reading the captures"), reading:
            self.recipes = _recipes(stage, frames[0], reading, kind)
        self._said = tuple(each for recipe in self.recipes.values() for each in recipe.findings)
        self.uses: dict[str, Uses] = {}
        self.transformed: dict[str, frozenset[str]] = {}
        """Arrays that change because a field moves in the simulation's space, by field."""
        with phase("reading the stage", total=len(self.recipes) * len(frames)) as looked:
            self._look(frames, looked)
        self.files = tuple(file for each in self.recipes.values() for file in each.files)
        """Resolved paths of inputs that are not layers of the stage, see `StageRecipe.files`."""
        self.solvers: dict[str, Solver] = {}
        self._lap("stage")
        self._refine(refining, kind)
        self._lap("refinement")

    def _look(self, frames: Sequence[float], looked: Phase) -> None:
        """Find out what each field needs at all frames."""
        for number, (path, recipe) in enumerate(self.recipes.items()):
            lead = math.ceil(max(0.0, frames[0] - recipe.start))
            if lead > LEAD:
                where = f"{recipe.simulation}.splatSim:sim:startTime"
                expected = f"one at most {LEAD} frames before {frames[0]:g}"
                raise StageError(where, f"{recipe.start:g}", expected)
            times = [*(frames[0] - left for left in range(lead, 0, -1)), *frames]
            done = itertools.count(number * len(frames) - lead + 1)
            self.uses[path] = uses_over(recipe, _told(times, done, looked))
            self.transformed[path] = changed_arrays(recipe.field_to_simulation(t) for t in times)

    def begin(self, states: dict[str, State] | None = None) -> None:
        """Make the solvers, at the first frame or from `states`.

        Args:
            states: States to continue from, by field; None starts anew.
        """
        for path, recipe in self.recipes.items():
            self.solvers[path] = Solver(
                recipe, self.uses[path], device=self.device, start=self.frames[0],
                state=None if states is None else states[path], lap=self._lap,
                limit=self.refinement.limits.get(path, math.inf), parents=self._parents(recipe),
            )  # fmt: skip
        self._lap("beginning")

    def advance(self) -> None:
        """Advance by one frame."""
        for solver in self.solvers.values():
            solver.advance()

    def frame(self, path: str) -> Frame:
        """Return the splats of a field now, in the field's own space."""
        solver, arrays = self.solvers[path], self.transformed[path]
        frame = solver.frame()
        if not arrays or not solver.has_begun:
            return frame
        to_simulation = self.recipes[path].field_to_simulation(frame.time)
        return to_field_space(frame, to_simulation, solver.state, arrays)

    def writes(self, path: str) -> frozenset[str]:
        """Return the arrays of a field's cloud that may change."""
        return self.uses[path].writes | self.transformed[path]

    def checkpoint(self) -> dict[str, State]:
        """Return the states for `begin`."""
        return {path: solver.checkpoint() for path, solver in self.solvers.items()}

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the stage asks for and does not get, each once."""
        found = dict.fromkeys((*self._said, *self.refinement.findings))
        for path, recipe in self.recipes.items():
            for each in self.solvers[path].findings if path in self.solvers else ():
                found[replace(each, path=recipe.simulation, attribute=each.path)] = None
        return tuple(found)

    def resolved(self, path: str) -> dict[str, float]:
        """Return the values that a field's automatic parameters took."""
        return {**self.refinement.facts(path), **self.solvers[path].resolved}

    def _parents(self, recipe: StageRecipe) -> I64 | None:
        """Return the ids of the parents of a field's splats; None if it is not refined."""
        with self.reading:
            prim = self.stage.GetPrimAtPath(recipe.path)
            return refined_layer.parents(prim, len(recipe.rest))

    def _refine(self, refining: Refining, kind: Callable[..., StageRecipe] | None) -> None:
        """Divide large splats, and read the fields again."""
        stage, reading = self.captured, self.reading
        with phase("refinement", work=sum(len(each.rest) for each in self.recipes.values())):
            self.refinement = refine(
                stage, self.recipes, self.uses, device=self.device, known=refining.known,
                reading=reading,
            )  # fmt: skip
        self.stage = stage
        """The stage with refined captures."""
        layer = self.refinement.layer
        if layer is None:
            return
        with reading:
            self.stage = refining.compose(stage, layer)
            try:
                self.recipes = _recipes(
                    self.stage, self.frames[0], reading, kind, list(self.recipes.values())
                )
            except BaseException:
                leave_session(stage, layer)
                raise


def _told(times: Iterable[float], numbers: Iterator[int], looked: Phase) -> Iterator[float]:
    """Yield times, and report each."""
    for time, number in zip(times, numbers, strict=False):
        yield time
        looked.step(max(number, 0))


def _recipes(
    stage: Usd.Stage,
    start: float,
    reading: AbstractContextManager[Any],
    kind: Callable[..., StageRecipe] | None,
    known: Sequence[StageRecipe] = (),
) -> dict[str, StageRecipe]:
    """Return the recipe of each field, by its path; those of `known` only, if there are some."""
    prims = find_simulations(stage)
    where, rate = stage.GetRootLayer().GetDisplayName(), stage.GetTimeCodesPerSecond()
    if not rate > 0:
        found = f"timeCodesPerSecond of {rate:g}"
        raise StageError(where, found, "more than 0")
    if not prims:
        raise StageError(where, "no SplatSim prim", "one; usdsplat simulate --preset makes one")
    made: dict[str, StageRecipe] = {}
    for prim in prims:
        own = [each.path for each in known if each.simulation == str(prim.GetPath())]
        paths = own if known else None
        for recipe in recipes(stage, prim, start=start, reading=reading, kind=kind, paths=paths):
            if recipe.path in made:
                found = f"the simulations {made[recipe.path].simulation} and {recipe.simulation}"
                raise StageError(recipe.path, found, "one of them")
            made[recipe.path] = recipe
    return made


def baked_fields(simulation: Simulation) -> list[BakedField]:
    """Return what the bake needs to know about each field."""
    return [
        BakedField(
            path=path,
            rest=recipe.rest,
            writes=simulation.writes(path),
            is_fixed=not simulation.uses[path].varies,
            rasterize_mode=recipe.cut.rasterize_mode if recipe.cut else "",
        )
        for path, recipe in simulation.recipes.items()
    ]
