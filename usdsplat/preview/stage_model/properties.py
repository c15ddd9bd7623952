"""List the properties of one prim at a time, its metadata, and the sources of both."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pxr import Pcp, Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.preview.knob_model import Editor
from usdsplat.preview.stage_model.attribute_values import editor_of, text_of
from usdsplat.preview.stage_model.placing import code_of
from usdsplat.preview.stage_model.prims import matcher
from usdsplat.schema.stage_values import local_to_world, world_bound
from usdsplat.schema.values import value as value_of

PropertyKind = Literal["computed", "attribute", "connection", "relationship"]
Source = Literal["none", "fallback", "default", "time samples", "value clips", "computed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PropertyRow:
    """A property, or a value computed from a prim."""

    name: str
    kind: PropertyKind
    type_name: str
    """Type of the value, such as "point3f[]"; "" for none."""
    text: str
    """The value at the time; of an array, its count and first elements."""
    source: Source
    samples: int = 0
    """Number of authored time samples."""
    layer: str = ""
    """Name of the layer with the strongest opinion; "" for none."""
    is_custom: bool = False
    is_edited: bool = False
    """Whether the session layer has an opinion on it."""
    editor: Editor | None = None
    """Editor of the value; None where `Edits.set_value` does not apply."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MetadataRow:
    """A metadata field of a prim."""

    name: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ArcRow:
    """A source of opinions on a prim."""

    kind: str
    """Composition arc: "root", "reference", "payload", "variant", "inherit", ..."""
    path: str
    """Path of the prim spec in its layer."""
    layer: str
    """Name of the layer."""
    identifier: str
    """Identifier of the layer, a file path where it has one."""
    has_specs: bool
    """Whether the layer has a prim spec there."""


_SOURCES: dict[Any, Source] = {
    Usd.ResolveInfoSourceNone: "none",
    Usd.ResolveInfoSourceFallback: "fallback",
    Usd.ResolveInfoSourceDefault: "default",
    Usd.ResolveInfoSourceTimeSamples: "time samples",
    Usd.ResolveInfoSourceValueClips: "value clips",
}
_TURNED = (
    *(f"inputs:{name}" for name in ("intensity", "exposure", "color", "texture:file")),
    *(f"inputs:{name}" for name in ("angle", "radius", "width", "height", "length")),
    *(f"inputs:{name}" for name in ("enableColorTemperature", "colorTemperature")),
    *(f"inputs:{name}" for name in ("shaping:cone:angle", "shaping:cone:softness")),
    *("focalLength", "focusDistance", "fStop", "horizontalAperture", "verticalAperture"),
    *("clippingRange", "projection", "radius", "size", "width", "length", "height", "axis"),
)
"""Properties of lights, cameras and shapes that most people turn, the first ones first."""
_PROPERTY_FIELDS = ("primChildren", "properties", "propertyChildren")
"""Fields of a prim spec that list children, not metadata."""


def properties(
    stage: Usd.Stage,
    path: str,
    *,
    time: float | None = None,
    facts: Iterable[tuple[str, str]] = (),
) -> tuple[PropertyRow, ...]:
    """Return a prim's properties at a time.

    Those that most people turn come first, such as the intensity of a light. Computed ones follow,
    then the others by name, and collections last.

    Args:
        stage: The stage.
        path: Path of the prim; an inactive one has only metadata.
        time: Time code; None is USD's default time.
        facts: Names and texts of further computed values, see `tree_facts`.

    Raises:
        StageError: If there is no such prim.
    """
    prim = _prim(stage, path)
    code = code_of(time)
    rows = [*(_row(name, text) for name, text in facts), *_computed(prim, code)]
    for each in prim.GetProperties():
        if isinstance(each, Usd.Attribute):
            rows.extend(_attribute(each, code))
        else:
            rows.append(_relationship(each))
    return tuple(sorted(rows, key=_place))


def matching(rows: Iterable[PropertyRow], text: str) -> tuple[PropertyRow, ...]:
    """Return the rows whose name, type or value contains a text, with the rules of `prims.search`;
    all rows for an empty one."""
    text = text.strip()
    if not text:
        return tuple(rows)
    matches = matcher(text)
    return tuple(
        row for row in rows if any(map(matches, filter(None, (row.name, row.type_name, row.text))))
    )


def metadata(stage: Usd.Stage, path: str) -> tuple[MetadataRow, ...]:
    """Return the metadata fields of a prim, by name.

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
    """Return the sources of a prim's opinions, the strongest first.

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


def _place(row: PropertyRow) -> tuple[int, int]:
    """Return the place of a row among those of a prim; equal ones keep their order."""
    if row.name in _TURNED:
        return 0, _TURNED.index(row.name)
    if row.name.startswith("inputs:"):
        return 0, len(_TURNED)
    if row.kind == "computed":
        return 1, 0
    return 3 if row.name.startswith("collection:") else 2, 0


def _computed(prim: Usd.Prim, code: Usd.TimeCode) -> Iterator[PropertyRow]:
    """Yield the computed values that usdview shows, and facts about splats."""
    if not prim.IsActive() or prim.IsPseudoRoot():
        return
    if schema.is_splat_field(prim):
        for name, text in _splats(prim, code):
            yield _row(name, text)
    imageable = UsdGeom.Imageable(prim)
    if not imageable:
        return
    if prim.IsA(UsdGeom.Xformable):
        yield _row("Local to world", _placed(prim, code))
    purposes = UsdGeom.Imageable.GetOrderedPurposeTokens()
    cache = UsdGeom.BBoxCache(code, purposes, useExtentsHint=True)
    yield _row("World bounding box", _bounded(prim, cache))
    yield _row("Visibility, inherited", str(imageable.ComputeVisibility(code)))
    yield _row("Purpose, inherited", str(imageable.ComputePurpose()))


def _placed(prim: Usd.Prim, code: Usd.TimeCode) -> str:
    """Return the transform of a prim, or what is wrong with it."""
    try:
        return text_of(local_to_world(prim, UsdGeom.XformCache(code)))
    except StageError as error:
        return str(error)


def _bounded(prim: Usd.Prim, cache: UsdGeom.BBoxCache) -> str:
    """Return the bounding box of a prim, or why it has none."""
    try:
        box = world_bound(prim, cache).ComputeAlignedRange()
    except StageError as error:
        return str(error)
    return "empty" if box.IsEmpty() else f"{text_of(box.GetMin())} to {text_of(box.GetMax())}"


def _splats(prim: Usd.Prim, code: Usd.TimeCode) -> Iterator[tuple[str, str]]:
    """Yield the count, SH degree and form of splats, without reading their arrays."""
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
    """Yield the attribute, and its connections."""
    info = attribute.GetResolveInfo(code)
    source = _SOURCES.get(info.GetSource(), "none")
    if source in ("none", "fallback") and code.IsDefault() and attribute.GetNumTimeSamples():
        source = "time samples"  # the first sample is shown
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
    """Yield the nodes of a prim index that have opinions, the strongest first."""
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
