"""The splat fields of a stage in another form: stock to packed and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import get_args

from pxr import Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange import files
from usdsplat.interchange.exporting import unknown_color_spaces
from usdsplat.interchange.provenance import add_form
from usdsplat.interchange.reports import RepackReport
from usdsplat.schema import Form


def repack(
    source: Path | str | Usd.Stage,
    target: Path | str,
    *,
    form: Form,
    progress: Progress = silent,
) -> RepackReport:
    """Write a stage as one file in which every splat field has `form`; time samples stay.

    The file stands alone: layers, references, clips and the selected variants are flattened into
    it. Fields that have the form already are copied as they are.

    Args:
        source: A USD file, or a stage, which is not changed.
        target: A .usd, .usda, .usdc or .usdz file, replaced when the new one is complete.
        form: "float", "half" or "packed", see `schema.author`.
        progress: Told about each cloud and about writing.

    Raises:
        UsageError: If `form` is none of these, or a number does not fit it.
        StageError: If the source cannot be opened or has no splat field.
        OutputError: If the target cannot be written, or belongs to the source.
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
    changed = [prim for prim in fields if schema.form_of(prim) != form]
    work = [(prim, time) for prim in changed for time in _times(prim)]
    splats = 0
    for done, (prim, time) in enumerate(work):
        progress.step("repacking", done, len(work))
        cloud = schema.fetch(prim, time)
        with _as_defined_as_before(after, prim.GetPath()):
            schema.author(new, prim.GetPath(), cloud, form=form, time=time)
        splats += len(cloud)
    for prim in changed:
        if not prim.IsDefined():
            _inherit_purpose(prim, new.GetPrimAtPath(prim.GetPath()))
        add_form(new.GetPrimAtPath(prim.GetPath()), form)
    progress.step("repacking", len(work), len(work))
    files.save(after, path)
    return RepackReport(
        source=_name(source),
        target=str(path),
        prim_paths=tuple(str(prim.GetPath()) for prim in changed),
        samples=len(work),
        splats=splats,
        form=form,
        notes=(*files.composition_remarks(stage), *unknown_color_spaces(fields)),
    )


@contextmanager
def _as_defined_as_before(layer: Sdf.Layer, path: Sdf.Path) -> Iterator[None]:
    """Undo that authoring defines a prim and its ancestors.

    Prototypes, which flattening keeps under an `over`, would show by themselves.
    """
    specs = [layer.GetPrimAtPath(prefix) for prefix in path.GetPrefixes()]
    specifiers = [spec.specifier for spec in specs]
    yield
    for spec, specifier in zip(specs, specifiers, strict=True):
        if spec.specifier != specifier:
            spec.specifier = specifier


def _inherit_purpose(old: Usd.Prim, new: Usd.Prim) -> None:
    """In a prototype: it is seen below prims that nobody knows there, and whose purpose counts."""
    if not UsdGeom.Imageable(old).GetPurposeAttr().HasAuthoredValue():
        new.RemoveProperty(schema.tokens.PURPOSE)


def _times(prim: Usd.Prim) -> Sequence[float | None]:
    """Samples of a field, or None alone for its default value."""
    return schema.sample_times(prim) or [None]


def _name(source: Path | str | Usd.Stage) -> str:
    """What to call a source."""
    return str(source.GetRootLayer().identifier if isinstance(source, Usd.Stage) else source)
