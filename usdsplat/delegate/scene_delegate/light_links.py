"""Find targets of light linking that do not exist, and lights that reach nothing."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Sdf, Usd

from usdsplat.core.findings import Finding, finding

LINKS = ("lightLink", "shadowLink")
"""Collections of a light: what it lights, and what casts its shadows."""


def findings_on_links(prim: Usd.Prim) -> Iterator[Finding]:
    """Yield a finding for each target of the collections of a light that does not exist, and one if
    the light reaches nothing.

    What is not loaded, or left out by the population mask, may exist. A collection `shadowLink`
    without members is a way to say that nothing casts shadows, and no finding.
    """
    for name in LINKS:
        for kind in ("includes", "excludes"):
            relationship = prim.GetRelationship(f"collection:{name}:{kind}")
            for path in relationship.GetTargets() if relationship else ():
                if _is_missing(prim.GetStage(), path.GetPrimPath()):
                    found = f"{path}, which does not exist"
                    yield finding("unused", str(relationship.GetPath()), found, "a prim")
    link = Usd.CollectionAPI(prim, LINKS[0])
    root, includes = link.GetIncludeRootAttr(), link.GetIncludesRel()
    by_path, by_expression = includes and includes.GetTargets(), link.GetMembershipExpressionAttr()
    has_root = not root or root.Get() is not False
    if not (has_root or by_path or (by_expression and by_expression.HasAuthoredValue())):
        where = f"{prim.GetPath()}.collection:{LINKS[0]}"
        yield finding("links-nothing", where, "no members", "a prim that the light reaches")


def _is_missing(stage: Usd.Stage, path: Sdf.Path) -> bool:
    """Return whether a stage has no prim at a path, although all of the prims above are loaded."""
    if not stage.GetPopulationMask().IncludesSubtree(path):
        return False
    for each in path.GetPrefixes():
        prim = stage.GetPrimAtPath(each)
        if not prim:
            return True
        if not (prim.IsActive() and prim.IsLoaded()):
            return False
    return False
