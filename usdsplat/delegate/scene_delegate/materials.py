"""Read the diffuse colour of UsdPreviewSurface networks.

Source: the UsdPreviewSurface specification. The base colour is a value, a UsdUVTexture, or a
primvar; any other connection gives its fallback value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from pxr import Sdf, Usd, UsdShade

from usdsplat.core.cloud import F32, F64
from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.core.findings import Finding, finding, from_error
from usdsplat.delegate.scene_delegate.bindings import BINDING, computed_material
from usdsplat.delegate.scene_delegate.readings import Sources
from usdsplat.delegate.scene_delegate.textures import Color, Textures
from usdsplat.delegate.scene_delegate.unsupported import (
    FALLBACKS,
    GLOSS,
    finding_on_input,
    finding_on_surface,
    findings_on_names,
)
from usdsplat.images.texture import Encoding
from usdsplat.render.specs import MaterialSpec, TextureSpec, Wrap
from usdsplat.schema.values import value

DISPLAY_COLOR = "displayColor"
NEUTRAL: Color = (0.18, 0.18, 0.18)
"""Colour of meshes with neither material nor colour."""
WRAPS = ("black", "clamp", "repeat", "mirror")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BoundMaterial:
    """A material with the primvars that it needs."""

    spec: MaterialSpec
    colors: str = ""
    """Primvar of its colours; "" for none."""
    fallback: Color = NEUTRAL
    """Colour if the primvar does not exist."""
    uvs: str = ""
    """Primvar of its texture coordinates; "" for none."""
    transform: F64 | None = None
    """Transform of the texture coordinates, shape (2, 3)."""


UNBOUND = BoundMaterial(
    spec=MaterialSpec(diffuse=(1.0, 1.0, 1.0), uses_colors=True), colors=DISPLAY_COLOR
)
"""Appearance of meshes without a bound material."""


def bound_material(prim: Usd.Prim, sources: Sources) -> Usd.Prim | None:
    """Return the material bound to a mesh or a subset, or None, and record the sources."""
    above = prim
    while above and not above.IsPseudoRoot():
        for name in above.GetAuthoredPropertyNames():
            if name.startswith(BINDING):
                for target in sources.targets(above, name):
                    _note_collection(target, sources)
        above = above.GetParent()
    material = computed_material(prim)
    return None if material is None else sources.follow(material.GetPath())


def _note_collection(path: Sdf.Path, sources: Sources) -> None:
    """Record a collection and those that it includes as sources."""
    found, seen = [path], set()
    while found:
        path = found.pop()
        if path.IsPropertyPath() and path not in seen:
            seen.add(path)
            if prim := sources.follow(path):
                found += sources.targets(prim, f"{path.name}:includes")


class MaterialReader:
    """Reader of the materials of a mesh at a time.

    Attributes:
        findings: Findings about values that were replaced by their fallback.
    """

    def __init__(self, time: Usd.TimeCode, textures: Textures, sources: Sources) -> None:
        self.findings: list[Finding] = []
        self._time = time
        self._textures = textures
        self._sources = sources

    def look(self, material: Usd.Prim | None) -> BoundMaterial:
        """Read a material; without a UsdPreviewSurface it counts as unbound."""
        output = material and self._producer(material.GetAttribute("outputs:surface"))
        kind = self._id(output.GetPrim()) if output else ""
        if not output or kind != "UsdPreviewSurface":
            if material:
                self._add(finding_on_surface(material, output and output.GetPrim(), kind))
            return UNBOUND
        self._note_inputs(output.GetPrim())
        base = self._input(output.GetPrim(), "diffuseColor")
        if base is None:
            return BoundMaterial(spec=MaterialSpec(diffuse=NEUTRAL))
        kind = self._id(base.GetPrim()) if _is_output(base) else ""
        if kind == "UsdUVTexture":
            return self._texture(base.GetPrim())
        if kind.startswith("UsdPrimvarReader_"):
            reader = base.GetPrim()
            return BoundMaterial(
                spec=MaterialSpec(diffuse=(1.0, 1.0, 1.0), uses_colors=True),
                colors=self._name(reader),
                fallback=self._color(reader, "fallback", (0.0, 0.0, 0.0)),
            )
        if kind:
            where = f"{output.GetPrim().GetPath()}.inputs:diffuseColor"
            expected = "a UsdUVTexture or a primvar reader"
            self._add(finding("unsupported-input", where, f"a connection to {kind}", expected))
        return BoundMaterial(
            spec=MaterialSpec(diffuse=self._color(output.GetPrim(), "diffuseColor", NEUTRAL))
        )

    def _add(self, found: Finding | None) -> None:
        if found is not None:
            self.findings.append(found)

    def _note_inputs(self, shader: Usd.Prim) -> None:
        """Add a finding for each input of a surface that is ignored."""
        for name in (*FALLBACKS, *GLOSS):
            attribute = shader.GetAttribute(f"inputs:{name}")
            if attribute and (attribute.HasAuthoredValue() or attribute.HasAuthoredConnections()):
                source = self._producer(attribute)
                is_value = source is not None and not _is_output(source)
                found = value(source, self._time) if is_value else None
                self._add(finding_on_input(shader, name, found))

    # --- nodes -----------------------------------------------------------------------------

    def _texture(self, node: Usd.Prim) -> BoundMaterial:
        fallback = self._color(node, "fallback", (0.0, 0.0, 0.0))
        name, transform = self._coordinates(node)
        scale, bias = (
            self._color(node, "scale", (1.0, 1.0, 1.0)),
            self._color(node, "bias", (0, 0, 0)),
        )
        try:
            pixels = self._pixels(node, scale, bias)
        except UsdSplatError as error:
            # Without an authored fallback, neutral grey is better than black for a missing texture.
            authored = node.GetAttribute("inputs:fallback").HasAuthoredValue()
            self.findings.append(from_error("missing-asset", error))
            return BoundMaterial(spec=MaterialSpec(diffuse=fallback if authored else NEUTRAL))
        wrap = (self._wrap(node, "wrapS"), self._wrap(node, "wrapT"))
        diffuse = (1.0, 1.0, 1.0) if any(bias) else scale
        spec = MaterialSpec(diffuse=diffuse, texture=TextureSpec(pixels=pixels, wrap=wrap))
        return BoundMaterial(spec=spec, uvs=name, transform=transform)

    def _coordinates(self, node: Usd.Prim) -> tuple[str, F64 | None]:
        """Return the primvar connected as `st`, and the transforms on the way to it."""
        transform: F64 | None = None
        at, seen = self._input(node, "st"), set()
        while at is not None and _is_output(at) and at.GetPath() not in seen:
            seen.add(at.GetPath())
            prim = at.GetPrim()
            if self._id(prim) != "UsdTransform2d":
                return self._name(prim), transform
            transform = _after(transform, self._transform2d(prim))
            at = self._input(prim, "in")
        return "", transform

    def _transform2d(self, node: Usd.Prim) -> F64:
        """Return the transform that scales `in`, then rotates, then translates, shape (2, 3)."""
        scale = self._numbers(node, "scale", (1.0, 1.0))
        move = self._numbers(node, "translation", (0.0, 0.0))
        angle = math.radians(self._numbers(node, "rotation", (0.0,))[0])
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        return np.column_stack([turn * np.array(scale), move])

    def _pixels(self, node: Usd.Prim, scale: Color, bias: Color) -> F32:
        """Read the texture; scale and bias are applied here if there is a bias."""
        where, file = f"{node.GetPath()}.inputs:file", self._value(node, "file")
        if not isinstance(file, Sdf.AssetPath) or not file.path:
            raise StageError(where, "no file", "a picture")
        space = self._value(node, "sourceColorSpace")
        encoding = cast(Encoding, space) if space in ("sRGB", "raw") else "auto"
        try:
            if any(bias):
                return self._textures.read_biased(file, encoding, scale=scale, bias=bias)
            return self._textures.read(file, encoding)
        except UsdSplatError as error:
            raise StageError(where, f"{file.path}: {error.found}", error.expected) from None

    def _wrap(self, node: Usd.Prim, name: str) -> Wrap:
        """Return the wrap mode; useMetadata is not supported and gives its fallback, black."""
        found = self._value(node, name)
        if found not in (None, *WRAPS):
            where, expected = f"{node.GetPath()}.inputs:{name}", f"one of {', '.join(WRAPS)}"
            self._add(finding("unsupported-input", where, repr(found), expected))
        return cast(Wrap, found) if found in WRAPS else "black"

    def _name(self, node: Usd.Prim) -> str:
        return str(self._value(node, "varname") or "")

    # --- inputs ----------------------------------------------------------------------------

    def _id(self, node: Usd.Prim) -> str:
        self._sources.add(node)
        attribute = node.GetAttribute("info:id")
        kind = str(attribute.Get() or "") if attribute else ""
        self.findings += findings_on_names(node, kind)
        return kind

    def _color(self, node: Usd.Prim, name: str, fallback: Color) -> Color:
        red, green, blue, *_ = self._numbers(node, name, fallback)
        return red, green, blue

    def _numbers(self, node: Usd.Prim, name: str, fallback: tuple[float, ...]) -> tuple[float, ...]:
        found = self._value(node, name)
        try:
            numbers = np.asarray(found, np.float64).ravel()
        except (TypeError, ValueError):
            return fallback
        if len(numbers) < len(fallback) or not np.isfinite(numbers).all():
            return fallback
        return tuple(numbers.tolist())

    def _value(self, node: Usd.Prim, name: str) -> Any:
        found = self._input(node, name)
        return None if found is None or _is_output(found) else value(found, self._time)

    def _input(self, node: Usd.Prim, name: str) -> Usd.Attribute | None:
        """Return the attribute that provides the value of an input: a value or a shader's
        output."""
        return self._producer(node.GetAttribute(f"inputs:{name}"))

    def _producer(self, attribute: Usd.Attribute) -> Usd.Attribute | None:
        """Follow connections through node graphs to their source."""
        seen = set()
        while attribute and attribute.GetPath() not in seen:
            seen.add(attribute.GetPath())
            self._sources.add(attribute.GetPrim())
            connected = attribute.GetConnections()
            if not connected or (
                _is_output(attribute) and attribute.GetPrim().IsA(UsdShade.Shader)
            ):
                return attribute
            prim = self._sources.follow(connected[0])
            after = prim.GetAttribute(connected[0].name) if prim else None
            if not after:
                return None if _is_output(attribute) else attribute
            attribute = after
        return None


def _is_output(attribute: Usd.Attribute) -> bool:
    return bool(attribute.GetName().startswith("outputs:"))


def _after(first: F64 | None, then: F64) -> F64:
    """Return the transform that applies `then`, then `first`."""
    if first is None:
        return then
    square = np.vstack([then, [0.0, 0.0, 1.0]])
    return first @ square
