"""A stage over time becomes a sequence of capture files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from pathlib import Path

from pxr import Usd

from usdsplat import formats, schema
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.images.frames import LIMIT, frame_paths, has_place
from usdsplat.interchange import files
from usdsplat.interchange.exporting import export_capture
from usdsplat.interchange.gathering import widened
from usdsplat.interchange.reports import ExportReport, SequenceExportReport
from usdsplat.interchange.sequence_files import Notes

Export = Callable[[Usd.Stage, Path, float], ExportReport]
"""Writes a stage at a time code as a file."""


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
    """Write a stage as one capture for each frame, numbered by time code.

    Each file appears when it is complete; what an interruption leaves are whole frames.

    Args:
        source: A USD file, or a stage, which is not changed.
        target: A name with a place for the frame number: `out.####.sog` or `out.%04d.sog`.
        frames: Time codes; None is each one from the stage's start to its end or, where it says
            neither, those at which a field has a sample.
        export: What writes a frame; one that is asked for more than `export_capture` by itself.
        progress: Told about each frame.

    Raises:
        StageError: If the source cannot be opened, or there is no field to write.
        UsageError: If the name has no place for the number or one too small, or the stage does not
            change over time and `frames` are not given.
        UnknownFormatError: If the target's suffix is none that can be written.
        OutputError: If a file cannot be written, or belongs to the source.
    """
    pattern = Path(target)
    formats.frame_written(pattern)
    if not has_place(pattern):
        raise UsageError(str(pattern), "no place", "one place for the frame number, such as ####")
    stage = source if isinstance(source, Usd.Stage) else files.open_stage(Path(source))
    times = sorted(set(_times(stage) if frames is None else frames))
    if not times:
        raise UsageError(str(source), "no frames", "a stage with a range of them, or --frames")
    name = stage.GetRootLayer().identifier if isinstance(source, Usd.Stage) else str(source)

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
    """Write a file for each frame, and say so as of one.

    Args:
        source: What to call it.
        target: A name with a place for the frame number.
        times: The frames, at least one.
        write: Writes the file of a frame.
        progress: Told about each frame.

    Raises:
        UsageError: If the place is too small.
        UsdSplatError: What `write` raises.
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
        frames=tuple(times),
        counts=tuple(each.splats for each in reports),
    )


def _times(stage: Usd.Stage) -> list[float]:
    """The frames of a stage that changes over time."""
    if stage.HasAuthoredTimeCodeRange():
        first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
        span = last - first + 1e-6
        if not 0 <= span < LIMIT:  # nor is it infinite then
            expected = f"1 to {LIMIT} frames, or --frames that says which"
            name = stage.GetRootLayer().identifier
            raise UsageError(name, f"time codes {first:g} to {last:g}", expected)
        return [first + i for i in range(int(span) + 1)]
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    fields = (prim for prim in prims if schema.is_splat_field(prim))
    return [time for prim in fields for time in schema.sample_times(prim)]
