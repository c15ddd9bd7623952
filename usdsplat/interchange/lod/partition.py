"""Divide splats that are sorted along the Morton curve into the nodes of a tree.

A node is a range of the sorted splats. It is divided where a plane of the octree crosses the range,
as coarse a plane as leaves a quarter of the splats on either side, and both parts once more. Nodes
are therefore compact, nearly equal in size, and none is tiny. The result depends only on the sorted
splats, not on the runs that they are in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import I64
from usdsplat.core.morton import KEY_BITS

LEAST_PART = 4
"""A part of a range has at least 1 / LEAST_PART of its splats."""

_ALL = 1 << (3 * KEY_BITS)
_EDGE_BITS = 8  # planes tested at a time


class SortedRuns(Protocol):
    """Runs of sorted Morton keys."""

    counts: I64
    """Number of splats of each run, shape (r,)."""

    def below(self, edges: npt.NDArray[np.uint64]) -> I64:
        """Return the number of keys of each run that are below each edge, shape (r, e)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Span:
    """Range of the sorted splats: rows `first` to `last` of each run, with keys from `low` to below
    `high`."""

    first: I64
    last: I64
    low: int
    high: int

    @property
    def count(self) -> int:
        """Number of splats."""
        return int(self.last.sum() - self.first.sum())


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Branch:
    """A node of the tree with the nodes below it."""

    span: Span
    children: tuple[Branch, ...] = ()

    def breadth_first(self) -> list[Branch]:
        """Return this node and all below it, level by level."""
        found = [self]
        for branch in found:
            found.extend(branch.children)
        return found


def partition(runs: SortedRuns, most: int) -> Branch:
    """Return the tree of all splats, with at most `most` in a leaf and 2 to 4 children of a node.

    A leaf beside inner nodes gets a node of its own above it, of which it is the only child. Their
    parent has a much larger error than a leaf's own would be: without that node, the splats of the
    leaf would be drawn from so far that they are too dense.
    """
    counts = runs.counts
    return _branch(runs, Span(first=np.zeros_like(counts), last=counts, low=0, high=_ALL), most)


def _branch(runs: SortedRuns, span: Span, most: int) -> Branch:
    """Return the tree of a range."""
    if span.count <= most:
        return Branch(span=span)
    parts: list[Span] = []
    for half in halves(runs, span):
        parts.extend(halves(runs, half) if half.count > most else (half,))
    children = [_branch(runs, part, most) for part in parts]
    if any(child.children for child in children):
        children = [
            child if child.children else Branch(span=child.span, children=(child,))
            for child in children
        ]
    return Branch(span=span, children=tuple(children))


def halves(runs: SortedRuns, span: Span) -> tuple[Span, Span]:
    """Divide a range of at least two splats in two, each with at least a quarter of them."""
    count = span.count
    least = max(1, count // LEAST_PART)
    most = count - least
    low, high = span.low, span.high
    while high - low > 1:
        step = 1 << max(0, (high - low - 1).bit_length() - _EDGE_BITS)
        edges = np.arange((low // step + 1) * step, high, step, dtype=np.uint64)
        rows = np.clip(runs.below(edges), span.first[:, None], span.last[:, None])
        ranks = rows.sum(axis=0) - span.first.sum()
        fitting = np.flatnonzero((ranks >= least) & (ranks <= most))
        if len(fitting):
            best = fitting[_coarsest(edges[fitting], np.abs(2 * ranks[fitting] - count))]
            return _cut(span, rows[:, best], int(edges[best]), int(edges[best]))
        after = int(np.searchsorted(ranks, least))  # the first plane with too many before it
        low, high = (
            int(edges[after - 1]) if after else low,
            int(edges[after]) if after < len(edges) else high,
        )
    # All splats in the middle have one key; those of earlier runs and rows come first.
    ends = np.array([low, high], np.uint64)
    before, until = np.clip(runs.below(ends), span.first[:, None], span.last[:, None]).T
    wanted = count // 2 - int(before.sum() - span.first.sum())
    equal = until - before
    taken = np.clip(wanted - (np.cumsum(equal) - equal), 0, equal)
    return _cut(span, before + taken, high, low)


def _coarsest(edges: npt.NDArray[np.uint64], unevenness: I64) -> int:
    """Return the index of the plane of the highest level; of several, of the one nearest to the
    middle."""
    level = edges & (~edges + np.uint64(1))  # the lowest bit that is set
    order = np.lexsort((unevenness, -level.astype(np.int64)))
    return int(order[0])


def _cut(span: Span, rows: I64, high: int, low: int) -> tuple[Span, Span]:
    """Return the parts of a range before and from `rows`; `high` and `low` are bounds of keys."""
    return (
        Span(first=span.first, last=rows, low=span.low, high=high),
        Span(first=rows, last=span.last, low=low, high=span.high),
    )
