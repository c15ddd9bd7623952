"""Choose the nodes of splat trees that a picture draws.

A cut has, below each root, every leaf under exactly one of its nodes. Nodes are refined, the
largest projected error first, across all trees, instances and samples of a picture, until no error
exceeds the limit or the budget of splats is full. A node is refined with all of its children, so a
cut is complete however small the budget is.

Errors only become smaller from a node to its children, so a cut is given by one number: the nodes
with larger errors are refined. A node whose error is between the limit and FADE times the limit is
faded into its children while a camera approaches. Each sample of a picture has a part of this
range, in which it draws both with weights, see `kernels.fading`; below it, it draws the node only,
and above it the children only. So at most one sample mixes a node with its children. Weights grow
with the error, so those of a node and of all below it that are drawn add up to one, also where
three levels are faded at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from usdsplat.core.cloud import F64, I64
from usdsplat.core.node_table import NodeTable
from usdsplat.render.lod.measure import Bools, NodeMeasure
from usdsplat.render.lod.placing import Placing
from usdsplat.render.screen import Screen

FADE = 1.5
"""Ratio of the errors at which a node begins and ends to be drawn. The wider, the less a picture
changes at once; but nodes are then drawn with larger errors, and beside their children for longer.
Measured on a camera that goes back, see docs/performance.md."""
RAMP = 2.0
"""Logarithm of the ratio of the speeds at which children are faded in at the end and at the
beginning. Many layers of fine splats lie over each other, and cover a pixel at small weights."""
STEP = 32
"""Least number of nodes that are refined at once: fewer take as long."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TreeView:
    """A tree as the samples of a picture see it."""

    table: NodeTable
    placings: tuple[Placing, ...]
    """The instances in each of k samples."""
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

    def keeping(self, which: Bools | I64) -> Reached:
        """Return some of the nodes, by a mask or by their rows."""
        return Reached(*(getattr(self, each.name)[which] for each in fields(self)))


NONE_REACHED = Reached(
    np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty(0),
    np.empty(0, np.bool_), np.empty(0, np.bool_),
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
        """Return the error [pixel] of a node at a point of its fade: 0 where it is drawn itself, 1
        where only its children are drawn."""
        return float(self.limit * FADE**fade)

    def refined(self, errors: F64, fade: tuple[float, float]) -> F64:
        """Return the weights in [0, 1] with which a sample draws the children of nodes.

        Args:
            errors: Projected errors of the nodes [pixel], which may be infinite.
            fade: See `Sample.fade`. Nodes are refined at once if its ends are equal.
        """
        begin, end = map(self.error_at, fade)
        if end <= begin:
            return (errors > begin).astype(np.float64)
        within = np.clip(errors, begin, end)
        part = np.log(within / begin) / math.log(end / begin)
        return np.asarray(np.expm1(RAMP * part) / math.expm1(RAMP), np.float64)

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

    The work is proportional to the cut, not to the nodes that a larger budget would reach.

    Args:
        trees: Their placings are one for each screen.
        screens: Projections of the samples, which share the data window.
        error: Largest projected error of a node that is not refined [pixel].
        budget: Maximum number of splats in the windows; 0 for any. The roots, and nodes below them
            that have no proxies, are drawn even if they are more.
    """
    searches = [_Search(tree, screens, error) for tree in trees]
    while (step := _next_step(searches, error, budget)) is not None:
        for search in searches:
            search.refine(step)
    errors = np.concatenate([np.empty(0), *(each.errors for each in searches)])
    added = np.concatenate([np.empty(0, np.int64), *(each.added for each in searches)])
    base = sum(each.base for each in searches)
    following = max((each.open.errors.max(initial=error) for each in searches), default=error)
    limit, splats = _limit(errors, base, added, float(following), budget)
    return Cut(tuple(each.reached(limit) for each in searches), limit, splats)


def _next_step(searches: Sequence[_Search], error: float, budget: int) -> float | None:
    """Return the error above which nodes are refined next; None if no further cut fits.

    It is estimated to fill the budget, as the number of splats of a surface is inverse to the
    square of their size. At least a quarter of the nodes is refined, so that there are few steps. A
    step that is too large costs time only.
    """
    errors = np.concatenate([np.empty(0), *(each.open.errors for each in searches)])
    if not len(errors) or not budget:
        return error if len(errors) else None
    sizes = np.concatenate([each.open_sizes() for each in searches])
    order = np.argsort(-errors, kind="stable")
    ranked, sizes = errors[order], sizes[order]
    if np.isinf(ranked[0]):
        return np.finfo(np.float64).max
    if sum(each.least for each in searches) > budget:
        return None
    room = budget - sum(each.splats for each in searches) + sizes.sum()
    finer = np.cumsum(sizes * ranked**2)
    expected = finer / ranked**2 + sizes.sum() - np.cumsum(sizes)
    last = max(int(np.searchsorted(expected, room)), len(ranked) // 4, STEP)
    if last < len(ranked):
        least = ranked[last]
    else:
        least = min(ranked[-1], math.sqrt(finer[-1] / max(room, 1)))
    return max(error, float(np.nextafter(least, 0)))


def _limit(errors: F64, base: int, added: I64, following: float, budget: int) -> tuple[float, int]:
    """Return the error above which nodes are refined under a budget, and the number of splats.

    Nodes with equal errors are refined together.

    Args:
        errors: Errors of the nodes that may be refined.
        base: Number of splats of the roots.
        added: Number of splats that refining each node adds.
        following: The largest error of the other nodes.
    """
    order = np.argsort(-errors, kind="stable")
    ranked, counts = errors[order], base + np.cumsum(added[order])
    kept = len(ranked)
    if budget and kept and counts[-1] > budget:
        # refining may also take splats out of the window: the last fit counts, not the first misfit
        ends = np.append(ranked[1:] < ranked[:-1], True)  # of nodes with equal errors
        fits = np.flatnonzero(ends & ((counts <= budget) | np.isinf(ranked)))
        kept = int(fits[-1]) + 1 if len(fits) else 0
    limit = float(ranked[kept]) if kept < len(ranked) else following
    return limit, int(counts[kept - 1]) if kept else base


class _Search:
    """The nodes of one tree that are reached by refining the largest errors first.

    Args:
        tree: The tree.
        screens: Projections of the samples.
        error: Nodes without a larger one [pixel] are never refined.
    """

    def __init__(self, tree: TreeView, screens: Sequence[Screen], error: float) -> None:
        self._table, self._error = tree.table, error
        self._measures = [
            NodeMeasure(tree.table, screen, placing, tree.tangential)
            for screen, placing in zip(screens, tree.placings, strict=True)
        ]
        self._can_refine = tree.table.child_count > 0
        self._can_refine[list(tree.closed)] = False
        self._reached = [NONE_REACHED]
        self._floors = np.empty(0, np.int64)
        """Least number of visible splats in place of each node of `open`."""
        self._settled = 0
        """Number of visible splats that are drawn whichever nodes of `open` are refined."""
        self.open = NONE_REACHED
        """The nodes that may be refined next."""
        self.errors = np.empty(0)
        """Errors of the nodes that are refined [pixel]."""
        self.added = np.empty(0, np.int64)
        """Number of visible splats that refining each of them adds."""
        m = len(tree.placings[0].transforms)
        roots = self._reach(np.arange(m), np.zeros(m, np.int64), np.full(m, np.inf))
        self.base = int(roots.sum())
        """Number of visible splats of the roots."""

    @property
    def least(self) -> int:
        """Least number of visible splats of a cut that refines all nodes of `errors`."""
        return self._settled + int(self._floors.sum())

    @property
    def splats(self) -> int:
        """Number of visible splats of the cut that refines no others."""
        return self.base + int(self.added.sum())

    def open_sizes(self) -> I64:
        """Return the number of splats of each node of `open`."""
        return self._table.sizes[self.open.nodes]

    def refine(self, error: float) -> None:
        """Refine the nodes with larger errors, and of their children those with larger errors."""
        table = self._table
        while (which := self.open.errors > error).any():
            parents = self.open.keeping(which)
            self.open, self._floors = self.open.keeping(~which), self._floors[~which]
            counts = table.child_count[parents.nodes].astype(np.int64)
            starts = np.cumsum(counts) - counts
            offsets = np.arange(counts.sum()) - np.repeat(starts, counts)
            sizes = self._reach(
                np.repeat(parents.instances, counts),
                np.repeat(table.first_child[parents.nodes], counts) + offsets,
                np.repeat(parents.errors, counts),
            )
            added = np.add.reduceat(sizes, starts) - table.proxies[parents.nodes]
            self.errors = np.concatenate([self.errors, parents.errors])
            self.added = np.concatenate([self.added, added])
            self._settled += int(table.residents[parents.nodes].sum())

    def reached(self, limit: float) -> Reached:
        """Return the nodes that refining above the error `limit` reaches, by node, then
        instance."""
        found = _joined(self._reached)
        found = found.keeping(found.above > limit)
        return found.keeping(np.lexsort((found.instances, found.nodes)))

    def _reach(self, instances: I64, nodes: I64, above: F64) -> I64:
        """Measure nodes, and return the number of splats of each that can be seen."""
        errors = np.zeros(len(nodes))
        shown, seen, inside = (np.zeros(len(nodes), np.bool_) for _ in range(3))
        for measure in self._measures:
            found = measure.of(instances, nodes)
            errors = np.maximum(errors, found.errors)
            shown |= found.shown
            seen |= found.in_window
            inside |= found.inside
        errors = np.where(self._can_refine[nodes], np.minimum(errors, above), 0)
        reached = Reached(instances, nodes, errors, above, seen, shown)
        self._reached.append(reached)
        sizes = np.where(shown, self._table.sizes[nodes], 0)
        waits = errors > self._error
        self._settled += int(sizes[~waits].sum())
        floors = np.where(inside, self._table.least[nodes], self._table.residents[nodes])
        self._floors = np.concatenate([self._floors, floors[waits]])
        self.open = _joined([self.open, reached.keeping(waits)])
        return sizes


def _joined(parts: Sequence[Reached]) -> Reached:
    """Return the nodes of several parts."""
    names = (each.name for each in fields(Reached))
    return Reached(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
