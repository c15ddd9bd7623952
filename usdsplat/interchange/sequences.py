"""Import a sequence of captures as one animated splat field.

The file is written frame by frame, and memory holds one frame. Usually the correspondence of splats
between frames is unknown. All splats then get distinct ids, so that each frame is held until the
next and nothing is interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd

from usdsplat import formats, schema
from usdsplat.core.edits import Edit
from usdsplat.core.errors import UsageError
from usdsplat.core.output import OutputFile, output_file, output_group
from usdsplat.core.progress import Progress, silent
from usdsplat.formats import Capture
from usdsplat.images.frame_numbers import without_place
from usdsplat.interchange import files
from usdsplat.interchange.authoring import (
    IN_USD_MEMORY,
    author_field,
    axes_text,
    given_axes,
    missing_proxy,
    prepare,
)
from usdsplat.interchange.axes_choice import choose_axes, with_axes
from usdsplat.interchange.gathering import edit_capture, unit_assumed, with_unit
from usdsplat.interchange.models import author_extents, author_model
from usdsplat.interchange.options import IMPORT, SEQUENCE, ImportOptions, SequenceOptions
from usdsplat.interchange.placement import field_path, placement
from usdsplat.interchange.provenance import fingerprint, provenance, record
from usdsplat.interchange.reports import SequenceImportReport
from usdsplat.interchange.sequence_clips import Clips
from usdsplat.interchange.sequence_files import Account, files_of
from usdsplat.schema import Form
from usdsplat.schema.stage_values import stage_unit
from usdsplat.schema.usd_files import (
    crate_name,
    is_whole_usd,
    new_layer,
    package_layer,
    save_layer,
    write_copy,
)

_ROW_BITS = 32
_HELD = (
    "each frame is held until the next; applications that ignore ids interpolate between frames "
    "with equally many splats"
)


def _read(path: Path) -> Capture:
    return formats.read(path, how=IN_USD_MEMORY)


def import_sequence(
    source: Path | str,
    target: Path | str,
    *,
    edits: Sequence[Edit] = (),
    options: ImportOptions = IMPORT,
    sequence: SequenceOptions = SEQUENCE,
    read: Callable[[Path], Capture] = _read,
    progress: Progress = silent,
) -> SequenceImportReport:
    """Write a sequence of captures as one splat field, with frame numbers as time codes.

    Frames may differ in their number of splats, but not in degree or axes.

    Args:
        source: A name with a placeholder for the frame number: `cap.####.ply` or `cap.%04d.ply`.
        target: A .usd, .usda, .usdc or .usdz file, replaced when the new one is complete.
        edits: Edits in order, of each frame, in its own coordinates.
        options: Axes, unit, form and path of the field; `cameras` is ignored, and `read` replaces
            the options of the reader.
        sequence: Frames, rate and storage.
        read: Function that reads a file.
        progress: Receives the number of finished frames.

    Raises:
        FormatError: If a file is missing, invalid, or inconsistent with the others.
        UsageError: If an option has an invalid value, edits leave no splat of a frame, or edits
            change rows that are to be interpolated.
        OutputError: If the target cannot be written, or is one of the files being read.
    """
    pattern, path = Path(source), Path(target)
    files.check_suffix(path)
    if not 0 < sequence.rate < math.inf:
        raise UsageError("rate", f"{sequence.rate:g}", "a positive number [1/s]")
    for item in edits:
        if sequence.interpolate and not item.kind.keeps_rows:
            raise UsageError(
                f"edit {item.name}", "interpolation between frames", "an edit that keeps all rows"
            )
    listed = files_of(pattern, sequence.frames)
    files.check_not_input(path, listed.values())
    clip_folder = Clips.folder_of(path) if sequence.clips else None
    with output_group() as group, output_file(path, is_whole=is_whole_usd) as output:
        scratch = output.path.with_name("scratch")
        scratch.mkdir()
        stage = Usd.Stage.Open(new_layer(scratch / crate_name(path), output))
        prepare(stage, options.up_axis, options.meters_per_unit)
        _author_times(stage, tuple(listed), sequence.rate)
        job = _Job(
            stage=stage,
            output=output,
            where=field_path(stage, without_place(pattern), options.prim_path),
            is_model=options.prim_path is None,
            clips=Clips(stage, scratch / clip_folder.name, output) if clip_folder else None,
            form=options.form,
            frame=options.axes,
            meters_per_unit=options.meters_per_unit,
            bake_axes=options.bake_axes,
            interpolate=sequence.interpolate,
            edits=edits,
            read=read,
        )
        account = Account()
        for number, (time, file) in enumerate(listed.items()):
            progress.step("frames", number, len(listed))
            job.add(account, time, file, number)
        progress.step("frames", len(listed), len(listed))
        report = job.finish(account, pattern, tuple(listed))
        _publish(stage.GetRootLayer(), output)
        if clip_folder:
            group.place_folder(scratch / clip_folder.name, clip_folder)
    return report


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Job:
    """An import of a sequence."""

    stage: Usd.Stage
    output: OutputFile
    where: Sdf.Path
    is_model: bool
    """Whether the prim above the field is made a model."""
    clips: Clips | None
    form: Form
    frame: str | None
    meters_per_unit: float | None
    bake_axes: bool
    interpolate: bool
    edits: Sequence[Edit]
    read: Callable[[Path], Capture]

    def add(self, account: Account, time: float, file: Path, number: int) -> None:
        """Read a frame, write it, and free it."""
        capture = self.read(file)
        account.axes = account.axes or choose_axes(capture, self.frame)
        capture = edit_capture(with_axes(capture, account.axes), self.edits)
        capture = with_unit(capture, self.meters_per_unit)
        capture = unit_assumed(capture, stage_unit(self.stage))
        account.add(time, file, capture, fingerprint(capture.files))
        if not self.interpolate:
            rows = np.arange(len(capture.cloud), dtype=np.int64)
            cloud = replace(capture.cloud, ids=rows + (number << _ROW_BITS))
            capture = replace(capture, cloud=cloud)
        with self._stage_at(time) as stage:
            prim = author_field(
                stage,
                self.where,
                capture,
                placement(self.stage, capture.frame, capture.meters_per_unit),
                form=self.form,
                bake_axes=self.bake_axes,
                time=time,
            )
            if self.is_model:
                author_extents(prim, time)

    @contextmanager
    def _stage_at(self, time: float) -> Iterator[Usd.Stage]:
        """Return the stage for a frame; it is saved on exit."""
        stage = self.clips.new(time) if self.clips else self.stage
        yield stage
        save_layer(stage.GetRootLayer(), self.output)

    def finish(
        self, account: Account, pattern: Path, times: tuple[float, ...]
    ) -> SequenceImportReport:
        """Record the origin on the field and return the report."""
        if self.clips:
            self.clips.finish(self.where)
        prim = self.stage.GetPrimAtPath(self.where)
        capture = account.capture
        assert capture is not None  # there is at least one frame
        placed = placement(self.stage, capture.frame, capture.meters_per_unit)
        text = axes_text(placed, self.bake_axes)
        notes = (*account.notes.told(), *given_axes(capture))
        notes += (*schema.broken_rules(prim), *missing_proxy(prim))
        if not self.interpolate and len(times) > 1:
            notes += (_HELD,)
        memory = provenance(
            [pattern],
            account.fingerprint(),
            capture,
            edits=self.edits,
            form=self.form,
            axes=text,
            notes=notes,
        )
        record(prim, memory)
        if self.is_model:
            author_model(prim, Path(self.output.target))
        save_layer(self.stage.GetRootLayer(), self.output)
        return SequenceImportReport(
            source=str(pattern),
            target=self.output.target,
            prim_path=str(self.where),
            splats=sum(account.counts),
            degree=capture.cloud.sh_degree,
            form=self.form,
            format=memory.format,
            frame=memory.frame,
            frame_source=memory.frame_source,
            axes=memory.axes,
            meters_per_unit=stage_unit(self.stage),
            edits=memory.edits,
            error_bounds=memory.error_bounds,
            notes=memory.notes,
            frames=times,
            counts=tuple(account.counts),
        )


def _author_times(stage: Usd.Stage, times: tuple[float, ...], rate: float) -> None:
    """Author the time range and frame rate of a stage."""
    stage.SetStartTimeCode(times[0])
    stage.SetEndTimeCode(times[-1])
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)


def _publish(layer: Sdf.Layer, output: OutputFile) -> None:
    """Convert a finished crate file to the format of the target's suffix."""
    crate = Path(layer.realPath)
    match output.path.suffix.lower():
        case ".usda":
            write_copy(layer, output)
        case ".usdz":
            package_layer(crate, output)
        case _:
            crate.rename(output.path)
