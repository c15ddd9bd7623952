"""Read the colour space and the rendering hints of a field."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pxr import Gf, Sdf, Usd

from usdsplat.core.errors import UsageError
from usdsplat.schema import tokens
from usdsplat.schema.attributes import set_uniform


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawingHints:
    """Rendering hints of a field; None keeps the prim's value.

    Raises:
        UsageError: If a hint has an invalid value.
    """

    rasterize_mode: str | None = None
    """"classic" or "antialiased"."""
    projection_mode: str | None = None
    """"perspective" or "tangential"."""
    sorting_mode: str | None = None
    """"zDepth", "cameraDistance" or "rayHitDistance"."""
    footprint: float | None = None
    """Size of a pixel of the photographs at the splats [local unit], above 0."""

    def __post_init__(self) -> None:
        for name, allowed in (
            ("rasterize_mode", tokens.RASTERIZE_MODES),
            ("projection_mode", tokens.PROJECTION_MODES),
            ("sorting_mode", tokens.SORTING_MODES),
        ):
            value = getattr(self, name)
            if value is not None and value not in allowed:
                raise UsageError(name, repr(value), f"one of {', '.join(allowed)}")
        if self.footprint is not None and not 0 < self.footprint < math.inf:
            raise UsageError("footprint", f"{self.footprint:g}", "a finite number above 0")

    def author(self, prim: Usd.Prim) -> None:
        """Write the hints that are given as uniform attributes of a prim."""
        for name, value in (
            (tokens.RASTERIZE_MODE, self.rasterize_mode),
            (tokens.PROJECTION_MODE, self.projection_mode),
            (tokens.SORTING_MODE, self.sorting_mode),
        ):
            if value is not None:
                set_uniform(prim, name, Sdf.ValueTypeNames.Token, value)
        if self.footprint is not None:
            set_uniform(prim, tokens.FOOTPRINT, Sdf.ValueTypeNames.Float, self.footprint)


def color_space(prim: Usd.Prim) -> str:
    """Return the colour space of a field: the attribute's, the prim's or its nearest ancestor's.

    Returns:
        The authored name with aliases resolved; srgb_rec709_scene if none is authored. A name that
        Gf does not know is returned unchanged.
    """
    name = written_color_space(prim) or tokens.DEFAULT_COLOR_SPACE
    return tokens.COLOR_SPACE_ALIASES.get(name, name)


def written_color_space(prim: Usd.Prim) -> str:
    """Return the authored colour space of the harmonics, unresolved; "" if there is none."""
    for name in (tokens.SH_COEFFICIENTS, tokens.SH_COEFFICIENTS_HALF):
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasColorSpace():
            return str(attribute.GetColorSpace())
    while prim and not prim.IsPseudoRoot():
        attribute = prim.GetAttribute(tokens.COLOR_SPACE)
        value = attribute.Get() if attribute else None
        if value:
            return str(value)
        prim = prim.GetParent()
    return ""


def rasterize_mode(prim: Usd.Prim) -> str:
    """Return "classic" or "antialiased"; any other value counts as classic."""
    return _token(prim, tokens.RASTERIZE_MODE, tokens.RASTERIZE_MODES)


def footprint(prim: Usd.Prim) -> float | None:
    """Return the size of a pixel of the photographs at the splats [local unit]; None if it is not
    authored or not a finite number above 0."""
    attribute = prim.GetAttribute(tokens.FOOTPRINT)
    value = attribute.Get() if attribute else None
    return value if isinstance(value, float) and 0 < value < math.inf else None


def projection_mode(prim: Usd.Prim) -> str:
    """Return "perspective" or "tangential"; any other value counts as perspective."""
    return _token(prim, tokens.PROJECTION_MODE, tokens.PROJECTION_MODES)


def sorting_mode(prim: Usd.Prim) -> str:
    """Return "zDepth", "cameraDistance" or "rayHitDistance"; any other value counts as zDepth."""
    return _token(prim, tokens.SORTING_MODE, tokens.SORTING_MODES)


def lighting_mode(prim: Usd.Prim) -> str:
    """Return "auto", "captured", "shadowed" or "relit"; any other value counts as auto."""
    return _token(prim, tokens.LIGHTING, tokens.LIGHTING_MODES)


def captured_lights(prim: Usd.Prim) -> tuple[str, ...]:
    """Return the paths of the lights in which a field was photographed; empty if unknown."""
    relationship = prim.GetRelationship(tokens.CAPTURED_LIGHTS)
    return tuple(str(path) for path in relationship.GetForwardedTargets()) if relationship else ()


def is_shadow_catcher(prim: Usd.Prim) -> bool:
    """Return whether a prim is a shadow catcher."""
    return tokens.CATCHER_API in prim.GetPrimTypeInfo().GetAppliedAPISchemas()


def is_known_color_space(name: str) -> bool:
    """Return whether Gf or our list of aliases knows the name."""
    return name in tokens.COLOR_SPACE_ALIASES or bool(Gf.ColorSpace.IsValid(name))


def _token(prim: Usd.Prim, name: str, allowed: tuple[str, ...]) -> str:
    """Return a uniform token, or the first of `allowed` if it has none of them."""
    attribute = prim.GetAttribute(name)
    value = attribute.Get() if attribute else None
    return str(value) if value in allowed else allowed[0]
