"""Run `usdsplat render` as a job."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usdsplat.cli import console
from usdsplat.cli.job_options import JobOptions, JobRunner, of_task
from usdsplat.cli.render_options import Options
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.values import bytes_of
from usdsplat.cli.words import words_of
from usdsplat.core.errors import UsageError
from usdsplat.images.frame_numbers import FileName, frame_path

if TYPE_CHECKING:
    from usdsplat.jobs.job import Job
    from usdsplat.products.request import PicturePlan

TURNS = 8
"""Number of tasks of each process, where --chunk does not say."""
COLD = 24
"""Frames of a task of a farm, where --chunk does not say: it opens the stage anew."""
TILE_SUFFIX = ".tile"
"""End of the names of files that are no pictures."""


def as_task(options: Options, device: str, fitted: str, first: float) -> Options:
    """Return the options of a task, but for its frames and its tile.

    Args:
        options: Options of the job.
        device: Device that draws all tasks.
        fitted: Frames that the camera frames; "" if the stage has a camera.
        first: First frame of the job.
    """
    return replace(
        options,
        frames=None,
        device=device,
        json=True,
        fit_frames=options.fit_frames or fitted or None,
        stage_name=options.stage_name or str(options.stage),
        plan_frame=first if options.plan_frame is None else options.plan_frame,
        job=JobOptions(),
        reporting=of_task(options.reporting),
    )


def ends_of(frames: Sequence[float]) -> str:
    """Return the frames that the camera of a stage without one frames."""
    from usdsplat.jobs.frames import frames_text

    return ",".join(
        frames_text([each])
        for each in dict.fromkeys((frames[0], frames[len(frames) // 2], frames[-1]))
    )


def run_as_job(
    options: Options,
    task: Options,
    plans: Sequence[PicturePlan],
    frames: Sequence[float],
    runner: JobRunner,
    reporter: Reporter,
) -> int:
    """Run the pictures as tasks, and print each file when it is finished."""
    from usdsplat.products.preparing import files_of

    chunk = options.job.chunk or max(1, len(frames) // (len(runner.workers) * TURNS))
    if options.job.openjd is not None:
        return _write_bundle(options, task, frames, reporter)
    files = files_of(plans, frames)
    report = []
    for printed in runner.run(_job(options, task, frames, chunk)):
        for picture in printed["pictures"]:
            if not picture["path"].endswith(TILE_SUFFIX):
                report.append(picture)
                if not options.json:
                    console.say_path(Path(picture["path"]))
    by_frame = (path for row in zip(*files, strict=True) for path in row)
    order = {str(path): i for i, path in enumerate(by_frame)}
    report.sort(key=lambda picture: order[picture["path"]])
    say_end(options, report, files, reporter)
    return 0


def _absolute(path: str | Path | None) -> str | None:
    """Return a path that holds in any folder; None for none."""
    return None if path is None else str(Path(path).absolute())


def _job(options: Options, task: Options, frames: Sequence[float], chunk: int) -> Job:
    """Return the job of the options."""
    from usdsplat.jobs.frames import render_job
    from usdsplat.products.tiles import Tiling

    return render_job(
        ("render", *words_of(task)),
        frames,
        name=f"render {options.stage.name}",
        chunk=chunk,
        tiling=None if options.tiles is None else Tiling.parse(options.tiles),
    )


def _write_bundle(
    options: Options, task: Options, frames: Sequence[float], reporter: Reporter
) -> int:
    """Write the pictures as an Open Job Description bundle."""
    from usdsplat.jobs.openjd import (
        ASSETS,
        TEMPLATE,
        Bundle,
        output_word,
        stage_word,
        template_of,
        write_bundle,
    )  # fmt: skip
    from usdsplat.products.localizing import localize

    folder = options.job.openjd
    assert folder is not None  # checked by the caller
    if options.output is None:
        raise UsageError("--openjd", "no --output", "-o FILE, whose name the pictures get")
    if FileName.of(options.output).in_folder:
        expected = "one in the name of the file only"
        raise UsageError("--output", f"{options.output}, a frame in a folder's name", expected)
    chunk = options.job.chunk or COLD
    framing, opening = options.framing, options.stage_opening
    config = options.color.ocio_config
    if config and Path(config).is_file():
        config = str(Path(config).absolute())
    session = _absolute(opening.session_layer)
    layer = None if session is None else Path(session)
    read: list[str | Path | None] = [layer, config]
    read += [frame_path(framing.holdout, each) for each in frames] if framing.holdout else []
    files = (str(Path(path).absolute()) for path in read if path and Path(path).exists())
    inputs = tuple(dict.fromkeys(files))
    task = replace(
        task,
        framing=replace(framing, holdout=_absolute(framing.holdout)),
        stage_opening=replace(opening, session_layer=layer),
        color=replace(options.color, ocio_config=config),
        stage=Path(stage_word()),
        output=output_word(Path(options.output).name),
        json=False,
        resume=True,
        reporting=ReportingOptions(strict=options.reporting.strict, progress="openjd"),
    )
    job = _job(options, task, frames, chunk)
    bundle = Bundle(
        folder=folder,
        stage=f"{ASSETS}/{options.stage.name}",
        frames=frames,
        chunk=chunk,
        device=task.device,
        memory=bytes_of(options.memory_limit),
        inputs=inputs,
    )
    template_of(job, bundle)
    localize(options.stage, folder / ASSETS)
    for path in write_bundle(job, bundle):
        if path.name == TEMPLATE and not options.json:
            console.say_path(path)
    if options.json:
        reporter.print_json({"template": str(folder / TEMPLATE)})
    return 0


def say_end(
    options: Options,
    report: Sequence[dict[str, Any]],
    files: Sequence[Sequence[Path]],
    reporter: Reporter,
) -> None:
    """Say that there was nothing to do, or print the JSON object."""
    if not report:
        reporter.remark("nothing to do: every file exists already")
    if options.json:
        done = {picture["path"] for picture in report}
        skipped = [str(path) for group in files for path in group if str(path) not in done]
        reporter.print_json({"pictures": list(report), "skipped": skipped})
