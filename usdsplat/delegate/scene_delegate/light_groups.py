"""Read the light group of each light. A picture can have an AOV for each group.

USD has no attribute for them. Ours is a primvar, so that a prim above several lights can name their
group. Those of other renderers are read where it is missing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pxr import Usd, UsdGeom

from usdsplat.delegate.scene_delegate.unsupported import LIGHTS
from usdsplat.images.aovs import CAPTURED, light_name

PRIMVAR = "lightGroup"
OTHERS = (
    "inputs:karma:light:lpetag", "karma:light:lpetag", "primvars:arnold:aov",
    "inputs:ri:light:lightGroup",
)  # fmt: skip
"""Attributes of Karma, Arnold and RenderMan with the same meaning."""
DEFAULT = "default"
"""Group of lights that name none."""


def light_group_aov(prim: Usd.Prim) -> str:
    """Return the AOV of the group of a light; groups do not vary over time."""
    own = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(PRIMVAR)
    attributes = [own.GetAttr()] if own else []
    for each in (*attributes, *map(prim.GetAttribute, OTHERS)):
        found = each.Get(Usd.TimeCode.EarliestTime()) if each else None
        if isinstance(found, str) and found:
            return light_name(found)
    return light_name(DEFAULT)


def light_aovs(lights: Iterable[Usd.Prim]) -> tuple[str, ...]:
    """Return the AOVs of the groups of lights that shine at any time, sorted, and that of the rest.

    They do not depend on time, so that all frames of a sequence have the same.
    """
    return *sorted({light_group_aov(prim) for prim in lights if _may_shine(prim)}), CAPTURED


def find_lights(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Yield the lights of a stage, also those in instances."""
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if any(prim.IsA(light) for light in LIGHTS):
            yield prim


def _may_shine(prim: Usd.Prim) -> bool:
    """Return whether a light is visible at any time."""
    while prim and not prim.IsPseudoRoot():
        attribute = UsdGeom.Imageable(prim).GetVisibilityAttr()
        is_still = attribute and not attribute.ValueMightBeTimeVarying()
        if is_still and attribute.Get(Usd.TimeCode.EarliestTime()) == UsdGeom.Tokens.invisible:
            return False
        prim = prim.GetParent()
    return True
