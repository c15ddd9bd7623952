"""Convert the splat fields of a flattened copy of a stage."""

from __future__ import annotations

from pxr import Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.readable import original
from usdsplat.interchange.asset_paths import replace_links
from usdsplat.interchange.field_writing import (
    FieldWriter,
    no_field,
    remove_data,
    restored_specifiers,
)
from usdsplat.schema.lod_roots import find_roots


def flattened(stage: Usd.Stage, where: str, writer: FieldWriter) -> Sdf.Layer:
    """Return a layer of its own with the content of a stage and converted fields.

    Layers, references, clips and the selected variants become one layer. Fields that already have
    the form are copied unchanged, unless they are edited.

    Args:
        stage: The stage, which is not modified.
        where: Name of the stage, for messages.
        writer: Converts the fields.

    Raises:
        StageError: If the stage has no splat field.
    """
    before = stage.Flatten(addSourceFileComment=False)
    if any(original(layer.realPath) != layer.realPath for layer in stage.GetUsedLayers()):
        replace_links(before)
    after = Sdf.Layer.CreateAnonymous(".usda")
    after.TransferContent(before)
    old, new = Usd.Stage.Open(before), Usd.Stage.Open(after)
    roots = find_roots(old)
    everything = (prim for prim in old.TraverseAll() if not roots.is_replaced(prim))
    fields = list(filter(schema.is_splat_field, everything))
    if not fields:
        raise no_field(old, where)
    changed = [prim for prim in fields if writer.changes(prim)]
    writer.expect(sum(len(writer.times(prim)) for prim in changed))
    for prim in changed:
        if writer.edits and schema.sample_times(prim):
            remove_data(after, [prim.GetPath()])
        with restored_specifiers(after, prim.GetPath()):
            writer.write(prim, new, writer.times(prim))
    for prim in fields:
        if schema.is_packed(new.GetPrimAtPath(prim.GetPath())):
            schema.settle_proxy(new.GetPrimAtPath(prim.GetPath()))
    for prim in changed:
        written = new.GetPrimAtPath(prim.GetPath())
        if not prim.IsDefined():
            _inherit_purpose(prim, written)
        writer.finish(prim, written)
    writer.note_color_spaces(fields)
    return after


def _inherit_purpose(old: Usd.Prim, new: Usd.Prim) -> None:
    """Remove the purpose authored in a prototype, so that it inherits that of the instances."""
    if not UsdGeom.Imageable(old).GetPurposeAttr().HasAuthoredValue():
        new.RemoveProperty(schema.tokens.PURPOSE)
