"""What one prim says, in rows: properties at a time, metadata, and where it all comes from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pxr import Pcp, Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.preview.knob_model import Editor
from usdsplat.preview.stage_model.attribute_values import editor_of, text_of
from usdsplat.preview.stage_model.placing import code_of
from usdsplat.schema.values import value as value_of

PropertyKind = Literal["computed", "attribute", "connection", "relationship"]
Source = Literal["none", "fallback", "default", "time samples", "value clips", "computed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PropertyRow:
    """One property, or something that is computed of a prim."""

    name: str
    kind: PropertyKind
    type_name: str
    """Such as "point3f[]"; "" for what has none."""
    text: str
    """The value at the time; of an array its count and its first elements."""
    source: Source
    samples: int = 0
    """Time samples that are authored."""
    layer: str = ""
    """Name of the layer with the strongest opinion; "" where there is none."""
    is_custom: bool = False
    is_edited: bool = False
    """Whether the session layer has an opinion of it."""
    editor: Editor | None = None
    """How it may be changed; None for what `Edits.set_value` is not for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MetadataRow:
    """One field of a prim itself."""

    name: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ArcRow:
    """One opinion about a prim, the strongest first."""

    kind: str
    """How it comes in: "root", "reference", "payload", "variant", "inherit", ..."""
    path: str
    """Of the prim spec in its layer."""
    layer: str
    """Name of the layer."""
    identifier: str
    """The whole name of the layer, a file where it has one."""
    has_specs: bool
    """Whether the layer says anything there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerRow:
    """One layer of the stage's stack, the strongest first."""

    name: str
    identifier: str
    depth: int
    """Below how many layers it is stacked."""
    is_muted: bool
    is_dirty: bool
    is_session: bool


_SOURCES: dict[Any, Source] = {
    Usd.ResolveInfoSourceNone: "none",
    Usd.ResolveInfoSourceFallback: "fallback",
    Usd.ResolveInfoSourceDefault: "default",
    Usd.ResolveInfoSourceTimeSamples: "time samples",
    Usd.ResolveInfoSourceValueClips: "value clips",
}
_PROPERTY_FIELDS = ("primChildren", "properties", "propertyChildren")
"""Fields of a prim that are not about itself."""


def properties(
    stage: Usd.Stage, path: str, *, time: float | None = None
) -> tuple[PropertyRow, ...]:
    """Everything that a prim says at a time: what is computed first, then properties by name.

    Args:
        stage: Whose.
        path: Of the prim; of an inactive one there is only metadata.
        time: Time code; None is USD's default time.

    Raises:
        StageError: If there is no such prim.
    """
    prim = _prim(stage, path)
    code = code_of(time)
    rows = [*_computed(prim, code)]
    for each in prim.GetProperties():
        if isinstance(each, Usd.Attribute):
            rows.extend(_attribute(each, code))
        else:
            rows.append(_relationship(each))
    return tuple(rows)


def metadata(stage: Usd.Stage, path: str) -> tuple[MetadataRow, ...]:
    """The fields of a prim, by name.

    Raises:
        StageError: If there is no such prim.
    """
    found = _prim(stage, path).GetAllAuthoredMetadata()
    return tuple(
        MetadataRow(name=name, text=text_of(found[name]))
        for name in sorted(found)
        if name not in _PROPERTY_FIELDS
    )


def composition(stage: Usd.Stage, path: str) -> tuple[ArcRow, ...]:
    """Where a prim's opinions come from, the strongest first.

    Raises:
        StageError: If there is no such prim.
    """
    rows = []
    for node in _nodes(_prim(stage, path).GetPrimIndex().rootNode):
        kind = node.arcType.displayName
        for layer in node.layerStack.layers:
            spec = layer.GetPrimAtPath(node.path)
            if spec is not None or layer == node.layerStack.identifier.rootLayer:
                rows.append(
                    ArcRow(
                        kind=kind,
                        path=str(node.path),
                        layer=_name(layer),
                        identifier=layer.realPath or layer.identifier,
                        has_specs=spec is not None,
                    )
                )
    return tuple(rows)


def layer_stack(stage: Usd.Stage) -> tuple[LayerRow, ...]:
    """The stage's own layers, the strongest first; muted ones too."""
    muted = set(stage.GetMutedLayers())
    session = stage.GetSessionLayer()
    rows: list[LayerRow] = []

    def add(layer: Sdf.Layer, depth: int, above: tuple[str, ...], is_session: bool) -> None:
        if layer.identifier in above:  # a layer that is below itself
            return
        rows.append(
            LayerRow(
                name=_name(layer),
                identifier=layer.realPath or layer.identifier,
                depth=depth,
                is_muted=layer.identifier in muted,
                is_dirty=layer.dirty,
                is_session=is_session,
            )
        )
        for path in layer.subLayerPaths:
            below = Sdf.Layer.FindRelativeToLayer(layer, path)
            if below:
                add(below, depth + 1, (*above, layer.identifier), is_session)

    if session:
        add(session, 0, (), True)
    add(stage.GetRootLayer(), 0, (), False)
    return tuple(rows)


def _computed(prim: Usd.Prim, code: Usd.TimeCode) -> Iterator[PropertyRow]:
    """What usdview computes of a prim, and what splats are."""
    if not prim.IsActive() or prim.IsPseudoRoot():
        return
    if schema.is_splat_field(prim):
        for name, text in _splats(prim, code):
            yield _row(name, text)
    imageable = UsdGeom.Imageable(prim)
    if not imageable:
        return
    if prim.IsA(UsdGeom.Xformable):
        yield _row("Local to world", text_of(imageable.ComputeLocalToWorldTransform(code)))
    purposes = UsdGeom.Imageable.GetOrderedPurposeTokens()
    cache = UsdGeom.BBoxCache(code, purposes, useExtentsHint=True)
    box = cache.ComputeWorldBound(prim).ComputeAlignedRange()
    found = "empty" if box.IsEmpty() else f"{text_of(box.GetMin())} to {text_of(box.GetMax())}"
    yield _row("World bounding box", found)
    yield _row("Visibility, inherited", str(imageable.ComputeVisibility(code)))
    yield _row("Purpose, inherited", str(imageable.ComputePurpose()))


def _splats(prim: Usd.Prim, code: Usd.TimeCode) -> Iterator[tuple[str, str]]:
    """How many, of which degree and in which form; nothing that needs their numbers."""
    is_packed = schema.is_packed(prim)
    names = ("positions",) if is_packed else ("positions", "positionsh")
    arrays = (value_of(prim.GetAttribute(name), code) for name in names)
    count = next((len(found) for found in arrays if hasattr(found, "__len__")), 0)
    yield "Splats", f"{count:,}"
    degree = value_of(prim.GetAttribute(schema.tokens.SH_DEGREE), code)
    yield "SH degree", str(schema.tokens.SCHEMA_FALLBACK_DEGREE if degree is None else degree)
    packing = value_of(prim.GetAttribute(schema.tokens.PACKING), code)
    try:
        yield "Form", f"packed, {packing}" if is_packed else schema.form_of(prim)
        yield "Colour space", schema.color_space(prim)
    except UsdSplatError as error:
        yield "Colour space", str(error)


def _attribute(attribute: Usd.Attribute, code: Usd.TimeCode) -> Iterator[PropertyRow]:
    """The attribute, and what it is connected to."""
    info = attribute.GetResolveInfo(code)
    source = _SOURCES.get(info.GetSource(), "none")
    if source in ("none", "fallback") and code.IsDefault() and attribute.GetNumTimeSamples():
        source = "time samples"  # the first of them is shown
    stack = attribute.GetPropertyStack(code)
    yield PropertyRow(
        name=attribute.GetName(),
        kind="attribute",
        type_name=str(attribute.GetTypeName()),
        text=text_of(value_of(attribute, code)),
        source=source,
        samples=attribute.GetNumTimeSamples(),
        layer=_name(stack[0].layer) if stack else "",
        is_custom=attribute.IsCustom(),
        is_edited=_is_edited(attribute),
        editor=None if attribute.GetPrim().IsInstanceProxy() else editor_of(attribute, code),
    )
    if attribute.HasAuthoredConnections():
        yield PropertyRow(
            name=attribute.GetName(),
            kind="connection",
            type_name=str(attribute.GetTypeName()),
            text=text_of(attribute.GetConnections()),
            source="default",
            layer=_name(stack[0].layer) if stack else "",
            is_edited=_is_edited(attribute),
        )


def _relationship(relationship: Usd.Relationship) -> PropertyRow:
    stack = relationship.GetPropertyStack(Usd.TimeCode.Default())
    return PropertyRow(
        name=relationship.GetName(),
        kind="relationship",
        type_name="rel",
        text=text_of(relationship.GetTargets()),
        source="default" if relationship.HasAuthoredTargets() else "none",
        layer=_name(stack[0].layer) if stack else "",
        is_custom=relationship.IsCustom(),
        is_edited=_is_edited(relationship),
    )


def _row(name: str, text: str) -> PropertyRow:
    return PropertyRow(name=name, kind="computed", type_name="", text=text, source="computed")


def _is_edited(item: Usd.Property) -> bool:
    session = item.GetStage().GetSessionLayer()
    return bool(session and session.GetPropertyAtPath(item.GetPath()))


def _nodes(node: Pcp.NodeRef) -> Iterator[Pcp.NodeRef]:
    """The nodes of a prim index, the strongest first; those that say nothing are left out."""
    if not node.isInert or node.arcType == Pcp.ArcTypeRoot:
        yield node
    for child in node.children:
        yield from _nodes(child)


def _name(layer: Sdf.Layer) -> str:
    return layer.GetDisplayName() or Path(layer.identifier).name


def _prim(stage: Usd.Stage, path: str) -> Usd.Prim:
    is_path = Sdf.Path.IsValidPathString(path) and Sdf.Path(path).IsAbsoluteRootOrPrimPath()
    prim = stage.GetPrimAtPath(path) if is_path else None
    if not prim:
        raise StageError(path, "no prim", "a prim of the stage")
    return prim
