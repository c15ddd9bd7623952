"""Run `usdsplat convert` of a sequence as a job: its frames side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usdsplat.cli import bundles
from usdsplat.cli.convert_options import Options
from usdsplat.cli.edit_flags import EditFlags, words_of_edits
from usdsplat.cli.job_options import COLD, JobOptions, JobRunner, environments, of_task
from usdsplat.cli.reporting import Reporter, ReportingOptions
from usdsplat.cli.words import words_of
from usdsplat.core.errors import UsageError
from usdsplat.core.folders import check_folder
from usdsplat.images.frame_numbers import frame_paths, has_place

if TYPE_CHECKING:
    from usdsplat.interchange.reports import SequenceExportReport
    from usdsplat.jobs.job import Job


def is_divisible(options: Options, target: str) -> bool:
    """Return whether frames are converted into files of their own, which others may see at once."""
    from usdsplat.interchange.files import is_usd

    is_sequence = has_place(target) and not is_usd(Path(target))
    return is_sequence and not options.reporting.strict


def check_job(options: Options, target: str) -> None:
    """Raise an error if a job does not convert frames side by side.

    Raises:
        UsageError: If the output is one file, or the job is to write all files or none.
    """
    if not options.job.is_asked or is_divisible(options, target):
        return
    if options.reporting.strict:
        found = "it with --jobs, --dask or --openjd"
        raise UsageError("--strict", found, "one of them: tasks write files before others begin")
    expected = "captures with a frame number, such as out.####.sog, which are made side by side"
    raise UsageError(target, "one output of a job", expected)


def run_as_job(
    options: Options,
    target: str,
    frames: Callable[[], Sequence[float]],
    reporter: Reporter,
) -> SequenceExportReport | None:
    """Convert the frames by tasks, and return their joint report; None if a bundle is written.

    Args:
        options: The options of the command.
        target: Name of the output.
        frames: Opens the input, and returns its frames, ascending.
        reporter: Receives progress and findings.

    Raises:
        UsdSplatError: If the input cannot be opened, or nothing can be written.
        JobError: If a task fails.
    """
    workers = environments(options.job, device="cpu", threads=None)
    with JobRunner(options.job, reporter, workers, ("usdsplat.interchange",)) as runner:
        found = frames()
        if not found:
            expected = "a stage with a range of them, or --frames"
            raise UsageError(options.source, "no frames", expected)
        if options.job.openjd is not None:
            _write_bundle(options, target, found, options.job.openjd, reporter)
            return None
        for folder in {path.parent for path in frame_paths(Path(target), found)}:
            check_folder(folder)
        files = (options.source, *options.others)
        task = _task(options, files, of_task(options.reporting), json=True)
        return _joined(
            options, target, list(runner.run(_job(task, found, options.job.chunk, len(runner))))
        )


def _task(
    options: Options, files: tuple[str, ...], reporting: ReportingOptions, *, json: bool
) -> tuple[str, ...]:
    """Return the words of a task, but for its frames."""
    plain = replace(
        options,
        source=files[0],
        others=files[1:],
        json=json,
        sequence=replace(options.sequence, frames=None),
        edit=EditFlags(),
        job=JobOptions(),
        reporting=reporting,
    )
    return ("convert", *words_of(plain), *words_of_edits(options.edit))


def _job(
    command: tuple[str, ...], frames: Sequence[float], chunk: int | None, workers: int = 1
) -> Job:
    from usdsplat.jobs.frames import frames_job

    return frames_job(command, frames, name="convert", chunk=chunk, workers=workers)


def _write_bundle(
    options: Options, target: str, frames: Sequence[float], folder: Path, reporter: Reporter
) -> None:
    """Write the frames as an Open Job Description bundle."""
    from usdsplat.interchange.files import is_usd
    from usdsplat.jobs.openjd import Bundle

    source, chunk = Path(options.source), options.job.chunk or COLD
    is_stage = is_usd(source)
    parameter = bundles.stage_source(source) if is_stage else bundles.folder_source()
    word = parameter.word() if is_stage else parameter.word(f"1/{source.name}")
    files = (word, bundles.output_name(target))
    task = _task(options, files, bundles.on_a_farm(options.reporting), json=False)
    bundle = Bundle(folder=folder, source=parameter, results="captures", frames=frames, chunk=chunk)
    bundles.write(_job(task, frames, chunk), bundle, [source], reporter, json=options.json)


def _joined(
    options: Options, target: str, parts: Sequence[Mapping[str, Any]]
) -> SequenceExportReport:
    """Return the report of all tasks."""
    from usdsplat.interchange.gathering import widened
    from usdsplat.interchange.reports import SequenceExportReport

    parts = sorted(parts, key=lambda each: each["frames"][0])
    return SequenceExportReport(
        source=options.source,
        target=target,
        prim_paths=tuple(dict.fromkeys(path for each in parts for path in each["prim_paths"])),
        splats=sum(each["splats"] for each in parts),
        degree=max(each["degree"] for each in parts),
        frame=parts[0]["frame"],
        error_bounds=reduce(widened, [each["error_bounds"] for each in parts]),
        notes=_notes(parts),
        frames=tuple(frame for each in parts for frame in each["frames"]),
        counts=tuple(count for each in parts for count in each["counts"]),
        frame_notes=tuple(tuple(notes) for each in parts for notes in each["frame_notes"]),
    )


def _notes(parts: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Return the notes of all frames, as one process tells them."""
    from usdsplat.interchange.sequence_files import Notes

    notes = Notes()
    for part in parts:
        for frame, found in zip(part["frames"], part["frame_notes"], strict=True):
            notes.add(frame, found)
    return notes.told()
