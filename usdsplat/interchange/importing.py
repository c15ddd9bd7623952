"""Import a capture as a splat field on a stage."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from pxr import Usd

from usdsplat import schema
from usdsplat.core.edits import Edit
from usdsplat.core.errors import UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.formats import Capture
from usdsplat.interchange import files
from usdsplat.interchange.authoring import (
    IN_USD_MEMORY,
    author_field,
    axes_text,
    given_axes,
    missing_proxy,
    prepare,
)
from usdsplat.interchange.cameras import import_cameras
from usdsplat.interchange.editing import map_of
from usdsplat.interchange.gathering import gather, unit_assumed
from usdsplat.interchange.models import author_model, update_extents
from usdsplat.interchange.options import IMPORT, ImportOptions
from usdsplat.interchange.placement import field_path, placement
from usdsplat.interchange.provenance import Provenance, fingerprint, provenance, record
from usdsplat.interchange.reports import ImportReport
from usdsplat.schema import Form, stage_values
from usdsplat.schema.stage_values import stage_unit


def import_capture(
    source: Path | str | Sequence[Path | str],
    target: Path | str | Usd.Stage,
    *,
    edits: Sequence[Edit] = (),
    options: ImportOptions = IMPORT,
    progress: Progress = silent,
) -> ImportReport:
    """Write a capture as a splat field, with its axes, unit, colour space and provenance.

    Args:
        source: A capture in any format that `formats` reads, or several, which are joined in the
            coordinates of the first.
        target: A .usd, .usda, .usdc or .usdz file, replaced when the new one is complete; or a
            stage, whose edit target is written without saving it.
        edits: Edits in order, in the capture's own coordinates.
        options: Axes, unit, form and path of the field; options of the reader.
        progress: Receives the progress of reading, authoring and writing.

    Raises:
        FormatError: If the source is invalid.
        UsageError: If an option has an invalid value, or edits leave no splat.
        StageError: If the stage has another prim type at `prim_path`.
        OutputError: If the target cannot be written, or is the source.
    """
    sources = [Path(source)] if isinstance(source, Path | str) else [Path(each) for each in source]
    form, unit = options.form, options.meters_per_unit
    stage, path = _open_target(sources, target, options.up_axis, unit)
    where = field_path(stage, sources[0], options.prim_path)
    how = replace(options.reading, empty=IN_USD_MEMORY.empty)
    capture = gather(
        sources, axes=options.axes, meters_per_unit=unit, edits=edits, how=how, progress=progress
    )
    capture = unit_assumed(capture, stage_unit(stage))
    placed = placement(stage, capture.frame, capture.meters_per_unit)
    text = axes_text(placed, options.bake_axes)
    notes = (*capture.notes, *given_axes(capture))
    progress.step("authoring", 0, 1)
    with ThreadPoolExecutor(max_workers=1) as beside:  # hashing releases the GIL
        sha256 = beside.submit(fingerprint, capture.files)
        prim = author_field(stage, where, capture, placed, form=form, bake_axes=options.bake_axes)
    if options.prim_path is None:
        author_model(prim, path)
    else:
        update_extents(prim)
    notes += (*schema.broken_rules(prim), *missing_proxy(prim))
    memory = provenance(
        sources, sha256.result(), capture, edits=edits, form=form, axes=text, notes=notes
    )
    record(prim, memory)
    progress.step("authoring", 1, 1)
    seen_by = None
    if options.cameras is not None:
        seen_by = import_cameras(
            options.cameras,
            prim,
            frame=capture.frame,
            meters_per_unit=capture.meters_per_unit,
            edited=map_of(edits),
            progress=progress,
        )
    if path:
        progress.step("writing", 0, 1)
        files.save(stage.GetRootLayer(), path)
        progress.step("writing", 1, 1)
    report = _report(sources, path, prim, capture, form, memory)
    if seen_by is None:
        return report
    return replace(report, cameras=seen_by.prim_paths, notes=(*report.notes, *seen_by.notes))


def _open_target(
    sources: Sequence[Path], target: Path | str | Usd.Stage, up_axis: str | None, unit: float | None
) -> tuple[Usd.Stage, Path | None]:
    """Return the stage to write, and the file to save it to if it is new."""
    if isinstance(target, Usd.Stage):
        own = stage_values.up_axis(target)
        if up_axis not in (None, own):
            raise UsageError("up_axis", repr(up_axis), f"{own}, which the stage has")
        return target, None
    path = Path(target)
    files.check_suffix(path)
    files.check_not_input(path, sources)
    stage = Usd.Stage.CreateInMemory()
    prepare(stage, up_axis, unit)
    return stage, path


def _report(
    sources: Sequence[Path],
    target: Path | None,
    prim: Usd.Prim,
    capture: Capture,
    form: Form,
    memory: Provenance,
) -> ImportReport:
    return ImportReport(
        source=" + ".join(map(str, sources)),
        target=str(target or ""),
        prim_path=str(prim.GetPath()),
        splats=len(capture.cloud),
        degree=capture.cloud.sh_degree,
        form=form,
        format=memory.format,
        frame=memory.frame,
        frame_source=memory.frame_source,
        axes=memory.axes,
        meters_per_unit=stage_unit(prim.GetStage()),
        error_bounds=memory.error_bounds,
        edits=memory.edits,
        notes=memory.notes,
    )
