"""Simulate a stage into a layer: every field, frame by frame, resumable."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd

from usdsplat.core.errors import OutputError, StageError
from usdsplat.core.findings import Findings, finding
from usdsplat.core.folders import made_folder
from usdsplat.core.lock import output_lock
from usdsplat.core.output import Existing
from usdsplat.core.peak import peak_memory
from usdsplat.core.progress import Progress, Rates, phase, reporting, silent
from usdsplat.core.wording import counted
from usdsplat.kernels.compiling import compile_time
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device
from usdsplat.sim.parameters import Parameters
from usdsplat.sim.stage.bake import Bake
from usdsplat.sim.stage.bake_layers import refined_of
from usdsplat.sim.stage.provenance import Provenance, input_hash, parameter_hash, parameter_lines
from usdsplat.sim.stage.recipe import UNGUARDED
from usdsplat.sim.stage.refinement import Refining
from usdsplat.sim.stage.report import Clock, Report
from usdsplat.sim.stage.simulation import Simulation, baked_fields
from usdsplat.sim.state import Frame
from usdsplat.sim.uses import Uses


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Ending:
    """How a simulation that is stopped leaves its bake: whole, with the frames so far."""

    errors: tuple[type[BaseException], ...]
    """Errors that mean a stop; they are raised again."""
    reading: AbstractContextManager[Any]
    """Entered while the stage is read after the stop."""


Seen = Callable[[Simulation, float, Mapping[str, Frame]], None]
"""Receives a simulation, the time code of its present frame, and the frame of each field."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulateOptions:
    """Options of a simulation."""

    device: str | Device = "auto"
    """Name of a device, see `open_device`, or an open device, which stays open."""
    threads: int | None = None
    """Threads of a device that is given by name; None is all."""
    existing: Existing = "error"
    """What to do with a bake at the target: raise, continue from its last checkpoint or extend it,
    or replace it."""
    keeps_checkpoint: bool = True
    """Whether a finished bake keeps the checkpoint from which frames can be added."""
    until: float | None = None
    """Frame from which the simulation stops after the next checkpoint [time code], so that it is
    resumed; None finishes the bake."""
    seen: Seen | None = None
    """Receives each frame once it is written."""
    ending: Ending | None = None
    """What a stop by an error leaves; None is a bake to resume from its last checkpoint."""


SIMULATE = SimulateOptions()


def simulate(
    stage: Usd.Stage,
    target: Path,
    frames: Sequence[float],
    options: SimulateOptions = SIMULATE,
    *,
    progress: Progress = silent,
    findings: Findings | None = None,
    reading: AbstractContextManager[Any] = UNGUARDED,
    rates: Path | None = None,
) -> Report:
    """Simulate a stage and bake the result.

    Args:
        stage: From a file; opinions on its session layer count.
        target: The layer of results, a .usda; its samples go to a folder beside it. Folders are
            made.
        frames: Every frame, ascending, one apart [time code].
        options: Device, and what to do with an existing bake.
        progress: Receives the phases of the preparation, and each finished frame.
        findings: Receives what the stage asks for and does not get, and messages.
        reading: Entered while the stage is read, as in `Simulation`.
        rates: File with the rates at which this machine did such phases before, to estimate the
            time that is left; None keeps none.

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
        known = Rates(rates, f"{device.name}, {device.threads} threads")
        try:
            refined = refined_of(target) if options.existing == "resume" else None
            with reporting(progress, rates=known, compiled=compiled) as spent:
                simulation = Simulation(
                    stage, frames, device=device, lap=clock.lap, reading=reading,
                    refining=Refining(known=refined),
                )  # fmt: skip
                bake, provenance = _open_bake(
                    simulation, target, resume=options.existing == "resume",
                    keeps=options.keeps_checkpoint, may_end=options.ending is not None,
                )  # fmt: skip
                findings.extend(simulation.findings)
                report = _run(simulation, bake, provenance, clock, findings, options)
        finally:
            if device is not options.device:
                device.close()
        report.stages["compiling"] = round(compiled(), 3)
        report.phases.update({name: round(value, 3) for name, value in spent.items()})
    return report


def _open_bake(
    simulation: Simulation, target: Path, *, resume: bool, keeps: bool, may_end: bool
) -> tuple[Bake, Provenance]:
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
            keeps_checkpoint=keeps,
        )
        if may_end:
            bake.may_end_early(simulation.stage)
    return bake, provenance


def _run(
    simulation: Simulation,
    bake: Bake,
    provenance: Provenance,
    clock: Clock,
    findings: Findings,
    options: SimulateOptions,
) -> Report:
    """Simulate the frames that a bake lacks, and write them."""
    spent: list[float] = []
    until, ending = options.until, options.ending
    states = None if bake.resumed is None else dict(bake.resumed.states)
    left = list(bake.left)
    if until is not None and bake.resumed is not None and bake.resumed.time >= until:
        left = []
    if left:
        with phase("beginning"):
            simulation.begin(states)
        provenance.resolved.update({path: simulation.resolved(path) for path in simulation.recipes})
        findings.extend(simulation.findings)
    findings.check()
    if not left and not bake.is_complete:
        bake.is_stopped = True
    with bake, phase("simulating", total=len(left)) as simulating:
        try:
            for number, frame in enumerate(left):
                start = clock.now
                if number or states is not None:
                    simulation.advance()
                written = {path: simulation.frame(path) for path in simulation.recipes}
                for path, state in written.items():  # of all fields or of none
                    bake.write(path, state)
                clock.lap("writing")
                if options.seen is not None:
                    options.seen(simulation, frame, written)
                if bake.is_checkpoint_due(frame):
                    bake.checkpoint(frame, simulation.checkpoint())
                    clock.lap("checkpoints")
                spent.append(clock.now - start)
                simulating.step(number + 1)
                if until is not None and frame >= until and bake.is_resumable(frame):
                    bake.is_stopped = True
                    break
        except BaseException as error:
            if ending is not None and isinstance(error, ending.errors) and bake.done:
                bake.end_early(_shortened(provenance, simulation, bake.done, ending))
            raise
    clock.lap("writing")
    for path, solver in simulation.solvers.items():
        if solver.trapped:
            found = f"{counted(solver.trapped, 'splat')} that remain inside the affectors"
            expected = "enough space between affectors"
            findings.add(finding("trapped-splats", path, found, expected))
    return Report(
        target=str(bake.target),
        frames=len(spent),
        is_finished=bake.is_complete,
        splats={path: len(solver.state) for path, solver in simulation.solvers.items()},
        seconds=clock.elapsed,
        seconds_per_frame=float(np.median(spent[1:] or spent or [0.0])),
        stages={name: round(value, 3) for name, value in clock.spent.items()},
        megabytes=peak_memory() / 1e6,
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


def _provenance(simulation: Simulation, parameters: Parameters) -> Provenance:
    """Return what a bake is made of."""
    sim, stage, frames = parameters.sim, simulation.captured, simulation.frames
    with simulation.reading:
        opinions, lines = parameter_hash(stage, frames), parameter_lines(stage, frames)
        rate, edits = stage.GetTimeCodesPerSecond(), stage.GetSessionLayer().identifier
    return Provenance(
        param_hash=opinions,
        parameters=lines,
        input_hash=input_hash(stage, [edits], simulation.files, reading=simulation.reading),
        seed=sim.seed,
        substeps=sim.substeps,
        dt=1.0 / (rate * sim.substeps),
        frame_range=(frames[0], frames[-1]),
        mode=parameters.bake.mode,
        threads=simulation.device.threads,
        features=tuple(sorted(_features(simulation))),
    )


def _shortened(
    provenance: Provenance, simulation: Simulation, frames: Sequence[float], ending: Ending
) -> Provenance:
    """Return what a bake of the first frames is made of."""
    with ending.reading:
        opinions = parameter_hash(simulation.captured, frames)
        lines = parameter_lines(simulation.captured, frames)
    span = frames[0], frames[-1]
    return replace(provenance, param_hash=opinions, parameters=lines, frame_range=span)


def _features(simulation: Simulation) -> Iterator[str]:
    """Yield "path: feature" for each feature that the simulation prepares for a field."""
    for path, uses in simulation.uses.items():
        for name in Uses.__dataclass_fields__:
            if getattr(uses, name):
                yield f"{path}: {name}"
        for array in simulation.transformed[path]:
            yield f"{path}: {array} in another space"
