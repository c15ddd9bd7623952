"""Run `usdsplat relight` as a job: the times at which the stage is lit, side by side."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from usdsplat.cli import bundles
from usdsplat.cli.job_options import COLD, JobOptions, JobRunner, environments, of_task
from usdsplat.cli.relight_options import Options
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.words import words_of
from usdsplat.core.errors import UsageError
from usdsplat.core.findings import Findings
from usdsplat.core.folders import check_folder

if TYPE_CHECKING:
    from usdsplat.jobs.job import Job
    from usdsplat.products.lit_times import LitFolder
    from usdsplat.products.relighting import Relighting

CUDA = "cuda"
LIGHTING = ("usdsplat.cli.stages", "usdsplat.products.relighting")
"""Modules that tasks need."""


def check_job(options: Options) -> None:
    """Raise an error for what cannot be a job, before its processes start.

    Raises:
        UsageError: If a part is to run as a job, or the captured HDRI cannot be read.
        StageError: If there is no stage, or no session layer.
        OutputError: If nothing can be written there.
        BackendError: If processes of this machine are to use a GPU that it has not.
    """
    from usdsplat.interchange.files import check_layer_file
    from usdsplat.kernels.devices import check_gpu

    if not options.job.is_asked:
        return
    if options.part is not None:
        raise UsageError("--part", "it with --jobs, --dask or --openjd", "one of them")
    for file in (options.stage, options.opening.session_layer):
        if file is not None:
            check_layer_file(file)
    if options.job.openjd is None:  # otherwise the results lie elsewhere
        check_folder(options.output.parent)
    if options.device == CUDA and options.job.is_here:
        check_gpu()


def runner_of(options: Options, reporter: Reporter) -> JobRunner:
    """Return what runs the tasks of a command. It can fork its processes until a stage is open.

    Raises:
        UsageError: If the number of processes is wrong.
    """
    workers = environments(options.job, device=options.device, threads=options.threads)
    return JobRunner(options.job, reporter, workers, LIGHTING)


def run_tasks(
    options: Options,
    work: Relighting,
    folder: LitFolder,
    runner: JobRunner,
    reporter: Reporter,
    *,
    device: str,
) -> Findings:
    """Light the stage by tasks. Return their findings that are not about the stage: messages of
    libraries, which a command says at its end.

    Args:
        options: The options of the command.
        work: The times at which the stage is lit.
        folder: Where the tasks store their results.
        runner: Runs the tasks.
        reporter: Receives the findings, time by time, as soon as all before are known.
        device: Name of the device of all tasks.

    Raises:
        StrictError: If findings are strict, and there are some.
        UsageError: If the captured HDRI cannot be read.
        JobError: If a task fails.
    """
    from usdsplat.jobs.frames import TURNS

    _check_picture(options)
    chunk = options.job.chunk
    parts = min(len(work), len(runner) * TURNS) if chunk is None else _parts(work, chunk)
    if len(work) == 1:
        reporter.remark("the stage is lit at one time only, so the job is one task")
    reporting = replace(of_task(options.reporting), strict=False)  # what all find is judged here
    job = _job(_task(options, device, reporting, json=True), parts, device)
    messages = Findings()
    with closing(runner.run(job, findings=messages)) as ended:
        for _ in ended:
            work.say(folder)
    return messages


def write_bundle(
    options: Options, work: Relighting, folder: Path, reporter: Reporter, *, device: str
) -> int:
    """Write a bundle for a farm whose tasks light the stage, and return the exit status.

    Args:
        options: The options of the command.
        work: The times at which the stage is lit.
        folder: Folder of the bundle.
        reporter: See `bundles.write`.
        device: Name of the device of all tasks.

    Raises:
        UsdSplatError: See `bundles.write`.
    """
    from usdsplat.jobs.openjd import MOST_VALUES, Bundle

    _check_picture(options)
    picture, session = options.captured_hdri, options.opening.session_layer
    if picture is None:
        source = bundles.stage_source(options.stage)
        stage, files = source.word(), [options.stage]
    else:
        source = bundles.folder_source()
        stage, files = source.word(f"1/{options.stage.name}"), [options.stage, picture]
    there = replace(
        options,
        stage=Path(stage),
        output=Path(bundles.output_name(options.output)),
        captured_hdri=picture and Path(source.word(f"2/{picture.name}")),
        opening=replace(options.opening, session_layer=session and session.absolute()),
    )
    task = _task(there, device, bundles.on_a_farm(options.reporting), json=False)
    chunk = options.job.chunk or max(COLD, -(-len(work) // MOST_VALUES))
    job = _job(task, _parts(work, chunk), device, finishes=True)
    bundle = Bundle(
        folder=folder, source=source, results="layer", inputs=bundles.existing([session])
    )
    return bundles.write(job, bundle, files, reporter, json=options.json)


def _check_picture(options: Options) -> None:
    """Raise an error for a captured HDRI that cannot be read.

    Raises:
        UsageError: If it is not there, or no picture.
    """
    from usdsplat.products.captured_hdri import check_picture

    if options.captured_hdri is not None:
        check_picture(options.captured_hdri)


def _task(
    options: Options, device: str, reporting: ReportingOptions, *, json: bool
) -> tuple[str, ...]:
    """Return the words of a task, but for its part."""
    plain = replace(options, device=device, json=json, job=JobOptions(), reporting=reporting)
    return ("relight", *words_of(plain))


def _parts(work: Relighting, chunk: int) -> int:
    """Return the number of equal parts of the times, each with at most `chunk` times."""
    return -(-len(work) // chunk)


def _job(task: tuple[str, ...], parts: int, device: str, *, finishes: bool = False) -> Job:
    """Return the job of a command."""
    from usdsplat.jobs.relights import relight_job

    return relight_job(task, parts=parts, uses_gpu=device == CUDA, finishes=finishes)
