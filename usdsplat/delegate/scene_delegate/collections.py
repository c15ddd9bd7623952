"""Evaluate USD collections by USD's own rules."""

from __future__ import annotations

from collections.abc import Iterable

from pxr import Sdf, Usd

from usdsplat.delegate.scene_delegate.population import IN_PROTOTYPE

Rules = tuple[tuple[str, bool], ...]
"""(path, included): the longest path at or above a prim decides; without one it is excluded."""


def rules(stage: Usd.Stage, collections: Iterable[Usd.CollectionAPI]) -> Rules:
    """Return rules of which prims of `stage` are in any of `collections`.

    Includes, excludes, expansion rules, includeRoot, nested collections and path expressions all
    apply: USD's membership query is evaluated for each prim, including those in instances and
    prototypes. There is a rule only where the result differs from that of the parent.

    Returns:
        Rules sorted by path. All paths are prim paths: a collection that includes the pseudo-root
        gives one rule for each root prim.
    """
    queries = [each.ComputeMembershipQuery() for each in collections]
    answers = {Sdf.Path.absoluteRootPath: False}
    found = []
    traversal = iter(Usd.PrimRange(stage.GetPseudoRoot(), IN_PROTOTYPE))
    next(traversal)
    for prim in traversal if queries else ():
        path = prim.GetPath()
        answers[path] = any(query.IsPathIncluded(path) for query in queries)
        if answers[path] != answers[path.GetParentPath()]:
            found.append((str(path), answers[path]))
    return tuple(sorted(found))


def everything(stage: Usd.Stage) -> Rules:
    """Return the rules of a collection of the whole stage."""
    roots = stage.GetPseudoRoot().GetFilteredChildren(IN_PROTOTYPE)
    return tuple(sorted((str(prim.GetPath()), True) for prim in roots))


def applied(prim: Usd.Prim, name: str) -> Usd.CollectionAPI | None:
    """Return the prim's collection of that name, or None."""
    return Usd.CollectionAPI(prim, name) if prim.HasAPI("CollectionAPI", name) else None
