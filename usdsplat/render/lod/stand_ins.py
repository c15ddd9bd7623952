"""Coarser nodes of splat trees in place of those whose splats are not in memory."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from usdsplat.core.node_table import NodeTable
from usdsplat.render.lod.cut import Cut, Reached


def stand_ins(table: NodeTable, node: int, lost: Collection[int] = ()) -> Iterator[int]:
    """Yield the nodes above a node that have proxies and are not `lost`, from the nearest one."""
    parents = table.parents()
    above = int(parents[node])
    while above >= 0:
        if table.proxies[above] and above not in lost:
            yield above
        above = int(parents[above])


def closing(cut: Cut, tables: Sequence[NodeTable], closed: Sequence[Collection[int]]) -> Cut:
    """Return a cut in which some nodes are drawn in place of all below them, in every instance.

    The number of splats stays that of the given cut, so that a budget leaves fields as they will be
    drawn beside it.

    Args:
        cut: The finer cut.
        tables: Table of each tree.
        closed: Nodes of each tree that are not refined.
    """
    trees = zip(cut.trees, tables, closed, strict=True)
    return replace(cut, trees=tuple(_closed(*each) if each[2] else each[0] for each in trees))


def replaced_errors(reached: Reached) -> dict[int, float]:
    """Return the largest projected error [pixel] that each node replaces, that of its parent."""
    if not len(reached.nodes):
        return {}
    nodes, starts = np.unique(reached.nodes, return_index=True)  # they are sorted by node
    largest = np.maximum.reduceat(reached.above, starts)
    return dict(zip(nodes.tolist(), largest.tolist(), strict=True))


def _closed(reached: Reached, table: NodeTable, closed: Collection[int]) -> Reached:
    parents, ends = table.parents(), np.zeros(len(table), np.bool_)
    ends[list(closed)] = True
    hidden = np.zeros(len(table), np.bool_)
    for node in np.unique(reached.nodes).tolist():  # a parent comes before its children
        above = parents[node]
        hidden[node] = above >= 0 and (hidden[above] or ends[above])
    kept = reached.keeping(~hidden[reached.nodes])
    return replace(kept, errors=np.where(ends[kept.nodes], 0, kept.errors))
