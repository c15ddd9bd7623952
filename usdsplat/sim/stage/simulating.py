"""Simulate a stage into a layer: every field, frame by frame, resumable."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd

from usdsplat.core.errors import OutputError, StageError
from usdsplat.core.findings import Finding, Findings, finding
from usdsplat.core.folders import made_folder
from usdsplat.core.lock import output_lock
from usdsplat.core.output import Existing
from usdsplat.core.progress import Progress, silent
from usdsplat.core.wording import counted
from usdsplat.kernels.compiling import compile_time
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device
from usdsplat.sim.parameters import Parameters
from usdsplat.sim.solver import Solver
from usdsplat.sim.stage.bake import Bake
from usdsplat.sim.stage.field_space import changed_arrays, to_field_space
from usdsplat.sim.stage.plan import BakedField
from usdsplat.sim.stage.provenance import Provenance, input_hash, parameter_hash, parameter_lines
from usdsplat.sim.stage.recipe import UNGUARDED, StageRecipe, find_simulations, recipes
from usdsplat.sim.state import Frame, State
from usdsplat.sim.uses import Uses, uses_over

LEAD = 100_000
"""Largest number of frames that are simulated before the first requested one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Statistics of a simulation."""

    target: str
    frames: int
    """Frames simulated in this run; fewer than all if a bake was resumed."""
    splats: dict[str, int]
    """Splats at the last frame, by field."""
    seconds: float
    seconds_per_frame: float
    """Median of all frames but the first [s]."""
    stages: dict[str, float] = field(default_factory=dict)
    """Seconds of each stage of the solver, and of writing."""
    megabytes: float = 0.0
    """Peak memory of the process."""

    def sentence(self) -> str:
        """Return the report as a sentence."""
        if not self.frames:
            return "nothing to do: all frames are baked already"
        slowest = sorted(self.stages.items(), key=lambda item: -item[1])[:3]
        where = ", ".join(f"{name} {spent:.1f} s" for name, spent in slowest)
        return (
            f"{self.frames} frames of {sum(self.splats.values()):,} splats in {self.seconds:.1f} "
            f"s, {self.seconds_per_frame:.2f} s a frame ({where}), at most {self.megabytes:,.0f} MB"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulateOptions:
    """Options of a simulation."""

    device: str | Device = "auto"
    """Name of a device, see `open_device`, or an open device, which stays open."""
    threads: int | None = None
    """Threads of a device that is given by name; None is all."""
    existing: Existing = "error"
    """What to do with a bake at the target: raise, continue from its last checkpoint, or replace
    it."""


SIMULATE = SimulateOptions()


class Clock:
    """Wall time by stage, without compilation, which happens only once.

    Args:
        compiled: Returns the time spent on compilation so far [s].
    """

    def __init__(self, compiled: Callable[[], float] = lambda: 0.0) -> None:
        self.spent: dict[str, float] = {}
        self._compiled = compiled
        self._began = time.perf_counter()
        self._last = self.now

    @property
    def elapsed(self) -> float:
        """Wall time since the clock was made, compiling included [s]."""
        return time.perf_counter() - self._began

    @property
    def now(self) -> float:
        """Wall time without compilation [s], from an arbitrary origin."""
        return time.perf_counter() - self._compiled()

    def lap(self, name: str) -> None:
        """Add the time since the last call to a stage."""
        now = self.now
        self.spent[name] = self.spent.get(name, 0.0) + now - self._last
        self._last = now


class Simulation:
    """All fields of a stage's simulations, advanced together. Bakes and previews use it.

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
    ) -> None:
        self.stage = stage  # keeps the stage alive for its prims
        self.frames, self.device, self.reading = frames, device, reading
        self._lap = lap
        with reading:
            self.recipes = _recipes(stage, frames[0], reading, kind)
        self.uses: dict[str, Uses] = {}
        self._transformed: dict[str, frozenset[str]] = {}
        for path, recipe in self.recipes.items():
            lead = math.ceil(max(0.0, frames[0] - recipe.start))
            if lead > LEAD:
                where = f"{recipe.simulation}.splatSim:sim:startTime"
                expected = f"one at most {LEAD} frames before {frames[0]:g}"
                raise StageError(where, f"{recipe.start:g}", expected)
            times = [*(frames[0] - left for left in range(lead, 0, -1)), *frames]
            self.uses[path] = uses_over(recipe, times)
            self._transformed[path] = changed_arrays(recipe.field_to_simulation(t) for t in times)
        self.solvers: dict[str, Solver] = {}
        self._lap("stage")

    def begin(self, states: dict[str, State] | None = None) -> None:
        """Make the solvers, at the first frame or from `states`.

        Args:
            states: States to continue from, by field; None starts anew.
        """
        for path, recipe in self.recipes.items():
            self.solvers[path] = Solver(
                recipe, self.uses[path], device=self.device, start=self.frames[0],
                state=None if states is None else states[path], lap=self._lap,
            )  # fmt: skip
        self._lap("beginning")

    def advance(self) -> None:
        """Advance by one frame."""
        for solver in self.solvers.values():
            solver.advance()

    def frame(self, path: str) -> Frame:
        """Return the splats of a field now, in the field's own space."""
        solver, arrays = self.solvers[path], self._transformed[path]
        frame = solver.frame()
        if not arrays or not solver.has_begun:
            return frame
        to_simulation = self.recipes[path].field_to_simulation(frame.time)
        return to_field_space(frame, to_simulation, solver.state, arrays)

    def writes(self, path: str) -> frozenset[str]:
        """Return the arrays of a field's cloud that may change."""
        return self.uses[path].writes | self._transformed[path]

    def checkpoint(self) -> dict[str, State]:
        """Return the states for `begin`."""
        return {path: solver.checkpoint() for path, solver in self.solvers.items()}

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the stage asks for and does not get, each once."""
        found: dict[Finding, None] = {}
        for path, recipe in self.recipes.items():
            found |= dict.fromkeys(recipe.findings)
            for each in self.solvers[path].findings if path in self.solvers else ():
                found[replace(each, path=recipe.simulation, attribute=each.path)] = None
        return tuple(found)


def _recipes(
    stage: Usd.Stage,
    start: float,
    reading: AbstractContextManager[Any],
    kind: Callable[..., StageRecipe] | None,
) -> dict[str, StageRecipe]:
    """Return the recipe of each field, by its path."""
    prims = find_simulations(stage)
    where, rate = stage.GetRootLayer().GetDisplayName(), stage.GetTimeCodesPerSecond()
    if not rate > 0:
        found = f"timeCodesPerSecond of {rate:g}"
        raise StageError(where, found, "more than 0")
    if not prims:
        raise StageError(where, "no SplatSim prim", "one; usdsplat simulate --preset makes one")
    made: dict[str, StageRecipe] = {}
    for prim in prims:
        for recipe in recipes(stage, prim, start=start, reading=reading, kind=kind):
            if recipe.path in made:
                found = f"the simulations {made[recipe.path].simulation} and {recipe.simulation}"
                raise StageError(recipe.path, found, "one of them")
            made[recipe.path] = recipe
    return made


def simulate(
    stage: Usd.Stage,
    target: Path,
    frames: Sequence[float],
    options: SimulateOptions = SIMULATE,
    *,
    progress: Progress = silent,
    findings: Findings | None = None,
    reading: AbstractContextManager[Any] = UNGUARDED,
) -> Report:
    """Simulate a stage and bake the result.

    Args:
        stage: From a file; opinions on its session layer count.
        target: The layer of results, a .usda; its samples go to a folder beside it. Folders are
            made.
        frames: Every frame, ascending, one apart [time code].
        options: Device, and what to do with an existing bake.
        progress: Receives each finished frame.
        findings: Receives what the stage asks for and does not get, and messages.
        reading: Entered while the stage is read, as in `Simulation`.

    Raises:
        UsdSplatError: If something cannot be simulated, written or resumed, or another process
            simulates to this target; `StrictError` too.
    """
    findings = Findings() if findings is None else findings
    with made_folder(target.parent), output_lock(target), compile_time() as compiled:
        if target.exists() and options.existing == "error":
            raise OutputError(str(target), "a file", "a new name, or --resume or --force")
        clock = Clock(compiled)
        device = options.device
        if isinstance(device, str):
            device = open_device(device, threads=options.threads, task="geometry")
        if device.remark:
            findings.say(device.remark)
        try:
            simulation = Simulation(stage, frames, device=device, lap=clock.lap, reading=reading)
            bake, provenance = _open_bake(simulation, target, resume=options.existing == "resume")
            findings.extend(simulation.findings)
            report = _run(simulation, bake, provenance, clock, progress, findings)
        finally:
            if device is not options.device:
                device.close()
        report.stages["compiling"] = round(compiled(), 3)
    return report


def _open_bake(simulation: Simulation, target: Path, *, resume: bool) -> tuple[Bake, Provenance]:
    """Open the bake of a simulation, and find what it is made of."""
    parameters = _common(simulation)
    provenance = _provenance(simulation, parameters)
    with simulation.reading:
        bake = Bake.open(
            simulation.stage,
            target,
            baked_fields(simulation),
            simulation.frames,
            parameters.bake,
            provenance,
            resume=resume,
        )
    return bake, provenance


def _run(
    simulation: Simulation,
    bake: Bake,
    provenance: Provenance,
    clock: Clock,
    progress: Progress,
    findings: Findings,
) -> Report:
    """Simulate the frames that a bake lacks, and write them."""
    spent: list[float] = []
    states = None if bake.resumed is None else dict(bake.resumed.states)
    left = list(bake.left)
    if left:
        progress.step("beginning", 0, 0)
        simulation.begin(states)
        provenance.resolved.update({path: s.resolved for path, s in simulation.solvers.items()})
        findings.extend(simulation.findings)
    findings.check()
    with bake:
        for number, frame in enumerate(left):
            progress.step("simulating", number, len(left))
            start = clock.now
            if number or states is not None:
                simulation.advance()
            for path in simulation.recipes:
                bake.write(path, simulation.frame(path))
            clock.lap("writing")
            if bake.is_checkpoint_due(frame):
                bake.checkpoint(frame, simulation.checkpoint())
                clock.lap("checkpoints")
            spent.append(clock.now - start)
            progress.step("simulating", number + 1, len(left))
    clock.lap("writing")
    for path, solver in simulation.solvers.items():
        if solver.trapped:
            found = f"{counted(solver.trapped, 'splat')} that remain inside the affectors"
            expected = "enough space between affectors"
            findings.add(finding("trapped-splats", path, found, expected))
    return Report(
        target=str(bake.target),
        frames=len(left),
        splats={path: len(solver.state) for path, solver in simulation.solvers.items()},
        seconds=clock.elapsed,
        seconds_per_frame=float(np.median(spent[1:] or spent or [0.0])),
        stages={name: round(value, 3) for name, value in clock.spent.items()},
        megabytes=_peak_memory(),
    )


def _common(simulation: Simulation) -> Parameters:
    """Return the parameters of the first simulation, which the bake uses."""
    if not (every := {recipe.simulation: recipe for recipe in simulation.recipes.values()}):
        raise StageError("simulate", "no splat field in any simulation", "at least one")
    first, *others = (recipe.parameters(simulation.frames[0]) for recipe in every.values())
    for other, name in zip(others, list(every)[1:], strict=True):
        if other.bake != first.bake:
            found = "other values of splatSim:bake than the first simulation's"
            raise StageError(name, found, "the same ones: a bake has one layer")
    return first


def baked_fields(simulation: Simulation) -> list[BakedField]:
    """Return what the bake needs to know about each field."""
    return [
        BakedField(
            path=path,
            rest=recipe.rest,
            writes=simulation.writes(path),
            is_fixed=not simulation.uses[path].has_births,
            rasterize_mode=recipe.cut.rasterize_mode if recipe.cut else "",
        )
        for path, recipe in simulation.recipes.items()
    ]


def _provenance(simulation: Simulation, parameters: Parameters) -> Provenance:
    """Return what a bake is made of."""
    sim, stage, frames = parameters.sim, simulation.stage, simulation.frames
    with simulation.reading:
        opinions, lines = parameter_hash(stage, frames), parameter_lines(stage, frames)
        rate, edits = stage.GetTimeCodesPerSecond(), stage.GetSessionLayer().identifier
    chunks = [file for each in simulation.recipes.values() for file in each.files]
    return Provenance(
        param_hash=opinions,
        parameters=lines,
        input_hash=input_hash(stage, [edits], chunks, reading=simulation.reading),
        seed=sim.seed,
        substeps=sim.substeps,
        dt=1.0 / (rate * sim.substeps),
        frame_range=(frames[0], frames[-1]),
        mode=parameters.bake.mode,
        threads=simulation.device.threads,
    )


def _peak_memory() -> float:
    """Return the peak memory of the process [MB]; 0 where the system does not say."""
    try:
        import resource
    except ImportError:  # not on Windows
        return 0.0
    unit = 1e6 if sys.platform == "darwin" else 1e3
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
