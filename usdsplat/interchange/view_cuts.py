"""Choose the nodes of splat trees that a picture of a view draws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from usdsplat.core.cloud import F64, I64
from usdsplat.core.node_cuts import NodeCut, refined_cut
from usdsplat.core.node_table import NodeTable
from usdsplat.interchange.tree_reading import ViewChoice
from usdsplat.schema.tree import Tree


def view_cuts(
    trees: Sequence[tuple[Tree, F64]], choice: ViewChoice, *, beside: int
) -> list[tuple[NodeCut, ...]]:
    """Return the cut of each instance of each tree, all instances that are equally refined with the
    same object.

    Args:
        trees: Each tree, and the matrices from local to world space of its instances, for column
            vectors, shape (k, 4, 4).
        choice: The view, and its limits.
        beside: Number of splats of fields, which take their part of the budget.
    """
    from usdsplat.render.lod.cut import TreeView, choose  # they load Numba
    from usdsplat.render.lod.placing import Placing
    from usdsplat.render.screen import Screen

    views = [
        TreeView(
            table=tree.table,
            placings=(Placing(to_world),),
            tangential=tree.drawing.projection_mode == "tangential",
        )
        for tree, to_world in trees
    ]
    budget = max(1, choice.budget - beside) if choice.budget else 0
    cut = choose(views, [Screen.of(choice.view)], error=choice.error, budget=budget)
    found = []
    for (tree, to_world), reached in zip(trees, cut.trees, strict=True):
        drawn = reached.above_error(cut.limit)
        refined = drawn.instances[drawn.refined], drawn.nodes[drawn.refined]
        found.append(tuple(_cuts(tree.table, len(to_world), *refined)))
    return found


def _cuts(table: NodeTable, count: int, instances: I64, nodes: I64) -> Iterator[NodeCut]:
    """Yield the cut of each instance, in order.

    Args:
        table: Nodes of the tree.
        count: Number of instances.
        instances: Instance of each pair, shape (p,).
        nodes: Node that is refined in it, shape (p,).
    """
    order = np.lexsort((nodes, instances))
    ends = np.searchsorted(instances[order], np.arange(1, count))
    known: dict[bytes, NodeCut] = {}
    for rows in np.split(nodes[order], ends):
        key = rows.tobytes()
        if key not in known:
            refined = np.zeros(len(table), np.bool_)
            refined[rows] = True
            known[key] = refined_cut(table, refined)
        yield known[key]
