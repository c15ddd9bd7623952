"""Export the splat fields of a stage to capture files, joined or one for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pxr import Usd, UsdGeom

from usdsplat import formats, schema
from usdsplat.core import edit
from usdsplat.core.axes import change as change_axes
from usdsplat.core.edits import Edit
from usdsplat.core.output import output_group
from usdsplat.core.progress import Progress, silent
from usdsplat.formats import Capture, WriteOptions
from usdsplat.formats.options import WRITE_OPTIONS
from usdsplat.interchange import files
from usdsplat.interchange.appearances import Appearance, appearances
from usdsplat.interchange.gathering import edit_capture, fitted
from usdsplat.interchange.models import FIELD
from usdsplat.interchange.options import StageReading
from usdsplat.interchange.placement import stage_frame
from usdsplat.interchange.provenance import joined_bounds
from usdsplat.interchange.reports import ExportReport, SplitReport
from usdsplat.interchange.unapplied import unapplied
from usdsplat.schema.composition import composition_findings
from usdsplat.schema.stage_values import stage_unit

EVERYTHING = StageReading()


def export_capture(
    source: Path | str | Usd.Stage,
    target: Path | str,
    *,
    prim_path: str | None = None,
    time: float | None = None,
    axes: str | None = None,
    edits: Sequence[Edit] = (),
    how: WriteOptions = WRITE_OPTIONS,
    progress: Progress = silent,
) -> ExportReport:
    """Write splat fields as a capture: merged, in world space, with the capture's axes.

    Transforms are applied exactly, harmonics included. Lengths are converted to the unit of the
    format, such as metres for .glb; in formats without one they stay in the stage's. Grades and
    crops are not applied; the report has a finding for each field with one. The leaves of splat
    trees are written; see `export_stage` for coarser levels.

    Args:
        source: A USD file, or a stage, which is not modified.
        target: A file of a format that `formats` writes, replaced when the new one is complete.
        prim_path: A field, or a prim with fields below it; None is the whole stage. Invisible prims
            and those of purpose proxy or guide are left out, unless named here.
        time: Time code; None is the default value, or the first sample where there is none.
        axes: Axes of the file, such as "rdf"; None is the default of its format.
        edits: Edits in order, in the coordinates of the file.
        how: Other options of the writer.
        progress: Receives the progress of reading and writing.

    Raises:
        StageError: If the source cannot be opened, or there is no field to write.
        UsageError: If `axes` is invalid, or edits leave no splat.
        UnknownFormatError: If the target's suffix cannot be written.
        OutputError: If the target cannot be written, or is a file of the source.
    """
    report = export_stage(
        source,
        target,
        StageReading(prim_path=prim_path, time=time),
        axes=axes,
        edits=edits,
        how=how,
        progress=progress,
    )
    assert isinstance(report, ExportReport)
    return report


def export_each(
    source: Path | str | Usd.Stage,
    target: Path | str,
    *,
    prim_path: str | None = None,
    time: float | None = None,
    axes: str | None = None,
    edits: Sequence[Edit] = (),
    how: WriteOptions = WRITE_OPTIONS,
    progress: Progress = silent,
) -> SplitReport:
    """Write every splat field to a separate capture, named after `target` and the prim.

    Fields "/World/Tree" and "/Rock/splats" become shot_Tree.ply and shot_Rock.ply if the target is
    shot.ply. For prims of equal names, as much of the paths is used as makes them unique. Edits
    apply to each field separately. All files appear together when the last one is complete.

    Args and errors are those of `export_capture`.
    """
    report = export_stage(
        source,
        target,
        StageReading(prim_path=prim_path, time=time),
        split=True,
        axes=axes,
        edits=edits,
        how=how,
        progress=progress,
    )
    assert isinstance(report, SplitReport)
    return report


def export_stage(
    source: Path | str | Usd.Stage,
    target: Path | str,
    reading: StageReading = EVERYTHING,
    *,
    split: bool = False,
    axes: str | None = None,
    edits: Sequence[Edit] = (),
    how: WriteOptions = WRITE_OPTIONS,
    progress: Progress = silent,
) -> ExportReport | SplitReport:
    """Write the fields of a stage, and its splat trees at a chosen level, as captures.

    Args:
        source: As for `export_capture`.
        target: As for `export_capture`.
        reading: What is read of the stage.
        split: Whether to write a capture for each field, as `export_each` does.
        axes, edits, how, progress: As for `export_capture`.

    Raises:
        UsdSplatError: As for `export_capture`.
    """
    path, stage = Path(target), _opened(source, target)
    frame = axes or formats.frame_written(path)
    unit = formats.unit_written(path)
    time = reading.time
    if not split:
        capture, prims = capture_of(stage, frame, reading, meters_per_unit=unit, progress=progress)
        files.check_not_input(path, capture.files)
        capture = edit_capture(capture, edits, progress=progress)
        report = _written(capture, prims, source, path, how, progress)
        remarks = (*composition_findings(stage), *unapplied(prims, time))
        return replace(report, findings=remarks)
    found, notes = appearances(stage, reading)
    parts = []
    with output_group():
        for item, name in zip(found, names([item.prim for item in found]), strict=True):
            beside = _named(path, name)
            capture = _capture([item], frame, unit, time, progress)
            files.check_not_input(beside, capture.files)
            capture = edit_capture(capture, edits, progress=progress)
            parts.append(_written(capture, [item.prim], source, beside, how, progress))
    return SplitReport(
        source=_name(source),
        target=str(path),
        parts=tuple(parts),
        notes=tuple(notes),
        findings=(
            *composition_findings(stage),
            *unapplied([item.prim for item in found], time),
        ),
    )


def capture_of(
    stage: Usd.Stage,
    frame: str,
    reading: StageReading = EVERYTHING,
    *,
    meters_per_unit: float | None = None,
    progress: Progress = silent,
) -> tuple[Capture, list[Usd.Prim]]:
    """Read the visible fields of a stage as a capture with axes `frame`, and their prims.

    Args and errors are those of `export_stage`; `meters_per_unit` is the unit of the capture, None
    for the stage's.
    """
    found, notes = appearances(stage, reading)
    capture = _capture(found, frame, meters_per_unit, reading.time, progress)
    notes = [*notes, *capture.notes]
    return replace(capture, notes=tuple(notes)), [item.prim for item in found]


def names(prims: Sequence[Usd.Prim]) -> list[str]:
    """Return names for files of these prims: the shortest unique ends of the paths of the fields,
    or of the models that they were imported with."""
    paths = [str(prim.GetPath()).strip("/").split("/") for prim in prims]
    paths = [path[:-1] if path[-1] == FIELD and len(path) > 1 else path for path in paths]
    for length in range(1, max(map(len, paths), default=0) + 1):
        ends = ["_".join(path[-length:]) for path in paths]
        if len({end.lower() for end in ends}) == len(ends):
            return ends
    return [f"{'_'.join(path)}_{number}" for number, path in enumerate(paths, 1)]


def unknown_color_spaces(prims: Sequence[Usd.Prim]) -> list[str]:
    """Return a note for each field with an unknown colour space."""
    return [
        f"{prim.GetPath()}: found colour space {schema.color_space(prim)!r}, expected one that USD "
        "knows; the field is not drawn"
        for prim in prims
        if not schema.is_known_color_space(schema.color_space(prim))
    ]


def _opened(source: Path | str | Usd.Stage, target: Path | str) -> Usd.Stage:
    """Open the stage, after checking that the target is not one of its files."""
    stage = source if isinstance(source, Usd.Stage) else files.open_stage(Path(source))
    files.check_not_input(Path(target), files.layer_files(stage))
    return stage


def _capture(
    found: Sequence[Appearance],
    frame: str,
    unit: float | None,
    time: float | None,
    progress: Progress,
) -> Capture:
    """Join appearances in one capture, with notes on what captures cannot hold."""
    prims = [item.prim for item in found]
    stage = prims[0].GetStage()
    own = stage_unit(stage)
    unit = unit or own
    turn = own / unit * change_axes(stage_frame(stage), frame)
    clouds = []
    for done, item in enumerate(found):
        progress.step("reading fields", done, len(found))
        clouds.append(item.cloud(time, turn))
    progress.step("reading fields", len(found), len(found))
    cloud = clouds[0] if len(clouds) == 1 else edit.merge(clouds)
    spaces = sorted({schema.color_space(prim) for prim in prims})
    modes = {item.rasterize_mode for item in found}
    chunks = {Path(path) for item in found for path in item.chunk_files}
    notes = unknown_color_spaces(prims)
    if unit != own:
        said = "" if UsdGeom.StageHasAuthoredMetersPerUnit(stage) else ", USD's default,"
        notes.append(
            f"lengths are converted from the stage's unit of {own:g} m{said} to {unit:g} m"
        )
    if spaces != [schema.tokens.DEFAULT_COLOR_SPACE]:
        listed = " and ".join(spaces)
        notes.append(f"colours are in {listed}, which the file cannot state")
    if len(modes) > 1:
        notes.append(
            "fields have different rasterize modes; the file states classic for all splats"
        )
    for name in ("ids", "velocities"):
        if getattr(cloud, name) is not None:
            notes.append(f"{name} are not written")
    return Capture(
        cloud=cloud,
        format="USD",
        files=(*(files.layer_files(stage) or (Path(stage.GetRootLayer().identifier),)), *chunks),
        frame=frame,
        meters_per_unit=unit,
        antialiased=modes == {"antialiased"},
        color_space=spaces[0],
        notes=tuple(notes),
    )


def _written(
    capture: Capture,
    prims: Sequence[Usd.Prim],
    source: Path | str | Usd.Stage,
    target: Path,
    how: WriteOptions,
    progress: Progress,
) -> ExportReport:
    """Write a capture of a stage and return the report."""
    capture = fitted(capture, target)
    how = replace(how, antialiased=capture.antialiased, frame=capture.frame)
    bounds = formats.write(capture.cloud, target, how=how, progress=progress)
    return export_report(capture, prims, _name(source), target, bounds)


def export_report(
    capture: Capture,
    prims: Sequence[Usd.Prim],
    source: str,
    target: Path,
    bounds: Mapping[str, str],
) -> ExportReport:
    """Return the report of a capture of a stage.

    Args:
        capture: What was written.
        prims: The fields, see `capture_of`.
        source: Name of the stage.
        target: Name of the file.
        bounds: Error bounds of its format.
    """
    return ExportReport(
        source=source,
        target=str(target),
        prim_paths=tuple(str(prim.GetPath()) for prim in prims),
        splats=len(capture.cloud),
        degree=capture.cloud.sh_degree,
        frame=capture.frame,
        error_bounds=joined_bounds(capture.error_bounds, bounds),
        notes=capture.notes,
    )


def _named(target: Path, name: str) -> Path:
    """Return the target with a name before its suffix, or in the folder of an unpacked SOG."""
    fitting = [s for s in formats.suffixes_written() if f"/{target.name.lower()}".endswith(s)]
    suffix = max(fitting, key=len, default=target.suffix)
    if suffix.startswith("/"):
        return target.parent.with_name(f"{target.parent.name}_{name}") / target.name
    stem, end = target.name[: -len(suffix)], target.name[-len(suffix) :]
    return target.with_name(f"{stem}_{name}{end}")


def _name(source: Path | str | Usd.Stage) -> str:
    """Return the name of a source."""
    return str(source.GetRootLayer().identifier if isinstance(source, Usd.Stage) else source)
