"""Any files that hold splats to any other, chosen by their suffixes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from usdsplat import formats
from usdsplat.core.edits import Edit
from usdsplat.core.errors import OutputError, UnknownFormatError, UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.images.frames import has_place
from usdsplat.interchange import files
from usdsplat.interchange.authoring import IN_USD_MEMORY
from usdsplat.interchange.capturing import ToCapture
from usdsplat.interchange.exporting import export_capture, export_each
from usdsplat.interchange.gathering import reading_for
from usdsplat.interchange.importing import import_capture
from usdsplat.interchange.options import (
    EXPORT,
    IMPORT,
    SEQUENCE,
    ExportOptions,
    ImportOptions,
    SequenceOptions,
)
from usdsplat.interchange.repacking import repack
from usdsplat.interchange.reports import ExportReport, ImportReport, RepackReport, SplitReport
from usdsplat.interchange.sequence_exporting import export_sequence
from usdsplat.interchange.sequence_files import is_sequence
from usdsplat.interchange.sequences import import_sequence

Report = ImportReport | ExportReport | SplitReport | RepackReport


def convert(
    source: Path | str | Sequence[Path | str],
    target: Path | str,
    *,
    edits: Sequence[Edit] = (),
    options: ImportOptions = IMPORT,
    sequence: SequenceOptions = SEQUENCE,
    export: ExportOptions = EXPORT,
    progress: Progress = silent,
) -> Report:
    """Turn captures into a stage, stages into a capture, or either into another of its kind.

    Args:
        source: A capture or a USD file; or several, which become one: any into a capture, captures
            into a stage, all in the coordinates of the first. A capture's name with a place for the
            frame number, such as `cap.####.ply`, is a sequence.
        target: A capture or a USD file, replaced when the new one is complete; or the name of a
            sequence of captures, of a stage or of another sequence.
        edits: Done in this order. They act on the numbers of the capture that is read; of a stage,
            on those of the capture that it becomes; from stage to stage, on each field's own.
        options: Of fields in a USD target, and of readers of captures. `axes` are those of the
            target if that is a capture, the format's own if None; else those of the source.
            `prim_path` is that of the field to write, or to read from a stage.
        sequence: Of a sequence of captures.
        export: Of captures that are written.
        progress: Told about each step.

    Raises:
        UsdSplatError: As `import_capture`, `import_sequence`, `export_capture`, `export_sequence`
            and `repack` say.
    """
    sources = [Path(source)] if isinstance(source, Path | str) else [Path(each) for each in source]
    path = check_target(target)
    check_sequences(sources, path)
    stages = [each for each in sources if files.is_usd(each)]
    if files.is_usd(path) and stages:
        if len(sources) > 1:
            raise UsageError(str(stages[0]), "a stage among several inputs", "captures alone")
        return repack(sources[0], path, form=options.form, edits=edits, progress=progress)
    reading = reading_for(edits, options.reading)
    if files.is_usd(path) and is_sequence(sources[0]):
        how = replace(reading, empty=IN_USD_MEMORY.empty)
        return import_sequence(
            sources[0],
            path,
            edits=edits,
            options=options,
            sequence=sequence,
            read=partial(formats.read, how=how),
            progress=progress,
        )
    if files.is_usd(path):
        return import_capture(sources, path, edits=edits, options=options, progress=progress)
    work = ToCapture(
        edits=tuple(edits),
        axes=options.axes,
        prim_path=options.prim_path,
        time=export.time,
        reading=reading,
        writing=export.writing,
        progress=progress,
    )
    if is_sequence(sources[0]):
        return work.each_frame(sources[0], path, sequence.frames)
    if export.split and (len(sources) > 1 or not stages or has_place(path)):
        listed = ", ".join(map(str, sources))
        raise UsageError("split", listed, "one stage that becomes one capture for each field")
    if len(sources) > 1 or not stages:
        return work.write(sources, path)
    if has_place(path):
        return export_sequence(
            sources[0], path, frames=sequence.frames, export=work.of_stage, progress=progress
        )
    return (export_each if export.split else export_capture)(
        sources[0],
        path,
        prim_path=options.prim_path,
        time=export.time,
        axes=options.axes,
        edits=edits,
        how=export.writing,
        progress=progress,
    )


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


def check_sequences(sources: Sequence[Path], target: Path) -> None:
    """Refuse names with a place for the frame number where nothing has frames.

    Raises:
        UsageError: If a sequence is to become one with other inputs, or something else than a stage
            or a sequence; or if there is no sequence to write.
    """
    patterns = [each for each in sources if is_sequence(each)]
    if patterns and len(sources) > 1:
        raise UsageError(str(patterns[0]), "a sequence among several inputs", "it alone")
    if files.is_usd(target):
        return
    writes = has_place(target)
    if patterns and not writes:
        expected = "a stage, or a name with a place for the frame number, such as ####"
        raise UsageError(str(target), "one file for a sequence", expected)
    if writes and not patterns and (len(sources) > 1 or not files.is_usd(sources[0])):
        found = "a place for the frame number but no frames"
        raise UsageError(str(target), found, "a sequence or a stage to read")
