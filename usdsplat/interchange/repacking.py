"""Convert the splat fields of a stage to another storage form."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.edits import Edit
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange import files
from usdsplat.interchange.authoring import missing_proxy
from usdsplat.interchange.editing import edited
from usdsplat.interchange.exporting import unknown_color_spaces
from usdsplat.interchange.models import update_extents
from usdsplat.interchange.provenance import add_edits, add_form
from usdsplat.interchange.reports import RepackReport
from usdsplat.schema import Form
from usdsplat.schema.composition import composition_findings


def repack(
    source: Path | str | Usd.Stage,
    target: Path | str,
    *,
    form: Form,
    edits: Sequence[Edit] = (),
    progress: Progress = silent,
) -> RepackReport:
    """Write a stage to one file with all splat fields in `form`; time samples are kept.

    The file is self-contained: layers, references, clips and the selected variants are flattened
    into it. Fields that already have the form are copied unchanged, unless they are edited.

    Args:
        source: A USD file, or a stage, which is not modified.
        target: A .usd, .usda, .usdc or .usdz file, replaced when the new one is complete.
        form: "float", "half" or "packed", see `schema.author`.
        edits: Edits in order, of every field and sample, in the field's own coordinates.
        progress: Receives the progress of clouds and of writing.

    Raises:
        UsageError: If `form` is unknown, a number exceeds its range, edits leave no splat of a
            field, or an edit needs a static field.
        StageError: If the source cannot be opened or has no splat field.
        OutputError: If the target cannot be written, or is a file of the source.
    """
    path = Path(target)
    files.check_suffix(path)
    if form not in get_args(Form):
        raise UsageError("form", repr(form), f"one of {', '.join(get_args(Form))}")
    stage = source if isinstance(source, Usd.Stage) else files.open_stage(Path(source))
    files.check_not_input(path, files.layer_files(stage))
    before = stage.Flatten(addSourceFileComment=False)
    after = Sdf.Layer.CreateAnonymous(".usda")
    after.TransferContent(before)
    old, new = Usd.Stage.Open(before), Usd.Stage.Open(after)
    fields = [prim for prim in old.TraverseAll() if schema.is_splat_field(prim)]
    if not fields:
        raise StageError(_name(source), "no splat field", "at least one")
    changed = [prim for prim in fields if edits or schema.form_of(prim) != form]
    notes = []
    work = [(prim, time) for prim in changed for time in _times(prim)]
    splats = 0
    for prim in changed:
        if edits and schema.sample_times(prim):
            _forget(after, prim.GetPath())
    for done, (prim, time) in enumerate(work):
        progress.step("repacking", done, len(work))
        cloud, said = _edited(prim, time, edits)
        notes += said
        with _as_defined_as_before(after, prim.GetPath()):
            schema.author(new, prim.GetPath(), cloud, form=form, time=time)
        splats += len(cloud)
    for prim in fields:
        if schema.is_packed(new.GetPrimAtPath(prim.GetPath())):
            schema.settle_proxy(new.GetPrimAtPath(prim.GetPath()))
    for prim in changed:
        written = new.GetPrimAtPath(prim.GetPath())
        if not prim.IsDefined():
            _inherit_purpose(prim, written)
        if edits:
            add_edits(written, edits)
        if schema.form_of(prim) != form:
            add_form(written, form)
        notes += [f"{prim.GetPath()}: {rule}" for rule in schema.broken_rules(written)]
        notes += missing_proxy(written)
        update_extents(written)
    progress.step("repacking", len(work), len(work))
    files.save(after, path)
    return RepackReport(
        source=_name(source),
        target=str(path),
        prim_paths=tuple(str(prim.GetPath()) for prim in changed),
        samples=len(work),
        splats=splats,
        form=form,
        notes=(*unknown_color_spaces(fields), *notes),
        findings=tuple(composition_findings(stage)),
    )


def _edited(
    prim: Usd.Prim, time: float | None, edits: Sequence[Edit]
) -> tuple[SplatCloud, list[str]]:
    """Return a field's edited cloud at one of its times, and notes."""
    cloud = schema.fetch(prim, time)
    if not edits:
        return cloud, []
    where, moves = str(prim.GetPath()), schema.is_time_varying(prim)
    for item in edits:
        if moves and not item.kind.row_by_row:
            raise UsageError(f"edit {item.name}", f"{where}, which moves", "a static field")
    if moves and cloud.ids is None and not all(item.kind.keeps_rows for item in edits):
        # Without ids, a splat would be interpolated to another one in its row at the next sample.
        cloud = replace(cloud, ids=np.arange(len(cloud)))
    after, notes = edited(cloud, edits, may_empty=moves)
    place = where if time is None else f"{where} at {time:g}"
    return after, [f"{place}: {note}" for note in notes]


def _forget(layer: Sdf.Layer, path: Sdf.Path) -> None:
    """Remove all values of a field whose samples are edited and rewritten."""
    for name in schema.DATA_ATTRIBUTES:
        spec = layer.GetAttributeAtPath(path.AppendProperty(name))
        if spec:
            spec.ClearInfo("timeSamples")
            spec.ClearInfo("default")


@contextmanager
def _as_defined_as_before(layer: Sdf.Layer, path: Sdf.Path) -> Iterator[None]:
    """Restore the specifiers of a prim and its ancestors after authoring.

    Prototypes, which flattening keeps under an `over`, would otherwise be drawn.
    """
    specs = [layer.GetPrimAtPath(prefix) for prefix in path.GetPrefixes()]
    specifiers = [spec.specifier for spec in specs]
    yield
    for spec, specifier in zip(specs, specifiers, strict=True):
        if spec.specifier != specifier:
            spec.specifier = specifier


def _inherit_purpose(old: Usd.Prim, new: Usd.Prim) -> None:
    """Remove the purpose authored in a prototype, so that it inherits that of the instances."""
    if not UsdGeom.Imageable(old).GetPurposeAttr().HasAuthoredValue():
        new.RemoveProperty(schema.tokens.PURPOSE)


def _times(prim: Usd.Prim) -> Sequence[float | None]:
    """Return the sample times of a field, or [None] for its default value."""
    return schema.sample_times(prim) or [None]


def _name(source: Path | str | Usd.Stage) -> str:
    """Return the name of a source."""
    return str(source.GetRootLayer().identifier if isinstance(source, Usd.Stage) else source)
