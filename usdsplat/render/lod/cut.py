"""Choose the nodes of splat trees that a picture draws.

A cut has, below each root, every leaf under exactly one of its nodes. Nodes are refined, the
largest projected error first, across all trees, instances and samples of a picture, until no error
exceeds the limit or the budget of splats is full. A node is refined with all of its children, so a
cut is complete however small the budget is.

Errors only become smaller from a node to its children, so a cut is given by one number: the nodes
with larger errors are refined. Samples of a picture use numbers between the limit and FADE times
the limit. A node whose error lies between is then drawn in some samples, and its children in the
others, which fades it into its children while a camera approaches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F64, I64
from usdsplat.core.node_table import NESTED, NodeTable
from usdsplat.render.lod.measure import Bools, NodeMeasure
from usdsplat.render.screen import Screen

FADE = NESTED
"""Ratio of the errors at which a node begins and ends to be drawn. It is at most the least ratio of
the errors of a node and a child, so that three levels are never faded at once."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TreeView:
    """A tree as the samples of a picture see it."""

    table: NodeTable
    transforms: F64
    """Local to world of each instance in each sample, shape (k, m, 4, 4)."""
    closed: frozenset[int] = frozenset()
    """Nodes that must not be refined."""
    tangential: bool = False
    """See `NodeMeasure`."""


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """The nodes of one tree that a sample draws; all arrays have the shape (p,)."""

    instances: I64
    nodes: I64
    refined: Bools
    """Whether only the node's residents are drawn, because its children are drawn too."""


@dataclass(frozen=True, slots=True, eq=False)
class Reached:
    """The nodes of one tree that the finest cut reaches; all arrays have the shape (p,)."""

    instances: I64
    nodes: I64
    errors: F64
    """Projected errors [pixel]; 0 for nodes that cannot be refined or cannot be seen."""
    above: F64
    """Errors of the parents; infinity for a root."""
    seen: Bools
    """Whether the node can touch the data window."""
    shown: Bools
    """Whether the node can touch the data window or the display window."""

    def above_error(self, error: float) -> Drawn:
        """Return what is drawn if nodes with larger errors are refined, unseen nodes included."""
        reached = self.above > error
        refined = self.errors[reached] > error
        return Drawn(self.instances[reached], self.nodes[reached], refined)

    def keeping(self, which: Bools) -> Reached:
        """Return some of the nodes."""
        return Reached(
            self.instances[which], self.nodes[which], self.errors[which], self.above[which],
            self.seen[which], self.shown[which],
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """The cuts of all samples of a picture."""

    trees: tuple[Reached, ...]
    limit: float
    """Nodes with larger errors [pixel] are refined in the finest of the cuts."""
    splats: int
    """Number of splats in the finest cut that can be seen; each instance counts."""

    def error_at(self, fade: float) -> float:
        """Return the error [pixel] above which a sample refines nodes; `fade` is in [0, 1]."""
        return self.limit * (1 + fade * (FADE - 1))

    def shows_inner(self, tables: Sequence[NodeTable], most: float) -> bool:
        """Return whether proxies of an inner node are shown by a cut that refines nodes above the
        error `most`, or above a smaller one."""
        for reached, table in zip(self.trees, tables, strict=True):
            inner = (table.child_count > 0) & (table.proxies > 0)
            if (reached.shown & (reached.errors <= most) & inner[reached.nodes]).any():
                return True
        return False


def choose(
    trees: Sequence[TreeView], screens: Sequence[Screen], *, error: float, budget: int = 0
) -> Cut:
    """Choose the cuts of a picture.

    Args:
        trees: Their transforms have one entry for each screen.
        screens: Projections of the samples, which share the data window.
        error: Largest projected error of a node that is not refined [pixel].
        budget: Maximum number of splats in the windows; 0 for any. The roots, and nodes below them
            that have no proxies, are drawn even if they are more.
    """
    found = [_reached(tree, screens, error) for tree in trees]
    base, errors, added = 0, [np.empty(0)], [np.empty(0, np.int64)]
    for tree, (reached, parents) in zip(trees, found, strict=True):
        table = tree.table
        sizes = np.where(reached.shown, (table.proxies + table.residents)[reached.nodes], 0)
        below = np.zeros(len(parents), np.int64)
        np.add.at(below, parents[parents >= 0], sizes[parents >= 0])
        refined = reached.errors > error
        base += int(sizes[parents < 0].sum())
        errors.append(reached.errors[refined])
        added.append((below - table.proxies[reached.nodes])[refined])
    limit, splats = _limit(np.concatenate(errors), base, np.concatenate(added), error, budget)
    kept = tuple(reached.keeping(reached.above > limit) for reached, _ in found)
    return Cut(kept, limit, splats)


def _limit(errors: F64, base: int, added: I64, error: float, budget: int) -> tuple[float, int]:
    """Return the error above which nodes are refined under a budget, and the number of splats.

    Nodes with equal errors are refined together.

    Args:
        errors: Errors of the nodes that would be refined without a budget.
        base: Number of splats of the roots.
        added: Number of splats that refining each node adds.
    """
    order = np.argsort(-errors, kind="stable")
    ranked, counts = errors[order], base + np.cumsum(added[order])
    if budget and len(ranked) and counts[-1] > budget:
        # refining may also take splats out of the window: the last fit counts, not the first misfit
        ends = np.append(ranked[1:] < ranked[:-1], True)  # of nodes with equal errors
        fits = np.flatnonzero(ends & ((counts <= budget) | np.isinf(ranked)))
        first = int(fits[-1]) + 1 if len(fits) else 0
        error = float(ranked[first]) if first < len(ranked) else error
    kept = int(np.count_nonzero(ranked > error))
    return error, int(counts[kept - 1]) if kept else base


def _reached(tree: TreeView, screens: Sequence[Screen], error: float) -> tuple[Reached, I64]:
    """Return the nodes that are reached without a budget, level by level, and the row of each
    one's parent, -1 for a root."""
    table = tree.table
    measures = [
        NodeMeasure(table, screen, placed, tree.tangential)
        for screen, placed in zip(screens, tree.transforms, strict=True)
    ]
    can_refine = table.child_count > 0
    can_refine[list(tree.closed)] = False
    m = tree.transforms.shape[1]
    instances, nodes = np.arange(m), np.zeros(m, np.int64)
    above, parents = np.full(m, np.inf), np.full(m, -1)
    levels: list[Reached] = []
    links, first = [], 0
    while len(nodes):
        errors = np.zeros(len(nodes))
        shown, seen = np.zeros(len(nodes), np.bool_), np.zeros(len(nodes), np.bool_)
        for measure in measures:
            measured, in_any, in_window = measure.of(instances, nodes)
            errors = np.maximum(errors, np.nan_to_num(np.where(in_any, measured, 0), posinf=np.inf))
            shown |= in_any
            seen |= in_window
        errors = np.where(can_refine[nodes], np.minimum(errors, above), 0)
        levels.append(Reached(instances, nodes, errors, above, seen, shown))
        links.append(parents)
        rows = np.flatnonzero(errors > error)
        counts = table.child_count[nodes[rows]].astype(np.int64)
        offsets = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        parents = np.repeat(first + rows, counts)
        above = np.repeat(errors[rows], counts)
        first += len(nodes)
        instances = np.repeat(instances[rows], counts)
        nodes = np.repeat(table.first_child[nodes[rows]], counts) + offsets
    names = ("instances", "nodes", "errors", "above", "seen", "shown")
    joined = (np.concatenate([getattr(each, name) for each in levels]) for name in names)
    return Reached(*joined), np.concatenate(links)
