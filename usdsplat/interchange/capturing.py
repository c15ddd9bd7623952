"""Convert captures and stages to a capture file, or to a sequence of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pxr import Usd

from usdsplat import formats
from usdsplat.core.edits import Edit
from usdsplat.core.findings import Finding
from usdsplat.core.progress import Progress, silent
from usdsplat.formats import Capture, ReadOptions, WriteOptions
from usdsplat.interchange import files
from usdsplat.interchange.exporting import capture_of, export_stage
from usdsplat.interchange.gathering import edit_capture, fitted, joined, turned, unit_ratio
from usdsplat.interchange.options import StageReading
from usdsplat.interchange.provenance import joined_bounds
from usdsplat.interchange.reports import ExportReport, SequenceExportReport
from usdsplat.interchange.sequence_exporting import write_frames
from usdsplat.interchange.sequence_files import files_of
from usdsplat.interchange.tree_reading import TreeChoice
from usdsplat.interchange.unapplied import unapplied
from usdsplat.schema.composition import composition_findings


@dataclass(frozen=True, slots=True, kw_only=True)
class ToCapture:
    """A conversion of captures or stages to capture files."""

    edits: tuple[Edit, ...]
    """Edits in order, in the coordinates of the first source; for a stage, of the target."""
    axes: str | None
    """Axes of the target; None is the default of its format. Sources that do not state their axes
    are assumed to have customary ones: a guess is not written to a file."""
    stages: StageReading
    """What is read of stages."""
    trees_at: Mapping[float, TreeChoice]
    """What is read of splat trees at frames of a sequence, in place of what `stages` says."""
    reading: ReadOptions
    writing: WriteOptions
    progress: Progress = silent

    def write(self, sources: Sequence[Path], target: Path) -> ExportReport:
        """Write captures and stages as one capture.

        The file states its axes if they are known or were requested.

        Raises:
            FormatError: If a source is invalid.
            StageError: If a stage cannot be opened or has no visible field.
            UsageError: If edits leave no splat, or sources have different colour spaces.
            OutputError: If the target cannot be written, or is one of the sources.
        """
        files.check_not_input(target, sources)
        frame = self.axes or formats.frame_written(target)
        read = [self._read(source, frame) for source in sources]
        capture = joined([each for each, _ in read])
        files.check_not_input(target, capture.files)
        capture = fitted(edit_capture(capture, self.edits, progress=self.progress), target)
        factor = unit_ratio(capture, target)
        cloud = turned(capture.cloud, capture.frame, frame, factor)
        notes = capture.notes
        if factor != 1:
            notes = (*notes, f"lengths are {factor:g} times as large, in the unit of the format")
        is_known = self.axes is not None or capture.states_frame
        how = replace(
            self.writing, antialiased=capture.antialiased, frame=frame if is_known else None
        )
        bounds = formats.write(cloud, target, how=how, progress=self.progress)
        return ExportReport(
            source=" + ".join(map(str, sources)),
            target=str(target),
            prim_paths=(),
            splats=len(cloud),
            degree=cloud.sh_degree,
            frame=frame,
            error_bounds=joined_bounds(capture.error_bounds, bounds),
            notes=notes,
            findings=tuple(dict.fromkeys(found for _, each in read for found in each)),
        )

    def of_stage(self, stage: Usd.Stage, target: Path, time: float) -> ExportReport:
        """Write the visible fields of a stage at a time, see `export_capture`."""
        report = export_stage(
            stage,
            target,
            replace(self.stages, time=time, trees=self.trees_at.get(time, self.stages.trees)),
            axes=self.axes,
            edits=self.edits,
            how=self.writing,
            progress=self.progress,
        )
        assert isinstance(report, ExportReport)
        return report

    def each_frame(
        self, source: Path, target: Path, frames: Sequence[float] | None
    ) -> SequenceExportReport:
        """Write a sequence of captures as another, frame by frame.

        Args:
            source: A name with a placeholder for the frame number.
            target: A name with a placeholder for the frame number.
            frames: Frames to convert; None is all, without gaps.

        Raises:
            UsdSplatError: As for `write`, and if a file is missing.
        """
        listed = files_of(source, frames)

        def write(path: Path, time: float) -> ExportReport:
            return self.write([listed[time]], path)

        return write_frames(str(source), target, tuple(listed), write, progress=self.progress)

    def _read(self, source: Path, frame: str) -> tuple[Capture, list[Finding]]:
        """Read a source; of a stage the visible fields, in the target's axes, and its findings."""
        if not files.is_usd(source):
            return formats.read(source, how=self.reading, progress=self.progress), []
        stage = files.open_stage(source)
        capture, prims = capture_of(stage, frame, self.stages, progress=self.progress)
        return capture, [*composition_findings(stage), *unapplied(prims, self.stages.time)]
