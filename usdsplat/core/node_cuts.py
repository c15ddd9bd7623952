"""Cuts of a splat tree: a level of detail, a number of splats, or some refined nodes."""

from __future__ import annotations

import heapq
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import I32, I64
from usdsplat.core.node_table import NodeTable

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NodeCut:
    """Nodes that stand for a whole tree: each leaf is below or equal to exactly one of them."""

    nodes: I64
    """Nodes whose proxies are drawn, ascending, shape (k,)."""
    above: I64
    """Nodes that are refined, of which only the residents are drawn, ascending."""

    def rows(self, table: NodeTable) -> list[tuple[int, int, int]]:
        """Return what to read, as (chunk, first row, number of rows), in the order of chunks."""
        whole = self.nodes
        count = table.proxies[whole] + table.residents[whole]
        first = table.first_row[self.above] + table.proxies[self.above]
        found = np.stack(
            [
                np.r_[table.chunk[whole], table.chunk[self.above]].astype(np.int64),
                np.r_[table.first_row[whole], first],
                np.r_[count, table.residents[self.above]],
            ],
            axis=1,
        )
        found = found[found[:, 2] > 0]
        order = np.lexsort((found[:, 1], found[:, 0]))
        return [(chunk, first, count) for chunk, first, count in found[order].tolist()]

    def splats(self, table: NodeTable) -> int:
        """Return the number of splats that are drawn."""
        proxies = table.proxies[self.nodes].sum() + table.residents[self.nodes].sum()
        return int(proxies + table.residents[self.above].sum())


def heights(table: NodeTable) -> I32:
    """Return the largest number of levels below each node, shape (n,); 0 for a leaf."""
    parents, found = table.parents(), np.zeros(len(table), np.int32)
    for start, end in reversed(table.levels()[1:]):
        np.maximum.at(found, parents[start:end], found[start:end] + 1)
    return found


def level_cut(table: NodeTable, level: int) -> NodeCut:
    """Return the cut at a level: the topmost nodes with at most `level` levels below them.

    Args:
        table: A valid table.
        level: 0 for the leaves. Levels above the root's give the root.
    """
    stops = (heights(table) <= level) & np.isfinite(table.errors)
    stops |= table.child_count == 0
    return _first(table, stops)


def fixed_at(table: NodeTable, level: int) -> NodeTable:
    """Return a table from which every view chooses the cut at a level.

    The errors are infinite for the nodes above the cut, and 0 for all others, so the table is not
    one that a stage can have.

    Args:
        table: A valid table.
        level: As for `level_cut`.
    """
    errors = np.zeros(len(table), np.float32)
    errors[level_cut(table, level).above] = np.inf
    return replace(table, errors=errors)


def budget_cut(table: NodeTable, most: int) -> NodeCut:
    """Return the cut of at most `most` splats that refines the nodes of the largest errors first.

    Nodes without proxies are always refined, and a node whose children do not fit is not. If there
    is no cut with so few splats, the coarsest is returned.

    Args:
        table: A valid table.
        most: Number of splats.
    """
    refined = ~np.isfinite(table.errors)
    coarse = _first(table, ~refined)
    total = coarse.splats(table)
    waiting = [(-float(table.errors[node]), int(node)) for node in coarse.nodes]
    heapq.heapify(waiting)
    while waiting:
        _, node = heapq.heappop(waiting)
        first, count = int(table.first_child[node]), int(table.child_count[node])
        if not count:
            continue
        children = _first_below(table, ~refined, range(first, first + count))
        more = children.splats(table) - int(table.proxies[node])
        if total + more > most:
            continue
        total += more
        refined[node] = True
        for child in children.nodes.tolist():
            heapq.heappush(waiting, (-float(table.errors[child]), child))
    return _first(table, ~refined)


def refined_cut(table: NodeTable, refined: Bools) -> NodeCut:
    """Return the cut in which given nodes are refined, and all nodes without proxies.

    Args:
        table: A valid table.
        refined: Whether each node is refined if all nodes above it are, shape (n,).
    """
    return _first(table, ~(refined | ~np.isfinite(table.errors)))


def _first(table: NodeTable, stops: Bools) -> NodeCut:
    """Return the cut at the first node with `stops` on each way from the root down."""
    ends, parents = stops | (table.child_count == 0), table.parents()
    reached = np.ones(len(table), np.bool_)
    for start, end in table.levels()[1:]:
        above = parents[start:end]
        reached[start:end] = reached[above] & ~ends[above]
    return NodeCut(nodes=np.flatnonzero(reached & ends), above=np.flatnonzero(reached & ~ends))


def _first_below(table: NodeTable, stops: Bools, roots: range) -> NodeCut:
    """Return the cut below some nodes, as `_first` does. The work is proportional to the cut."""
    nodes: list[int] = []
    above: list[int] = []
    waiting = list(roots)
    for node in waiting:
        count = int(table.child_count[node])
        if stops[node] or not count:
            nodes.append(node)
            continue
        above.append(node)
        first = int(table.first_child[node])
        waiting.extend(range(first, first + count))
    return NodeCut(nodes=np.array(sorted(nodes), np.int64), above=np.array(sorted(above), np.int64))
