"""A capture file becomes a splat field on a stage."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from pxr import Usd, UsdGeom

from usdsplat import formats
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.formats import Capture
from usdsplat.interchange import files
from usdsplat.interchange.authoring import assumptions, author_field, axes_text, prepare
from usdsplat.interchange.placement import field_path, placement
from usdsplat.interchange.provenance import Provenance, fingerprint, provenance, record
from usdsplat.interchange.reports import ImportReport
from usdsplat.schema import Form


def import_capture(
    source: Path | str,
    target: Path | str | Usd.Stage,
    *,
    form: Form = "float",
    frame: str | None = None,
    up_axis: str | None = None,
    meters_per_unit: float | None = None,
    prim_path: str | None = None,
    bake_axes: bool = False,
    progress: Progress = silent,
) -> ImportReport:
    """Write a capture as a splat field, with its axes, unit, colour space and provenance.

    Args:
        source: A capture in any format that `formats` reads.
        target: A .usd, .usda, .usdc or .usdz file, replaced when the new one is complete; or a
            stage, whose edit target is written and nothing is saved.
        form: How the field is stored, see `schema.author`.
        frame: Where x, y and z of the capture point, such as "rdf"; None believes the file.
        up_axis: "Y" or "Z" of a new file, "Y" if None; a stage has its own.
        meters_per_unit: Metres in a unit of the capture, and of a new file; None is 1 for a new
            file and the stage's own for a stage.
        prim_path: Path of the field; None is the file's name under the default prim.
        bake_axes: Turn the splats instead of authoring a transform op on the prim.
        progress: Told about reading, authoring and writing.

    Raises:
        FormatError: If the source is not what it claims to be.
        UsageError: If an option has a value it cannot have.
        StageError: If the stage has something else at `prim_path`.
        OutputError: If the target cannot be written, or is the source.
    """
    source = Path(source)
    stage, path = _open_target(source, target, up_axis, meters_per_unit)
    where = field_path(stage, source, prim_path)
    capture = formats.read(source, progress=progress)
    capture = replace(capture, frame=frame or capture.frame)
    placed = placement(stage, capture.frame, meters_per_unit)
    text = axes_text(placed, bake_axes)
    notes = (*capture.notes, *assumptions(frame, meters_per_unit))
    progress.step("authoring", 0, 1)
    with ThreadPoolExecutor(max_workers=1) as beside:  # hashing leaves the interpreter free
        sha256 = beside.submit(fingerprint, capture.files)
        prim = author_field(stage, where, capture, placed, form=form, bake_axes=bake_axes)
    memory = provenance(source, sha256.result(), capture, form=form, axes=text, notes=notes)
    record(prim, memory)
    progress.step("authoring", 1, 1)
    if path:
        progress.step("writing", 0, 1)
        files.save(stage.GetRootLayer(), path)
        progress.step("writing", 1, 1)
    return _report(source, path, prim, capture, form, memory)


def _open_target(
    source: Path, target: Path | str | Usd.Stage, up_axis: str | None, unit: float | None
) -> tuple[Usd.Stage, Path | None]:
    """The stage to write, and the file to save it in if it is a new one."""
    if isinstance(target, Usd.Stage):
        own = UsdGeom.GetStageUpAxis(target)
        if up_axis not in (None, own):
            raise UsageError("up_axis", repr(up_axis), f"{own}, which the stage has")
        return target, None
    path = Path(target)
    files.check_suffix(path)
    files.check_not_input(path, [source])
    stage = Usd.Stage.CreateInMemory()
    prepare(stage, up_axis, unit)
    return stage, path


def _report(
    source: Path,
    target: Path | None,
    prim: Usd.Prim,
    capture: Capture,
    form: Form,
    memory: Provenance,
) -> ImportReport:
    return ImportReport(
        source=str(source),
        target=str(target or ""),
        prim_path=str(prim.GetPath()),
        splats=len(capture.cloud),
        degree=capture.cloud.sh_degree,
        form=form,
        format=memory.format,
        frame=memory.frame,
        axes=memory.axes,
        meters_per_unit=UsdGeom.GetStageMetersPerUnit(prim.GetStage()),
        error_bounds=memory.error_bounds,
        notes=memory.notes,
    )
