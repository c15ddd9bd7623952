"""Run `usdsplat render` as a job."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usdsplat.cli import bundles, console
from usdsplat.cli.job_options import COLD, JobOptions, JobRunner, of_task
from usdsplat.cli.render_options import Options
from usdsplat.cli.reporting import Reporter
from usdsplat.cli.values import bytes_of
from usdsplat.cli.words import words_of
from usdsplat.core.errors import UsageError, UsdSplatError
from usdsplat.images.frame_numbers import FileName, frame_path

if TYPE_CHECKING:
    from usdsplat.jobs.job import Job
    from usdsplat.products.request import PicturePlan

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
        keep_tiles=options.tiles is not None,  # the job removes them when a picture is reported
        job=JobOptions(),
        reporting=of_task(options.reporting),
    )


def ends_of(frames: Sequence[float]) -> str:
    """Return the frames that the camera of a stage without one frames, as text."""
    from usdsplat.jobs.frames import frames_text
    from usdsplat.products.frames import framed

    return ",".join(frames_text([each]) for each in framed(frames))


def run_as_job(
    options: Options,
    task: Options,
    plans: Sequence[PicturePlan],
    frames: Sequence[float],
    runner: JobRunner,
    reporter: Reporter,
    *,
    left: Sequence[float] | None = None,
    drawn: Sequence[dict[str, Any]] = (),
) -> int:
    """Run the pictures as tasks, and print each file when it is finished.

    Args:
        options: Options of the job.
        task: Options of a task, see `as_task`.
        plans: The pictures.
        frames: All frames.
        runner: Runs the tasks.
        reporter: Receives progress and findings.
        left: Frames that are to be drawn; None for all.
        drawn: Reports on the pictures of the others.
    """
    from usdsplat.products.preparing import files_of
    from usdsplat.products.tiles import remove_tiles

    if options.job.openjd is not None:
        return _write_bundle(options, task, frames, reporter)
    left = frames if left is None else left
    files = files_of(plans, frames)
    before = {path: _version(path) for group in files for path in group}
    report = list(drawn)

    def finish(picture: dict[str, Any]) -> None:
        if options.tiles is not None:
            remove_tiles(Path(picture["path"]))
        report.append(picture)
        if not options.json:
            console.say_path(Path(picture["path"]))

    def finish_others() -> None:
        """Report what processes wrote that died, or failed later, before they told of it."""
        told = {picture["path"] for picture in report}
        for plan, group in zip(plans, files, strict=True):
            for frame, path in zip(frames, group, strict=True):
                if str(path) not in told and _version(path) not in (None, before[path]):
                    finish(_untold(plan, frame, path, task.device))

    try:
        for printed in runner.run(_job(options, task, left, options.job.chunk, len(runner))):
            for picture in printed["pictures"]:
                if not picture["path"].endswith(TILE_SUFFIX):
                    finish(picture)
    except (UsdSplatError, KeyboardInterrupt):
        finish_others()
        raise
    finish_others()
    by_frame = [path for row in zip(*files, strict=True) for path in row]
    if options.tiles is not None:
        for path in by_frame:
            remove_tiles(path)  # those that were drawn again for a worker that died
    order = {str(path): i for i, path in enumerate(by_frame)}
    report.sort(key=lambda picture: order[picture["path"]])
    say_end(options, report, files, reporter)
    return 0


def _version(path: Path) -> tuple[int, ...] | None:
    """Return inode, time [ns] and size [byte] of a file, which change when it is replaced; None if
    there is no file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns, status.st_size


def _untold(plan: PicturePlan, frame: float, path: Path, device: str) -> dict[str, Any]:
    """Return the report on a picture, without what only the process knew that drew it."""
    from usdsplat.products.drawing import aovs_in

    return {
        "path": str(path),
        "frame": frame,
        "product": plan.product or None,
        "camera": plan.camera,
        "aovs": aovs_in(plan),
        "device": device,
        "resolution": plan.framing.resolution,
        **dict.fromkeys(("splats", "visible", "seconds", "deep_samples")),
    }


def _job(
    options: Options, task: Options, frames: Sequence[float], chunk: int | None, workers: int = 1
) -> Job:
    """Return the job of the options."""
    from usdsplat.jobs.frames import render_job
    from usdsplat.products.tiles import Tiling

    return render_job(
        ("render", *words_of(task)),
        frames,
        name=f"render {options.stage.name}",
        chunk=chunk,
        workers=workers,
        tiling=None if options.tiles is None else Tiling.parse(options.tiles),
        uses_gpu=task.device == "cuda",
        memory=bytes_of(options.memory_limit),
    )


def _write_bundle(
    options: Options, task: Options, frames: Sequence[float], reporter: Reporter
) -> int:
    """Write the pictures as an Open Job Description bundle."""
    from usdsplat.jobs.openjd import Bundle

    folder, opening, framing = options.job.openjd, options.stage_opening, options.framing
    assert folder is not None  # checked by the caller
    output = bundles.output_name(options.output)
    if options.output is not None and FileName.of(options.output).in_folder:
        expected = "one in the name of the file only"
        raise UsageError("--output", f"{options.output}, a frame in a folder's name", expected)
    chunk = options.job.chunk or COLD
    config = options.color.ocio_config
    if config and Path(config).is_file():
        config = bundles.absolute(config)
    session = opening.session_layer
    read: list[str | Path | None] = [session, config]
    read += [frame_path(framing.holdout, each) for each in frames] if framing.holdout else []
    source = bundles.stage_source(options.stage)
    task = replace(
        task,
        framing=replace(framing, holdout=bundles.absolute(framing.holdout)),
        stage_opening=replace(opening, session_layer=session and session.absolute()),
        color=replace(options.color, ocio_config=config),
        stage=Path(source.word()),
        output=output,
        keep_tiles=False,
        json=False,
        resume=True,
        reporting=bundles.on_a_farm(options.reporting),
    )
    bundle = Bundle(
        folder=folder,
        source=source,
        results="pictures",
        frames=frames,
        chunk=chunk,
        inputs=bundles.existing(read),
    )
    job = _job(options, task, frames, chunk)
    return bundles.write(job, bundle, [options.stage], reporter, json=options.json)


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
