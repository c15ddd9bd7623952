"""Convert between any files that hold splats, by their suffixes."""

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
from usdsplat.formats.sog.lod_meta import LOD_META
from usdsplat.images.frame_numbers import has_place
from usdsplat.interchange import files
from usdsplat.interchange.authoring import IN_USD_MEMORY
from usdsplat.interchange.axes_choice import AUTO
from usdsplat.interchange.capturing import ToCapture
from usdsplat.interchange.exporting import export_stage
from usdsplat.interchange.gathering import reading_for
from usdsplat.interchange.importing import import_capture
from usdsplat.interchange.options import (
    EXPORT,
    IMPORT,
    SEQUENCE,
    ExportOptions,
    ImportOptions,
    SequenceOptions,
    StageReading,
)
from usdsplat.interchange.repacking import repack
from usdsplat.interchange.reports import ExportReport, ImportReport, RepackReport, SplitReport
from usdsplat.interchange.sequence_exporting import export_sequence
from usdsplat.interchange.sequence_files import is_sequence
from usdsplat.interchange.sequences import import_sequence
from usdsplat.interchange.streamed_writing import write_streamed
from usdsplat.interchange.tree_reading import LEAVES

Report = ImportReport | ExportReport | SplitReport | RepackReport


def convert(
    source: Path | str | Sequence[Path | str],
    target: Path | str,
    *,
    edits: Sequence[Edit] = (),
    options: ImportOptions = IMPORT,
    sequence: SequenceOptions = SEQUENCE,
    export: ExportOptions = EXPORT,
    flatten: bool = False,
    progress: Progress = silent,
) -> Report:
    """Convert captures to a stage, stages to a capture, or either to another of its kind.

    Args:
        source: A capture or a USD file. Several are joined, in the coordinates of the first: any of
            them into a capture, captures into a stage. A capture's name with a placeholder for the
            frame number, such as `cap.####.ply`, is a sequence.
        target: A capture or a USD file, replaced when the new one is complete; or the name of a
            sequence of captures, for a stage or another sequence.
        edits: Edits in order. They apply to the coordinates of the capture that is read; for a
            stage, to those of the capture that is written; from stage to stage, to each field's
            own.
        options: Options of fields in a USD target, and of readers of captures. `axes` are those of
            the target if it is a capture, with the format's default for None; else those of the
            source. `prim_path` is that of the field to write, or to read from a stage.
        sequence: Options of a sequence of captures.
        export: Options of captures that are written.
        flatten: Whether a stage that becomes a stage is flattened, see `repack`.
        progress: Receives the progress of each step.

    Raises:
        UsdSplatError: As for `import_capture`, `import_sequence`, `export_capture`,
            `export_sequence` and `repack`.
    """
    sources = [Path(source)] if isinstance(source, Path | str) else [Path(each) for each in source]
    path = check_target(target)
    check_sequences(sources, path)
    stages = [each for each in sources if files.is_usd(each)]
    if files.is_usd(path) and stages:
        if len(sources) > 1:
            raise UsageError(str(stages[0]), "a stage among several inputs", "only captures")
        return repack(
            sources[0], path, form=options.form, edits=edits, flatten=flatten, progress=progress
        )
    if path.name.lower() == LOD_META:
        return _to_streamed(sources, path, edits, options, export, progress)
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
    axes = None if options.axes == AUTO else options.axes
    stages_read = StageReading(prim_path=options.prim_path, time=export.time, trees=export.trees)
    work = ToCapture(
        edits=tuple(edits),
        axes=axes,
        stages=stages_read,
        trees_at=export.trees_at,
        reading=reading,
        writing=export.writing,
        progress=progress,
    )
    if is_sequence(sources[0]):
        return work.each_frame(sources[0], path, sequence.frames)
    if export.split and (len(sources) > 1 or not stages or has_place(path)):
        listed = ", ".join(map(str, sources))
        raise UsageError("split", listed, "one stage, written as one capture per field")
    if len(sources) > 1 or not stages:
        return work.write(sources, path)
    if has_place(path):
        return export_sequence(
            sources[0], path, frames=sequence.frames, export=work.of_stage, progress=progress
        )
    return export_stage(
        sources[0],
        path,
        stages_read,
        split=export.split,
        axes=axes,
        edits=edits,
        how=export.writing,
        progress=progress,
    )


def _to_streamed(
    sources: Sequence[Path],
    target: Path,
    edits: Sequence[Edit],
    options: ImportOptions,
    export: ExportOptions,
    progress: Progress,
) -> ExportReport:
    """Write the splat trees of a stage as a streamed SOG.

    Raises:
        UsageError: If there is another input than one stage, or an option has no effect.
        UsdSplatError: As for `write_streamed`.
    """
    if len(sources) > 1 or not files.is_usd(sources[0]):
        expected = "one stage with splat trees, such as usdsplat lod writes"
        raise UsageError(str(target), ", ".join(map(str, sources)), expected)
    if edits or export.split or export.trees != LEAVES or export.trees_at:
        found = "edits, --split, --lod, --max-splats or --camera"
        raise UsageError(str(target), found, "none of these: all levels of the trees are written")
    reading = StageReading(prim_path=options.prim_path, time=export.time)
    axes = None if options.axes == AUTO else options.axes
    return write_streamed(sources[0], target, reading, axes=axes, progress=progress)


def check_target(target: Path | str) -> Path:
    """Return the target as a path if its suffix can be written.

    Raises:
        UnknownFormatError: If the suffix cannot be written.
        OutputError: If the name is that of a folder.
    """
    path = Path(target)
    if str(target).endswith(os.sep):
        raise OutputError(str(target), "the name of a folder", "one of a file")
    known = (*formats.suffixes_written(), f"/{LOD_META}", *files.SUFFIXES)
    if not f"/{path.name.lower()}".endswith(known):
        found = f"suffix {path.suffix!r}"
        if path.suffix.lower() == ".html":
            raise UnknownFormatError(str(path), found, "another one: write_page writes pages")
        listed = [f"a folder with {end[1:]}" if end[0] == "/" else end for end in known]
        raise UnknownFormatError(str(path), found, f"one of {', '.join(listed)}, or .html")
    return path


def check_sequences(sources: Sequence[Path], target: Path) -> None:
    """Raise an error for placeholders of frame numbers that cannot be used.

    Raises:
        UsageError: If a sequence is joined with other inputs, or converted to something other than
            a stage or a sequence; or if the source of a sequence to write has no frames.
    """
    patterns = [each for each in sources if is_sequence(each)]
    if patterns and len(sources) > 1:
        raise UsageError(
            str(patterns[0]), "a sequence among several inputs", "the sequence as the only input"
        )
    if files.is_usd(target):
        return
    writes = has_place(target)
    if patterns and not writes:
        expected = "a stage, or a name with a placeholder for the frame number, such as ####"
        raise UsageError(str(target), "one file for a sequence", expected)
    if writes and not patterns and (len(sources) > 1 or not files.is_usd(sources[0])):
        found = "a placeholder for the frame number but no frames"
        raise UsageError(str(target), found, "a sequence or a stage to read")
