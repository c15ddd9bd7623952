"""Export a stage over time as a sequence of capture files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from pathlib import Path

from pxr import Usd

from usdsplat import formats, schema
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.images.frame_numbers import LIMIT, frame_paths, has_place
from usdsplat.interchange import files
from usdsplat.interchange.exporting import export_capture
from usdsplat.interchange.gathering import widened
from usdsplat.interchange.reports import ExportReport, SequenceExportReport
from usdsplat.interchange.sequence_files import Notes

Export = Callable[[Usd.Stage, Path, float], ExportReport]
"""Function that writes a stage at a time code to a file."""


def _export(stage: Usd.Stage, target: Path, time: float) -> ExportReport:
    return export_capture(stage, target, time=time)


def export_sequence(
    source: Path | str | Usd.Stage,
    target: Path | str,
    *,
    frames: Sequence[float] | None = None,
    export: Export = _export,
    progress: Progress = silent,
) -> SequenceExportReport:
    """Write a stage as one capture per frame, numbered by time code.

    Each file appears when it is complete, so an interruption leaves whole frames.

    Args:
        source: A USD file, or a stage, which is not modified.
        target: A name with a placeholder for the frame number: `out.####.sog` or `out.%04d.sog`.
        frames: Time codes; None is every one from the stage's start to its end or, if it has
            neither, those of the fields' samples.
        export: Function that writes a frame, with options other than `export_capture`'s defaults.
        progress: Receives the progress of the frames.

    Raises:
        StageError: If the source cannot be opened, or there is no field to write.
        UsageError: If the name has no placeholder or one that is too small, or the stage is static
            and `frames` is None.
        UnknownFormatError: If the target's suffix cannot be written.
        OutputError: If a file cannot be written, or is a file of the source.
    """
    pattern = Path(target)
    formats.frame_written(pattern)
    if not has_place(pattern):
        raise UsageError(
            str(pattern), "no placeholder", "one placeholder for the frame number, such as ####"
        )
    stage = source if isinstance(source, Usd.Stage) else files.open_stage(Path(source))
    name = stage.GetRootLayer().identifier if isinstance(source, Usd.Stage) else str(source)
    times = frames_of(stage, frames)
    if not times:
        raise UsageError(name, "no frames", "a stage with a range of them, or --frames")

    def write(path: Path, time: float) -> ExportReport:
        return export(stage, path, time)

    return write_frames(name, pattern, times, write, progress=progress)


def write_frames(
    source: str,
    target: Path,
    times: Sequence[float],
    write: Callable[[Path, float], ExportReport],
    *,
    progress: Progress = silent,
) -> SequenceExportReport:
    """Write a file for each frame and return a joint report.

    Args:
        source: Name of the source.
        target: A name with a placeholder for the frame number.
        times: Frames, at least one.
        write: Function that writes the file of a frame.
        progress: Receives the progress of the frames.

    Raises:
        UsageError: If the placeholder is too small.
        UsdSplatError: As for `write`.
    """
    reports, notes = [], Notes()
    for done, (time, path) in enumerate(zip(times, frame_paths(target, times), strict=True)):
        progress.step("frames", done, len(times))
        reports.append(write(path, time))
        notes.add(time, reports[-1].notes)
    progress.step("frames", len(times), len(times))
    return SequenceExportReport(
        source=source,
        target=str(target),
        prim_paths=tuple(dict.fromkeys(path for each in reports for path in each.prim_paths)),
        splats=sum(each.splats for each in reports),
        degree=max(each.degree for each in reports),
        frame=reports[0].frame,
        error_bounds=reduce(widened, [each.error_bounds for each in reports]),
        notes=notes.told(),
        findings=tuple(dict.fromkeys(found for each in reports for found in each.findings)),
        frames=tuple(times),
        counts=tuple(each.splats for each in reports),
        frame_notes=tuple(each.notes for each in reports),
    )


def frames_of(stage: Usd.Stage, frames: Sequence[float] | None) -> list[float]:
    """Return the frames that `export_sequence` writes, ascending.

    Args:
        stage: The stage.
        frames: Time codes; None for those of the stage, see `export_sequence`.

    Raises:
        UsageError: If the range of the stage is not one of frames.
    """
    return sorted(set(_times(stage) if frames is None else frames))


def _times(stage: Usd.Stage) -> list[float]:
    """Return the frames of an animated stage."""
    if stage.HasAuthoredTimeCodeRange():
        first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
        span = last - first + 1e-6
        if not 0 <= span < LIMIT:  # false for infinities too
            expected = f"1 to {LIMIT} frames, or --frames that says which"
            name = stage.GetRootLayer().identifier
            raise UsageError(name, f"time codes {first:g} to {last:g}", expected)
        return [first + i for i in range(int(span) + 1)]
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    fields = (prim for prim in prims if schema.is_splat_field(prim))
    return [time for prim in fields for time in schema.sample_times(prim)]
