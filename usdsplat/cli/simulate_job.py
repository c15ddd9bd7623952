"""Run `usdsplat simulate` as a job."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from usdsplat.cli import bundles
from usdsplat.cli.job_options import JobOptions, JobRunner, environments, of_task
from usdsplat.cli.reporting import Reporter
from usdsplat.cli.simulate_options import BakeOrder, Options, consecutive
from usdsplat.cli.words import words_of
from usdsplat.core.errors import OutputError, StageError, UsageError
from usdsplat.core.folders import check_folder

if TYPE_CHECKING:
    from usdsplat.jobs.job import Job

BAKING = ("usdsplat.cli.stages", "usdsplat.products.wedge", "usdsplat.sim.stage.simulating")
"""Modules that tasks which bake need."""


def check_order(options: Options, source: Path, target: Path) -> None:
    """Raise an error for what cannot be a job, before its processes start.

    Args:
        options: The options of the command.
        source: File of the stage.
        target: File of the bake.

    Raises:
        UsageError: If an option does not work with a job.
        StageError: If there is no stage, or no session layer.
        OutputError: If a file exists, or nothing can be written there.
    """
    from usdsplat.interchange.files import check_layer_file

    if options.frames is not None:
        consecutive(options.frames)
    if options.force:  # tasks may be repeated, and would begin anew what others have done
        raise UsageError("--force", "--force with a job", "--resume, or a new name")
    for file in (source, options.stage_opening.session_layer):
        if file is not None:
            check_layer_file(file)
    if options.job.openjd is not None:  # the bakes lie elsewhere
        return
    check_folder(target.parent)
    if not options.resume:
        for path in _files(options, target):
            if path.exists():
                raise OutputError(str(path), "a file", "a new name, or --resume")


def _files(options: Options, target: Path) -> list[Path]:
    """Return the files of the bakes, and of the contact sheet of a wedge.

    Raises:
        UsageError: If the wedge is wrong.
    """
    from usdsplat.products.wedge import combinations, parse_axes

    if not options.wedge:
        return [target]
    made = combinations(parse_axes(options.wedge), target)
    return [*(each.target for each in made), target.with_suffix(".png")]


def runner_of(options: Options, reporter: Reporter) -> JobRunner:
    """Return what runs the tasks of a command. It can fork its processes until a stage is open.

    Raises:
        UsageError: If the wedge or the number of processes is wrong.
    """
    from usdsplat.products.wedge import parse_axes

    bakes = math.prod(len(axis.values) for axis in parse_axes(options.wedge))
    workers = environments(options.job, device=_device(options), threads=options.threads)
    return JobRunner(options.job, reporter, workers[:bakes], BAKING)


def run_tasks(order: BakeOrder, runner: JobRunner) -> None:
    """Bake by tasks. What is left, such as the contact sheet, is done with --resume.

    Raises:
        UsageError: If the wedge is wrong.
        OutputError: If a bake of the wedge exists.
        JobError: If a task fails.
    """
    options, bakes = order.options, _bakes(order)
    task = replace(_task(options), json=True, reporting=of_task(options.reporting))
    for _ in runner.run(_job(order, task, bakes)):
        pass


def write_bundle(order: BakeOrder, source: Path, folder: Path, reporter: Reporter) -> int:
    """Check the simulations, write the bakes as an Open Job Description bundle, and return the
    status.

    Args:
        order: What is to be baked.
        source: File of its stage.
        folder: Folder of the bundle.
        reporter: See `bundles.write`.

    Raises:
        StageError: If there is no simulation.
        UsdSplatError: See `bundles.write`.
    """
    from usdsplat.jobs.bakes import with_sheet
    from usdsplat.jobs.openjd import Bundle
    from usdsplat.sim.stage.collections import find_simulations
    from usdsplat.sim.stage.validating import validate_simulations

    if not find_simulations(order.stage):
        expected = "one; usdsplat simulate --preset makes one"
        raise StageError(str(source), "no SplatSim prim", expected)
    reporter.findings.extend(validate_simulations(order.stage, time=order.frames[0]))
    options, bakes, parameter = order.options, _bakes(order), bundles.stage_source(source)
    session = options.stage_opening.session_layer
    task = replace(
        _task(options),
        stage=Path(parameter.word()),
        output=Path(bundles.output_name(options.output)),
        stage_opening=replace(options.stage_opening, session_layer=session and session.absolute()),
        json=False,
        reporting=bundles.on_a_farm(options.reporting),
    )
    job = _job(order, task, bakes)
    if bakes is not None:
        last = replace(task, sheet_frame=options.sheet_frame, resume=True)
        job = with_sheet(job, ("simulate", *words_of(last)))
    inputs = bundles.existing([session])
    bundle = Bundle(folder=folder, source=parameter, results="bakes", inputs=inputs)
    return bundles.write(job, bundle, [source], reporter, json=options.json)


def _bakes(order: BakeOrder) -> int | None:
    """Check the wedge, and return the number of its bakes; None without one."""
    from usdsplat.products.wedge import parse_axes, planned

    options = order.options
    if not options.wedge:
        return None
    how = order.wedge
    if options.job.openjd is not None:  # the bakes lie elsewhere
        how = replace(how, simulate=replace(how.simulate, existing="resume"))
    axes = parse_axes(options.wedge)
    return len(planned(order.stage, order.target, order.frames, axes, how))


def _device(options: Options) -> str:
    """Return the device of all tasks."""
    return "cpu" if options.device == "auto" else options.device


def _task(options: Options) -> Options:
    """Return the options of a task, but for its part of the work and its reports."""
    return replace(
        options,
        job=JobOptions(),
        sheet_frame=None,
        device=_device(options),
        resume=False,
        until=None,
    )


def _job(order: BakeOrder, task: Options, bakes: int | None) -> Job:
    """Return the job of an order."""
    from usdsplat.jobs.bakes import bake_job

    options = order.options
    return bake_job(
        ("simulate", *words_of(task)),
        order.frames,
        bakes=bakes,
        chunk=options.job.chunk,
        until=options.until,
        uses_gpu=task.device == "cuda",
    )
