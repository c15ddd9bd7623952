"""Convert the splat fields of a copy of a stage's root layer, and keep all that it composes.

The copy holds the converted fields: as plain opinions, or in a variant for each variant that
changes their data. References, payloads, sublayers and asset information stay as they are.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence, Set
from pathlib import Path

from pxr import Sdf, Usd

from usdsplat import schema
from usdsplat.core.findings import Finding, finding
from usdsplat.core.readable import original
from usdsplat.interchange.asset_paths import expressions, make_absolute, make_relative, restore
from usdsplat.interchange.field_variants import (
    FieldVariants,
    Selection,
    field_variants,
    select,
)
from usdsplat.interchange.field_writing import (
    FieldWriter,
    no_field,
    remove_data,
    restored_specifiers,
)
from usdsplat.schema.lod_roots import find_roots

_EVALUATED = "asset paths with variables were evaluated, because the file is in another folder"


def converted_root(
    stage: Usd.Stage, target: Path, writer: FieldWriter
) -> tuple[Sdf.Layer, list[Finding]]:
    """Return a copy of a stage's root layer in which fields are converted, and findings.

    Opinions of the session layer are not part of the copy.

    Args:
        stage: The stage, which is not modified.
        target: File that the layer will be written to.
        writer: Converts the fields.

    Raises:
        StageError: If the stage has no splat field, a field has too many variants, or the stage
            refers to a file whose path is not UTF-8.
    """
    root = stage.GetRootLayer()
    after = Sdf.Layer.CreateAnonymous(".usda")
    after.TransferContent(root)
    kept = expressions(after)
    if kept and not _is_beside(root, target):
        kept.clear()
        writer.notes[_EVALUATED] = None
    absolute = make_absolute(after, root)
    old, new = _opened(stage, root), _opened(stage, after)
    fields = field_variants(old)
    if not fields and not any(_in_instances(old)):
        raise no_field(old, root.identifier)
    known = {each.path for each in fields}
    specs = _specs(after, known)
    own = [each for each in fields if not _is_covered(old, each, known)]
    clouds = {each: _clouds(each, old, writer) for each in own}
    written = [each for each in own if not each.is_unselected]
    writer.expect(sum(clouds[each] for each in written))
    for each in written:
        if clouds[each]:
            _write(each, old, new, writer, specs[each.path])
        else:
            _settle(new.GetPrimAtPath(each.path))
    findings = list(fields_in_instances(stage, writer))
    for each in own:
        if each.is_unselected and clouds[each]:
            found = "data that depends on a variant set of which no variant is selected"
            findings.append(finding("not-converted", str(each.path), found, "a selection"))
        elif not each.is_unselected:
            findings += _missed(each, new, writer)
    shown = [old.GetPrimAtPath(each.path) for each in fields]
    writer.note_color_spaces([prim for prim in shown if prim and schema.is_splat_field(prim)])
    make_relative(after, absolute, source=root.realPath, target=target)
    restore(after, kept)
    return after, findings


def fields_in_instances(stage: Usd.Stage, writer: FieldWriter) -> Iterator[Finding]:
    """Yield a finding for each field that a writer changes and that is in instances, where it
    cannot be changed, unless its data is that of another field of the root layer."""
    fields = {prim.GetPath() for prim in stage.TraverseAll() if schema.is_splat_field(prim)}
    for prim in _in_instances(stage):
        if writer.changes(prim) and not _comes_from(prim, stage.GetRootLayer(), fields):
            found = "a field in an instance, which cannot be changed there"
            yield finding("not-converted", str(prim.GetPath()), found, "one outside instances")


def _opened(stage: Usd.Stage, root: Sdf.Layer) -> Usd.Stage:
    """Return a stage of another root layer with the resolver context and muted layers of a stage.

    All payloads are loaded, so that fields in those that the stage does not load are converted too.
    """
    session = Sdf.Layer.CreateAnonymous(".usda")
    found = Usd.Stage.Open(root, session, stage.GetPathResolverContext())
    found.MuteAndUnmuteLayers(stage.GetMutedLayers(), [])
    return found


def _is_beside(root: Sdf.Layer, target: Path) -> bool:
    """Return whether relative paths mean the same in a root layer and in a target file."""
    if root.anonymous:
        return True
    folder = os.path.realpath(os.path.dirname(original(root.realPath)))
    return folder == os.path.realpath(target.parent) and target.suffix.lower() != ".usdz"


def _clouds(field: FieldVariants, stage: Usd.Stage, writer: FieldWriter) -> int:
    """Return how many clouds a field has in all its variants; 0 if a writer changes none."""
    count, changes = 0, False
    for selection in field.selections:
        select(stage, selection)
        prim = stage.GetPrimAtPath(field.path)
        count += len(writer.times(prim))
        changes |= writer.changes(prim)
    return count if changes else 0


def _settle(field: Usd.Prim) -> None:
    """Settle the proxy of a field that is packed already."""
    if field and schema.is_packed(field):
        schema.settle_proxy(field)


def _write(
    field: FieldVariants,
    old: Usd.Stage,
    new: Usd.Stage,
    writer: FieldWriter,
    specs: Sequence[Sdf.Path],
) -> None:
    """Write a field in all its variants, in place of the data in its specs."""
    layer = new.GetRootLayer()
    bounds = {schema.tokens.EXTENT} if field.relevant else set()
    remove_data(layer, specs, schema.DATA_ATTRIBUTES | bounds)
    local = layer.GetPrimAtPath(field.path)
    if local and local.typeName:  # stronger than the types that variants get
        tokens = schema.tokens
        local.typeName = tokens.PACKED_TYPE if writer.form == "packed" else tokens.STOCK_TYPE
    for selection in field.selections:
        select(old, selection)
        prim = old.GetPrimAtPath(field.path)
        place = _declare(new, field, selection)
        select(new, selection)
        target = new.GetEditTargetForLocalLayer(layer)
        if not place.IsAbsoluteRootPath():
            target = Usd.EditTarget.ForLocalDirectVariant(layer, place)
        path = target.MapToSpecPath(field.path)
        with Usd.EditContext(new, target):
            times = list(writer.times(prim))
            if times != [None] and _has_default(new.GetPrimAtPath(field.path)):
                times.insert(0, None)  # it would hide that of a weaker layer
            with restored_specifiers(layer, path):
                writer.write(prim, new, times)
            found = new.GetPrimAtPath(field.path)
            _settle(found)
            writer.finish(prim, found)


def _declare(stage: Usd.Stage, field: FieldVariants, selection: Selection) -> Sdf.Path:
    """Declare the variants of a combination in the root layer; return their path."""
    place = field.spec_path(selection)
    layer = stage.GetRootLayer()
    for prefix in place.GetPrefixes():
        if prefix.IsPrimVariantSelectionPath():
            name, variant = prefix.GetVariantSelection()
            owner = layer.GetPrimAtPath(prefix.GetParentPath())
            if owner is None:
                owner = Sdf.CreatePrimInLayer(layer, prefix.GetParentPath())
            if name not in owner.variantSets:
                Sdf.VariantSetSpec(owner, name)
                owner.variantSetNameList.prependedItems = [
                    name,
                    *(each for each in owner.variantSetNameList.prependedItems if each != name),
                ]
            if variant not in owner.variantSets[name].variants:
                Sdf.VariantSpec(owner.variantSets[name], variant)
    return place


def _specs(layer: Sdf.Layer, fields: Set[Sdf.Path]) -> dict[Sdf.Path, list[Sdf.Path]]:
    """Return the specs of fields in all variants of a layer, by field."""
    found: dict[Sdf.Path, list[Sdf.Path]] = {each: [] for each in fields}

    def visit(path: Sdf.Path) -> None:
        if not path.IsPropertyPath():
            specs = found.get(path.StripAllVariantSelections())
            if specs is not None:
                specs.append(path)

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return found


def _has_default(prim: Usd.Prim) -> bool:
    """Return whether a field of a weaker layer has default values."""
    found = (prim.GetAttribute(name) for name in schema.DATA_ATTRIBUTES - {schema.tokens.SH_DEGREE})
    return any(
        each and each.HasAuthoredValue() and each.Get(Usd.TimeCode.Default()) is not None
        for each in found
    )


def _is_covered(stage: Usd.Stage, field: FieldVariants, known: Set[Sdf.Path]) -> bool:
    """Return whether the data of a field is that of another one in the root layer, of which it is
    an internal reference or a class."""
    select(stage, field.selections[-1])
    prim = stage.GetPrimAtPath(field.path)
    return _comes_from(prim, stage.GetRootLayer(), known)


def _comes_from(prim: Usd.Prim, root: Sdf.Layer, fields: Set[Sdf.Path]) -> bool:
    """Return whether the strongest data of a field is that of one of other fields in a layer."""
    for name in (schema.tokens.POSITIONS, schema.tokens.POSITIONS_HALF):
        attribute = prim.GetAttribute(name)
        for spec in attribute.GetPropertyStack() if attribute else ():
            path = spec.path.GetPrimPath()
            return spec.layer == root and path != prim.GetPath() and path in fields
    return False


def _in_instances(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Yield a prim for each field in a prototype: that of the first instance."""
    seen, roots = set(), find_roots(stage)
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        if not prim.IsInstanceProxy() or roots.is_replaced(prim):
            continue
        if schema.is_splat_field(prim):
            source = prim.GetPrimInPrototype().GetPath()
            if source not in seen:
                seen.add(source)
                yield prim


def _missed(field: FieldVariants, stage: Usd.Stage, writer: FieldWriter) -> Iterator[Finding]:
    """Yield a finding if stronger opinions than ours determine a field's form."""
    for selection in field.selections:
        select(stage, selection)
        prim = stage.GetPrimAtPath(field.path)
        if schema.is_splat_field(prim) and schema.form_of(prim) != writer.form:
            found = f"data of the form {schema.form_of(prim)} in a class or another layer"
            yield finding("not-converted", str(field.path), found, "data in variants or references")
            return
