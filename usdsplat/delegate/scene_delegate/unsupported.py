"""Find prims that ask for something that is not drawn: other lights, curves, unknown types.

Inputs of lights and of shaders that have no effect are findings too, if they would change
brightness, hue or coverage. Surfaces are diffuse, so nearly every material has a roughness or a
normal map without effect: these and clearcoats are one finding of the whole stage.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from numbers import Real
from typing import Any

from pxr import Usd, UsdGeom, UsdLux, UsdShade

from usdsplat.core.findings import Finding, finding
from usdsplat.delegate.scene_delegate.light_links import findings_on_links

DOMES = (UsdLux.DomeLight, UsdLux.DomeLight_1)
LIGHTS = (
    UsdLux.DistantLight, UsdLux.SphereLight, UsdLux.DiskLight, UsdLux.RectLight,
    UsdLux.CylinderLight, *DOMES,
)  # fmt: skip
"""Types of lights that are drawn."""
OTHER_LIGHTS = (UsdLux.BoundableLightBase, UsdLux.NonboundableLightBase, UsdLux.PluginLight)
"""Types of lights, those that are drawn among them."""

LIGHT_APIS = ("ShapingAPI", "ShadowAPI")
"""Schemas whose inputs have an effect only on lights to which they are applied."""

OWN_TYPES = ("SplatSim", "LODScreenSizeHeuristic", "LODDistanceHeuristic")
"""Types that we write or read, that USD may not know, and that are not drawn."""

TYPES = (
    "ParticleField3DGaussianSplat", "ParticleFieldPackedSplat", "Mesh", "Sphere", "Cube",
    "Cylinder", "Cone", "Capsule", "Plane", "Xform", "Scope", "Camera", "DistantLight",
    "SphereLight", "DiskLight", "RectLight", "CylinderLight", "DomeLight",
    "DomeLight_1", "PointInstancer", "Material",
    "Shader", "RenderSettings", "RenderProduct", "RenderVar", "SplatSim",
)  # fmt: skip
"""Types that a misspelt one may mean."""

_SURFACE: dict[str, Any] = {
    **dict.fromkeys((
        "diffuseColor", "specularColor", "roughness", "clearcoat", "clearcoatRoughness",
        "opacityMode", "opacityThreshold", "ior", "normal", "occlusion",
    )),
    "opacity": 1.0,
    "metallic": 0.0,
    "emissiveColor": (0.0, 0.0, 0.0),
    "displacement": 0.0,
    "useSpecularWorkflow": 0,
}  # fmt: skip
"""Input of UsdPreviewSurface -> its fallback if it is unsupported and other values would change
brightness, hue or coverage; else None.

Source: the UsdPreviewSurface specification.
"""

FALLBACKS = {name: fallback for name, fallback in _SURFACE.items() if fallback is not None}
"""Unsupported input of UsdPreviewSurface -> its fallback, with which it has no effect."""

GLOSS = {"roughness": 0.5, "clearcoat": 0.0, "normal": (0.0, 0.0, 1.0)}
"""Input of highlights and bumps -> its fallback, as which it says nothing about the material. So
does a higher roughness."""
DIFFUSE = "diffuse-surfaces"
"""Code of the finding on these inputs, which a stage has once."""
MOST_NUMBERS = 4
"""Count of the numbers of an array that a sentence has."""
MOST_LETTERS = 60
"""Length of a value of another kind there."""

CURES = {
    "inputs:shaping:ies:file": "clear it, and shape the beam with inputs:shaping:cone:angle, "
    "inputs:shaping:cone:softness and inputs:shaping:focus",
    "inputs:texture:file": "clear it, and give the light the mean colour of the picture",
    "light:filters": "clear it; lightLink and shadowLink say what a light reaches and what casts "
    "its shadows",
}
"""Property of a light that has no effect -> what to do instead."""

INPUTS = {
    "UsdPreviewSurface": tuple(_SURFACE),
    "UsdUVTexture": ("file", "st", "wrapS", "wrapT", "fallback", "scale", "bias",
                     "sourceColorSpace"),
    "UsdTransform2d": ("in", "rotation", "scale", "translation"),
    "UsdPrimvarReader": ("varname", "fallback"),
}  # fmt: skip
"""Shader -> names of its inputs; `UsdPrimvarReader` has a suffix for its type.

Source: the UsdPreviewSurface specification.
"""


def is_dome(prim: Usd.Prim) -> bool:
    """Return whether a prim is a dome light."""
    return any(prim.IsA(each) for each in DOMES)


def why_not_drawn(prim: Usd.Prim) -> str:
    """Return the code of the finding on a prim that is none of the drawn ones; "" for none.

    It depends only on the type of the prim.
    """
    name = prim.GetTypeName()
    if not name or name in OWN_TYPES:
        return ""
    if prim.GetPrimTypeInfo().GetSchemaType().isUnknown:
        return "unknown-type"
    if any(prim.IsA(light) for light in OTHER_LIGHTS):
        return "unsupported-light"
    return "unsupported-prim" if prim.IsA(UsdGeom.Gprim) else ""


def findings_on_prims(
    prims: Iterable[tuple[Usd.Prim, str]], time: Usd.TimeCode, purposes: frozenset[str]
) -> Iterator[Finding]:
    """Yield a finding for each type among visible prims that are not drawn.

    Args:
        prims: Pairs (prim, code of `why_not_drawn`).
        time: Time of the visibility.
        purposes: Drawn purposes.
    """
    groups: dict[tuple[str, str], list[Usd.Prim]] = {}
    for prim, code in prims:
        if code == "unknown-type" or _is_seen(prim, time, purposes):
            groups.setdefault((code, str(prim.GetTypeName())), []).append(prim)
    for (code, name), members in groups.items():
        first, count = str(members[0].GetPath()), len(members)
        what = f"{name}, a type that USD does not know" if code == "unknown-type" else name
        found = what if count == 1 else f"{what} (and {count - 1} more)"
        yield finding(code, first, found, _expected(code, name))


def findings_on_light(prim: Usd.Prim) -> Iterator[Finding]:
    """Yield a finding for each input and each link of a light that has no effect."""
    relationship = prim.GetRelationship("light:filters")
    if relationship and relationship.HasAuthoredTargets() and relationship.GetTargets():
        found, where = ", ".join(map(str, relationship.GetTargets())), relationship.GetPath()
        cure = CURES["light:filters"]
        yield finding("unsupported-input", str(where), found, "no targets", cure=cure)
    for name in ("inputs:texture:file", "inputs:shaping:ies:file"):
        attribute = prim.GetAttribute(name)
        if name == "inputs:texture:file" and is_dome(prim):
            continue
        value = attribute.Get() if attribute else None
        if value is not None and str(value.path):
            where, cure = str(attribute.GetPath()), CURES[name]
            yield finding("unsupported-input", where, value.path, "no file", cure=cure)
    yield from _names_of_light(prim)
    yield from findings_on_links(prim)


def _names_of_light(prim: Usd.Prim) -> Iterator[Finding]:
    """Yield a finding for each input of a light that its schemas do not have. Inputs in a namespace
    that is none of theirs belong to other renderers."""
    known = _inputs(prim.GetPrimDefinition())
    registry = Usd.SchemaRegistry()
    apis = {api: _inputs(registry.FindAppliedAPIPrimDefinition(api)) for api in LIGHT_APIS}
    for name in prim.GetAuthoredPropertyNames():
        if not name.startswith("inputs:") or name in known:
            continue
        where = f"{prim.GetPath()}.{name}"
        if api := next((api for api, names in apis.items() if name in names), None):
            yield finding(
                "unused", where, f"an input of {api}, which is not applied", f"{api} applied"
            )
            continue
        plain = (each.removeprefix("inputs:") for each in sorted(known.union(*apis.values())))
        near = difflib.get_close_matches(name.removeprefix("inputs:"), plain, 1, 0.75)
        if near or name.count(":") == 1:
            expected = f"such as inputs:{near[0]}" if near else f"an input of {prim.GetTypeName()}"
            yield finding("unknown-name", where, "an unknown input", expected)


def _inputs(definition: Usd.PrimDefinition) -> set[str]:
    """Return the names of the inputs of a schema."""
    return {name for name in definition.GetPropertyNames() if name.startswith("inputs:")}


def finding_on_input(shader: Usd.Prim, name: str, found: Any) -> Finding | None:
    """Return a finding on an input of a UsdPreviewSurface, unless it has no effect.

    Args:
        shader: The shader.
        name: Key of `FALLBACKS` or of `GLOSS`.
        found: Value of the input; None if another shader computes it.
    """
    fallback = GLOSS[name] if name in GLOSS else FALLBACKS[name]
    where, plain = f"{shader.GetPath()}.inputs:{name}", _plain(found)
    said = "a connection" if found is None else _text(found)
    width = _width(fallback)
    if found is not None and _width(plain) != width:
        expected = f"{width} numbers" if width else "a number"
        return finding("unsupported-input", where, said, expected)
    is_matt = name == "roughness" and found is not None and plain >= fallback
    if is_matt or plain == fallback:
        return None
    code = DIFFUSE if name in GLOSS else "unsupported-input"
    return finding(code, where, said, f"{_text(fallback)}, the fallback")


def in_order(found: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings by path, each once; of those with a common key the first one."""
    once: dict[tuple[str, ...], Finding] = {}
    for each in sorted(found, key=lambda each: (each.path, each.message)):
        once.setdefault(each.key, each)
    return tuple(once.values())


def findings_on_names(shader: Usd.Prim, kind: str) -> Iterator[Finding]:
    """Yield a finding for each input of a shader that its specification does not have.

    Args:
        shader: The shader.
        kind: Its identifier.
    """
    known = INPUTS.get(kind.partition("_")[0], ())
    for name in shader.GetAuthoredPropertyNames() if known else ():
        if name.startswith("inputs:") and name.removeprefix("inputs:") not in known:
            near = difflib.get_close_matches(name.removeprefix("inputs:"), known, n=1)
            expected = f"such as inputs:{near[0]}" if near else f"an input of {kind}"
            where = f"{shader.GetPath()}.{name}"
            yield finding("unknown-name", where, "an unknown input", expected)


def finding_on_surface(material: Usd.Prim, shader: Usd.Prim | None, kind: str) -> Finding | None:
    """Return a finding on a material without a UsdPreviewSurface, unless it has no surface.

    Args:
        material: The material.
        shader: Its surface for all renderers, if it has one.
        kind: Identifier of this shader.
    """
    expected = "UsdPreviewSurface"
    if shader:
        return finding("unsupported-surface", str(shader.GetPath()), repr(kind), expected)
    others = [
        output.GetFullName()
        for output in UsdShade.Material(material).GetSurfaceOutputs()
        if output.GetAttr().HasAuthoredConnections()
    ]
    if not others:
        return None
    found = f"surfaces of other renderers only ({', '.join(others)})"
    return finding("unsupported-surface", str(material.GetPath()), found, expected)


def _is_seen(prim: Usd.Prim, time: Usd.TimeCode, purposes: frozenset[str]) -> bool:
    imageable = UsdGeom.Imageable(prim)
    if not imageable:
        return False
    is_hidden = imageable.ComputeVisibility(time) == UsdGeom.Tokens.invisible
    return not is_hidden and str(imageable.ComputePurpose()) in purposes


def _expected(code: str, name: str) -> str:
    if code == "unsupported-light":
        return "a DistantLight, SphereLight, DiskLight, RectLight, CylinderLight or DomeLight"
    if code == "unsupported-prim":
        return "splats, a mesh or a shape"
    near = difflib.get_close_matches(name, TYPES, n=1)
    return f"such as {near[0]}" if near else "a type of a schema that USD has loaded"


def _text(value: Any) -> str:
    """Return a value as text for a message. The end of long arrays and texts is left out: "…"."""
    numbers = _plain(value)
    if isinstance(numbers, tuple):
        more = ", …" if len(numbers) > MOST_NUMBERS else ""
        return f"({', '.join(f'{each:g}' for each in numbers[:MOST_NUMBERS])}{more})"
    if isinstance(numbers, float):
        return f"{numbers:g}"
    text = str(numbers)
    return text if len(text) <= MOST_LETTERS else f"{text[: MOST_LETTERS - 1]}…"


def _plain(value: Any) -> Any:
    """Return a value of USD as a number or a tuple of numbers; others, such as texts, as they
    are."""
    if isinstance(value, str):
        return value
    try:
        return tuple(float(each) for each in value)
    except (TypeError, ValueError):
        return value


def _width(plain: Any) -> int:
    """Return the count of numbers of a tuple; 0 for a number, and -1 for anything else."""
    if isinstance(plain, tuple):
        return len(plain)
    return 0 if isinstance(plain, Real) else -1
