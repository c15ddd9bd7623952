"""Any files that hold splats to any other, chosen by their suffixes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from usdsplat import formats
from usdsplat.core.edits import Edit
from usdsplat.core.errors import OutputError, UnknownFormatError, UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.formats.capture import UNKNOWN_AXES, Capture
from usdsplat.formats.options import READING, WRITING, Reading, Writing
from usdsplat.interchange import files
from usdsplat.interchange.exporting import capture_of, export_capture, export_each
from usdsplat.interchange.gathering import edit_capture, joined, reading_for, turned
from usdsplat.interchange.importing import import_capture
from usdsplat.interchange.repacking import repack
from usdsplat.interchange.reports import ExportReport, ImportReport, RepackReport, SplitReport
from usdsplat.schema import Form

Report = ImportReport | ExportReport | SplitReport | RepackReport


def convert(
    source: Path | str | Sequence[Path | str],
    target: Path | str,
    *,
    edits: Sequence[Edit] = (),
    form: Form = "float",
    frame: str | None = None,
    up_axis: str | None = None,
    meters_per_unit: float | None = None,
    prim_path: str | None = None,
    bake_axes: bool = False,
    time: float | None = None,
    split: bool = False,
    reading: Reading = READING,
    writing: Writing = WRITING,
    progress: Progress = silent,
) -> Report:
    """Turn captures into a stage, stages into a capture, or either into another of its kind.

    Args:
        source: A capture or a USD file; or several, which become one: any into a capture, captures
            into a stage, all in the coordinates of the first.
        target: A capture or a USD file, replaced when the new one is complete.
        edits: Done in this order. They act on the numbers of the capture that is read; of a stage,
            on those of the capture that it becomes; from stage to stage, on each field's own.
        form: Of fields in a USD target.
        frame: Where x, y and z of the capture file point: of the target if that is one, as is its
            format's way if None; else of the source, which is believed if None.
        up_axis: See `import_capture`.
        meters_per_unit: See `import_capture`.
        prim_path: Of the field that is written to, or read from, a stage.
        bake_axes: See `import_capture`.
        time: See `export_capture`.
        split: Write each field of a stage to a capture of its own, see `export_each`.
        reading: What is asked of readers of captures.
        writing: What is asked of the writer of a capture.
        progress: Told about each step.

    Raises:
        UsdSplatError: As `import_capture`, `export_capture` and `repack` say.
    """
    sources = [Path(source)] if isinstance(source, Path | str) else [Path(each) for each in source]
    if not sources:
        raise UsageError("source", "no file", "at least one")
    path = check_target(target)
    stages = [each for each in sources if files.is_usd(each)]
    if files.is_usd(path):
        if not stages:
            return import_capture(
                sources,
                path,
                edits=edits,
                form=form,
                frame=frame,
                up_axis=up_axis,
                meters_per_unit=meters_per_unit,
                prim_path=prim_path,
                bake_axes=bake_axes,
                how=reading,
                progress=progress,
            )
        if len(sources) > 1:
            raise UsageError(str(stages[0]), "a stage among several inputs", "captures alone")
        return repack(sources[0], path, form=form, edits=edits, progress=progress)
    if len(sources) == 1 and stages:
        return (export_each if split else export_capture)(
            sources[0],
            path,
            prim_path=prim_path,
            time=time,
            frame=frame,
            edits=edits,
            how=writing,
            progress=progress,
        )
    if split:
        raise UsageError("split", ", ".join(map(str, sources)), "one stage that becomes captures")
    files.check_not_input(path, sources)
    own = frame or formats.frame_written(path)
    how = reading_for(edits, reading)
    captures = [
        _seen(each, own, prim_path, time, progress)
        if files.is_usd(each)
        else formats.read(each, how=how, progress=progress)
        for each in sources
    ]
    capture = edit_capture(joined(captures), edits, progress=progress)
    is_known = frame is not None or UNKNOWN_AXES not in capture.notes
    return _as_capture(sources, path, capture, own, is_known, writing, progress)


def check_target(target: Path | str) -> Path:
    """The target as a path, if its name says what it is to become.

    Raises:
        UnknownFormatError: If it says nothing that can be written.
        OutputError: If it says that it is a folder.
    """
    path = Path(target)
    if str(target).endswith(os.sep):
        raise OutputError(str(target), "the name of a folder", "one of a file")
    known = (*formats.suffixes_written(), *files.SUFFIXES)
    if not f"/{path.name.lower()}".endswith(known):
        found = f"suffix {path.suffix!r}"
        listed = [f"a folder with {end[1:]}" if end[0] == "/" else end for end in known]
        raise UnknownFormatError(str(path), found, f"one of {', '.join(listed)}")
    return path


def _seen(
    source: Path, frame: str, prim_path: str | None, time: float | None, progress: Progress
) -> Capture:
    """What is seen of a stage."""
    stage = files.open_stage(source)
    return capture_of(stage, frame, prim_path=prim_path, time=time, progress=progress)[0]


def _as_capture(
    sources: Sequence[Path],
    target: Path,
    capture: Capture,
    frame: str,
    is_known: bool,
    how: Writing,
    progress: Progress,
) -> ExportReport:
    """Write a capture with its axes turned; the file says where they point if that is known."""
    files.check_not_input(target, capture.files)
    cloud = turned(capture.cloud, capture.frame, frame)
    how = replace(how, antialiased=capture.antialiased, frame=frame if is_known else None)
    formats.write(cloud, target, how=how, progress=progress)
    return ExportReport(
        source=" + ".join(map(str, sources)),
        target=str(target),
        prim_paths=(),
        splats=len(cloud),
        degree=cloud.sh_degree,
        frame=frame,
        notes=capture.notes,
    )
