"""USD collections: which prims of a stage they hold, by USD's own rules."""

from __future__ import annotations

from collections.abc import Iterable

from pxr import Sdf, Usd

from usdsplat.delegate.scene_delegate.population import IN_PROTOTYPE

Rules = tuple[tuple[str, bool], ...]
"""A prim goes by the longest of these paths that it is at or beneath; "/" is above all."""


def rules(stage: Usd.Stage, collections: Iterable[Usd.CollectionAPI]) -> Rules:
    """Say by path which prims of `stage` are in any of `collections`.

    Includes, excludes, expansion rules, includeRoot, nested collections and path expressions all
    count: USD is asked about each prim, those in instances and in prototypes too, and only where
    its answer differs from the one about its parent there is a rule.

    Returns:
        By path; without a rule above it a prim is in none.
    """
    queries = [each.ComputeMembershipQuery() for each in collections]
    root = Sdf.Path.absoluteRootPath
    answers = {root: any(_holds_root(query) for query in queries)}
    found = [(str(root), True)] if answers[root] else []
    traversal = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(IN_PROTOTYPE))
    for prim in traversal if queries else ():
        path = prim.GetPath()
        if path == root:
            continue
        answers[path] = any(query.IsPathIncluded(path) for query in queries)
        if answers[path] != answers[path.GetParentPath()]:
            found.append((str(path), answers[path]))
    return tuple(sorted(found))


def applied(prim: Usd.Prim, name: str) -> Usd.CollectionAPI | None:
    """The prim's collection of that name, if it has one."""
    return Usd.CollectionAPI(prim, name) if prim.HasAPI("CollectionAPI", name) else None


def _holds_root(query: Usd.CollectionMembershipQuery) -> bool:
    known = query.GetAsPathExpansionRuleMap()
    return known.get(Sdf.Path.absoluteRootPath) == Usd.Tokens.expandPrims
