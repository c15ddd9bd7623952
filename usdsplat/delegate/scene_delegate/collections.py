"""USD collections: which prims of a stage they hold, by USD's own rules."""

from __future__ import annotations

from collections.abc import Iterable

from pxr import Sdf, Usd

from usdsplat.delegate.scene_delegate.population import IN_PROTOTYPE

Rules = tuple[tuple[str, bool], ...]
"""A prim goes by the longest of these paths that it is at or beneath; without one it is out."""


def rules(stage: Usd.Stage, collections: Iterable[Usd.CollectionAPI]) -> Rules:
    """Say by path which prims of `stage` are in any of `collections`.

    Includes, excludes, expansion rules, includeRoot, nested collections and path expressions all
    count: USD is asked about each prim, those in instances and in prototypes too, and only where
    its answer differs from the one about its parent there is a rule.

    Returns:
        By path, sorted. The paths are of prims: a collection with the root has all root prims.
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
    """The rules of a collection that holds the whole stage."""
    roots = stage.GetPseudoRoot().GetFilteredChildren(IN_PROTOTYPE)
    return tuple(sorted((str(prim.GetPath()), True) for prim in roots))


def applied(prim: Usd.Prim, name: str) -> Usd.CollectionAPI | None:
    """The prim's collection of that name, if it has one."""
    return Usd.CollectionAPI(prim, name) if prim.HasAPI("CollectionAPI", name) else None
