"""Find grades, crops and light of fields, which exports to captures do not apply."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pxr import Usd

from usdsplat import schema
from usdsplat.core.errors import StageError
from usdsplat.core.findings import Finding, finding
from usdsplat.core.grade import Grade

LIT = {"shadowed": "shadows of lights", "relit": "another light"}
"""Mode of `SplatLightingAPI` -> what a field asks for."""
RELIGHT = "relight the splats to a layer with usdsplat relight, and convert that"
"""Cure that findings give where a field asks for light that a file cannot hold."""


def unapplied(prims: Iterable[Usd.Prim], time: float | None) -> Iterator[Finding]:
    """Yield a finding for each field with a grade or a crop, its own or inherited, that acts, or
    with a light of its own.

    Args:
        prims: The fields.
        time: Time code of the grades; None for the default value or, without one, the first sample.
    """
    for prim in prims:
        acting = ["a grade"] if is_graded(prim, time) else []
        acting += ["a crop"] if is_cropped(prim) else []
        lit = LIT.get(schema.lighting_mode(prim))
        if acting or lit:
            expected = "none: captures have neither grades, crops nor lights"
            found = " and ".join([*acting, *([lit] if lit else [])])
            cure = "" if acting else RELIGHT
            yield finding("not-applied", str(prim.GetPath()), found, expected, cure=cure)


def is_graded(prim: Usd.Prim, time: float | None) -> bool:
    """Return whether the grade of a field is not neutral, or cannot be read."""
    try:
        return schema.grade(prim, time) != Grade()
    except StageError:
        return True


def is_cropped(prim: Usd.Prim) -> bool:
    """Return whether a crop collection at or above a field has members."""
    while prim and not prim.IsPseudoRoot():
        for name in (schema.tokens.CROP_INCLUDE, schema.tokens.CROP_EXCLUDE):
            is_authored = bool(prim.GetAuthoredPropertiesInNamespace(f"collection:{name}"))
            if is_authored and _has_members(Usd.CollectionAPI(prim, name)):
                return True
        prim = prim.GetParent()
    return False


def _has_members(collection: Usd.CollectionAPI) -> bool:
    """Return whether prims of the stage are in a collection."""
    query = collection.ComputeMembershipQuery()
    stage = collection.GetPrim().GetStage()
    return bool(Usd.CollectionAPI.ComputeIncludedPaths(query, stage))
