"""Tests of cuts that depend on no view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.trees import little_table
from usdsplat.core.node_cuts import NodeCut, budget_cut, heights, level_cut
from usdsplat.core.node_table import NodeTable, check_nodes


def uneven() -> NodeTable:
    """A root without proxies; one child is a leaf, the other has two leaves and a resident."""
    return NodeTable(
        low=np.zeros((5, 3), np.float32),
        high=np.ones((5, 3), np.float32),
        errors=np.float32([np.inf, 0, 0.5, 0, 0]),
        first_child=np.int32([1, 0, 3, 0, 0]),
        child_count=np.int32([2, 0, 2, 0, 0]),
        chunk=np.int32([0, 1, 1, 2, 2]),
        first_row=np.int64([7, 0, 100, 0, 50]),
        proxies=np.int64([0, 100, 20, 50, 30]),
        residents=np.int64([2, 0, 1, 0, 0]),
    )


def random_table(rng: np.random.Generator, nodes: int) -> NodeTable:
    """A valid table of about so many nodes, each with no or several children."""
    counts, total = [], 1
    while len(counts) < total:
        most = nodes - total
        children = int(rng.integers(1, 5)) if most > 0 and (rng.random() < 0.5 or not counts) else 0
        counts.append(children)
        total += children
    counts_array = np.int32(counts)
    first = (1 + np.cumsum(counts_array) - counts_array) * (counts_array > 0)
    rows = rng.integers(1, 50, (2, total))
    table = NodeTable(
        low=np.zeros((total, 3), np.float32),
        high=np.ones((total, 3), np.float32),
        errors=np.zeros(total, np.float32),
        first_child=first.astype(np.int32),
        child_count=counts_array,
        chunk=np.zeros(total, np.int32),
        first_row=(np.cumsum(rows.sum(axis=0)) - rows.sum(axis=0)).astype(np.int64),
        proxies=rows[0].astype(np.int64),
        residents=rows[1].astype(np.int64),
    )
    table = replace(table, errors=(1.25 ** heights(table) * (heights(table) > 0)).astype("f4"))
    check_nodes(table, "table", chunks=1)
    return table


def leaves_below(table: NodeTable, node: int) -> list[int]:
    """The leaves at or below a node, by recursion."""
    first, count = int(table.first_child[node]), int(table.child_count[node])
    if not count:
        return [node]
    return [leaf for child in range(first, first + count) for leaf in leaves_below(table, child)]


def check_complete(table: NodeTable, cut: NodeCut) -> None:
    """Each leaf is at or below exactly one node of the cut, and all above it is refined."""
    covered = [leaf for node in cut.nodes for leaf in leaves_below(table, int(node))]
    assert sorted(covered) == np.flatnonzero(table.child_count == 0).tolist()
    parents = table.parents()
    above: set[int] = set()
    for node in cut.nodes:
        while parents[node] >= 0:
            node = parents[node]
            above.add(int(node))
    assert cut.above.tolist() == sorted(above)


def test_levels_of_a_tree_drawn_by_hand() -> None:
    """Oracle: the drawing: four leaves, two branches, a root."""
    table = little_table()
    assert heights(table).tolist() == [2, 1, 1, 0, 0, 0, 0]
    for level, nodes, above in ((0, [3, 4, 5, 6], [0, 1, 2]), (1, [1, 2], [0]), (2, [0], [])):
        cut = level_cut(table, level)
        assert (cut.nodes.tolist(), cut.above.tolist()) == (nodes, above)
    assert level_cut(table, 9).nodes.tolist() == [0]


def test_a_node_without_proxies_is_refined_at_every_level() -> None:
    """Oracle: the drawing: at the level of the root, its children stand for it."""
    table = uneven()
    check_nodes(table, "table", chunks=3)
    assert level_cut(table, 0).nodes.tolist() == [1, 3, 4]
    for level in (1, 2, 3):
        assert level_cut(table, level).nodes.tolist() == [1, 2]
        assert level_cut(table, level).above.tolist() == [0]


def test_rows_are_proxies_of_the_cut_and_residents_above() -> None:
    """Oracle: the rows written down from the table by hand."""
    table = uneven()
    cut = level_cut(table, 0)
    assert cut.rows(table) == [(0, 7, 2), (1, 0, 100), (1, 120, 1), (2, 0, 50), (2, 50, 30)]
    assert cut.splats(table) == 183
    cut = level_cut(table, 1)
    assert cut.rows(table) == [(0, 7, 2), (1, 0, 100), (1, 100, 21)]
    assert cut.splats(table) == 123


@pytest.mark.parametrize(
    ("most", "nodes"),
    [
        (10**9, [3, 4, 5, 6]),
        (160, [3, 4, 5, 6]),
        (159, [2, 3, 4]),
        (100, [2, 3, 4]),
        (99, [1, 2]),
        (40, [1, 2]),
        (39, [0]),
        (0, [0]),
    ],
)
def test_a_budget_is_filled_by_the_largest_errors(most: int, nodes: list[int]) -> None:
    """Oracle: counts by hand: root 10, branches 20 each, leaves 40 each; equal errors by index."""
    assert budget_cut(little_table(), most).nodes.tolist() == nodes


def test_a_node_that_does_not_fit_does_not_stop_others() -> None:
    """Oracle: the branch of the larger error has huge leaves; the other's fit."""
    table = little_table([400, 400, 40, 40])
    errors = np.float32([0.5, 0.2, 0.1, 0, 0, 0, 0])
    assert budget_cut(replace(table, errors=errors), 300).nodes.tolist() == [1, 5, 6]


def test_the_coarsest_cut_may_exceed_a_budget() -> None:
    """Oracle: a root without proxies, whose children must be drawn."""
    cut = budget_cut(uneven(), 5)
    assert cut.nodes.tolist() == [1, 2] and cut.splats(uneven()) == 123


def test_cuts_of_random_trees_are_complete_and_within_their_budget() -> None:
    """Oracle: leaves found by recursion, and a count of rows."""
    rng = np.random.default_rng(8)
    for _ in range(30):
        table = random_table(rng, int(rng.integers(2, 60)))
        top = int(heights(table)[0])
        counts = []
        for level in range(top + 2):
            cut = level_cut(table, level)
            check_complete(table, cut)
            assert cut.splats(table) == sum(count for _, _, count in cut.rows(table))
            counts.append(len(cut.nodes))
        assert counts == sorted(counts, reverse=True)
        for most in rng.integers(0, 3000, 5):
            cut = budget_cut(table, int(most))
            check_complete(table, cut)
            coarsest = level_cut(table, top).splats(table)
            assert cut.splats(table) <= max(int(most), coarsest)
