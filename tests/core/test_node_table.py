"""Tests of the checks of a table of nodes."""

from __future__ import annotations

import tracemalloc
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from tests.trees import little_table
from usdsplat.core.errors import StageError
from usdsplat.core.node_table import NESTED, NodeTable, check_nodes

CHUNKS = 3
INF, NAN = float("inf"), float("nan")
COLUMNS = [field.name for field in fields(NodeTable)]


def edited(name: str, node: Any, value: Any) -> NodeTable:
    """The little table with another value of a column."""
    column = getattr(little_table(), name).copy()
    column[node] = value
    return replace(little_table(), **{name: column})


def chain(length: int) -> NodeTable:
    """A table in which every node but the last has one child, and only the last has splats."""
    zeros = np.zeros(length, np.int64)
    errors = np.full(length, INF, np.float32)
    errors[-1] = 0
    one = np.r_[np.ones(length - 1, np.int32), np.int32(0)].astype(np.int32)
    return NodeTable(
        low=np.zeros((length, 3), np.float32),
        high=np.ones((length, 3), np.float32),
        errors=errors,
        first_child=(np.arange(1, length + 1) * one).astype(np.int32),
        child_count=one,
        chunk=np.r_[np.full(length - 1, -1), 0].astype(np.int32),
        first_row=zeros,
        proxies=np.r_[zeros[1:], 9],
        residents=zeros,
    )


def test_a_valid_table_passes() -> None:
    """Oracle: the table of a tree drawn by hand, and one that is only a leaf."""
    check_nodes(little_table(), "/Tree", chunks=CHUNKS)
    check_nodes(chain(1), "/Tree", chunks=1)


def test_parents_and_levels_of_a_tree_drawn_by_hand() -> None:
    """Oracle: the drawing: a root, two branches, two leaves each."""
    assert little_table().parents().tolist() == [-1, 0, 0, 1, 1, 2, 2]
    assert little_table().levels() == [(0, 1), (1, 3), (3, 7)]
    assert chain(5).parents().tolist() == [-1, 0, 1, 2, 3]
    assert chain(3).levels() == [(0, 1), (1, 2), (2, 3)]


@pytest.mark.parametrize(
    ("name", "node", "value", "said"),
    [
        ("child_count", 0, 3, "7 children, expected 6, as there are 7 nodes"),
        ("child_count", 0, -2, "2 children, expected 6"),
        ("child_count", slice(0, 2), [1, 3], "node 1 with wrong children, expected nodes breadth"),
        ("first_child", 1, 0, "node 1 with wrong children, expected nodes breadth first"),
        ("first_child", 2, 3, "node 2 with wrong children"),
        ("first_child", 0, 2**31 - 1, "node 0 with wrong children"),
        ("first_child", 4, 2, "node 4 with no children, but a first child"),
        ("low", 3, NAN, "node 3 with a box that is not finite"),
        ("low", 3, -INF, "node 3 with a box that is not finite"),
        ("high", 3, NAN, "node 3 with a box that is not finite"),
        ("high", 5, -7, "node 5 with a box that is inside out"),
        ("high", 0, INF, "node 0 with a box that is not finite"),
        ("high", 5, 9, "node 5 beyond the box of its parent, expected nested boxes"),
        ("low", 4, -1, "node 4 beyond the box of its parent"),
        ("proxies", 6, -1, "node 6 with a negative number of splats"),
        ("residents", 1, -1, "node 1 with a negative number of splats"),
        ("proxies", 6, 2**62, "node 6 with too many splats"),
        ("residents", 6, 2**63 - 1, "node 6 with too many splats"),
        ("first_row", 2, -1, "node 2 with a row out of range"),
        ("first_row", 2, 2**63 - 1, "node 2 with a row out of range"),
        ("first_row", 2, 19, "node 2 with rows of chunk 1 that another node has"),
        ("residents", 3, 1, "node 4 with rows of chunk 2 that another node has"),
        ("chunk", 0, 1, "rows of chunk 1 that another node has, expected rows of its own"),
        ("errors", 1, NAN, "node 1 with an error that is no length"),
        ("errors", 1, -1, "node 1 with an error that is no length"),
        ("errors", 3, 0.01, "node 3 with children missing, but an error above 0"),
        ("errors", 0, 0, "node 0 with children, but the error 0"),
        ("errors", 0, 0.12, "node 1 with the error 0.1, expected at most 1/1.25 of its parent's"),
        ("errors", 1, INF, "node 1 with the error inf, expected at most 1/1.25"),
        ("proxies", 1, 0, "node 1 with children and no proxies"),
        ("chunk", 0, 3, "node 0 with a chunk beyond the 3 that are"),
        ("chunk", 0, -2, "node 0 with a chunk beyond the 3 that are"),
        ("chunk", 3, -1, "node 3 with splats, but no chunk"),
    ],
)
def test_one_wrong_number_is_one_sentence(name: str, node: Any, value: Any, said: str) -> None:
    """Oracle: the number that was changed in a valid table."""
    with pytest.raises(StageError, match=r"^/Tree: found ") as raised:
        check_nodes(edited(name, node, value), "/Tree", chunks=CHUNKS)
    assert said in str(raised.value)


@pytest.mark.parametrize("name", COLUMNS)
def test_columns_of_other_lengths_are_one_sentence(name: str) -> None:
    """Oracle: a column without its last row, and one with another number of axes."""
    whole = getattr(little_table(), name)
    for wrong in (whole[:-1], whole[:, None], np.empty(0, whole.dtype)):
        with pytest.raises(StageError, match=r"of shape \("):
            check_nodes(replace(little_table(), **{name: wrong}), "/Tree", chunks=CHUNKS)


def test_no_nodes_are_one_sentence() -> None:
    """Oracle: a table of empty columns."""
    columns = {name: getattr(little_table(), name)[:0] for name in COLUMNS}
    with pytest.raises(StageError, match="found no nodes, expected at least one"):
        check_nodes(NodeTable(**columns), "/Tree", chunks=CHUNKS)


def test_cyclic_children_are_one_sentence() -> None:
    """Oracle: a node that is its own child, and two that are each other's."""
    for first, counts in (([0, 0, 0], [1, 1, 0]), ([2, 0, 1], [0, 1, 1])):
        table = replace(chain(3), first_child=np.int32(first), child_count=np.int32(counts))
        with pytest.raises(StageError, match=r"wrong children|no children"):
            check_nodes(table, "/Tree", chunks=1)


def test_an_error_is_nested_up_to_rounding() -> None:
    """Oracle: a ratio of exactly NESTED in single precision."""
    table = edited("errors", slice(0, 3), np.float32([0.1 * NESTED, 0.1, 0.1]))
    check_nodes(table, "/Tree", chunks=CHUNKS)


def test_boxes_at_the_limits_of_single_precision_are_compared() -> None:
    """Oracle: differences that overflow in single precision."""
    wide = replace(little_table(), low=np.full((7, 3), -3e38, np.float32))
    wide = replace(wide, high=np.full((7, 3), 3e38, np.float32))
    check_nodes(wide, "/Tree", chunks=CHUNKS)
    wide.low[0] = 3e38
    with pytest.raises(StageError, match="node 1 beyond the box of its parent"):
        check_nodes(wide, "/Tree", chunks=CHUNKS)


def test_a_table_of_a_million_nodes_in_one_chain_takes_memory_of_its_size() -> None:
    """Oracle: the bytes that Python and NumPy allocated."""
    table = chain(1_000_000)
    size = sum(getattr(table, name).nbytes for name in COLUMNS)
    tracemalloc.start()
    with pytest.raises(StageError, match="found more than 64 levels"):
        check_nodes(table, "/Tree", chunks=1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 * size


def test_random_mutations_are_a_valid_table_or_one_sentence() -> None:
    """Oracle: `walk`, which follows the children of an accepted table one by one."""
    rng = np.random.default_rng(17)
    extremes = [0, 1, 2, 5, -1, 2**31 - 1, -(2**31), 2**62, 2**63 - 1, NAN, INF, -INF, 1e-30, 3e38]
    accepted = 0
    tracemalloc.start()
    for _ in range(200):
        table = little_table()
        for _ in range(rng.integers(1, 4)):
            column = getattr(table, COLUMNS[rng.integers(len(COLUMNS))])
            with np.errstate(all="ignore"):
                value = np.float64(extremes[rng.integers(len(extremes))])
                if column.dtype.kind == "i":
                    value = np.clip(np.nan_to_num(value), -(2.0**62), 2.0**62)
                column.flat[rng.integers(column.size)] = value.astype(column.dtype)
        try:
            check_nodes(table, "/Tree", chunks=CHUNKS)
        except StageError as error:
            assert "\n" not in str(error) and "expected" in str(error)
        else:
            accepted += 1
            walk(table)
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()
    assert 5 < accepted < 150


def walk(table: NodeTable) -> None:
    """Assert that every node is reached once from the root, inside its parent, in its own rows."""
    seen: list[int] = []
    rows: list[tuple[int, int, int]] = []
    waiting = [0]
    while waiting:
        node = waiting.pop(0)
        seen.append(node)
        first, count = int(table.first_row[node]), int(table.proxies[node] + table.residents[node])
        own = (int(table.chunk[node]), first, first + count)
        for chunk, start, end in rows:
            assert chunk != own[0] or not count or end <= own[1] or start >= own[2]
        rows += [own] if count else []
        for child in range(table.child_count[node]):
            each = int(table.first_child[node]) + child
            size = float((table.high[node] - table.low[node]).max())
            assert (table.low[each] >= table.low[node] - 1e-4 * size).all()
            assert (table.high[each] <= table.high[node] + 1e-4 * size).all()
            assert table.errors[node] >= 1.2499 * table.errors[each]
            waiting.append(each)
    assert seen == list(range(len(table)))


def test_the_least_splats_of_a_tree_drawn_by_hand() -> None:
    """Oracle: by hand. The second branch has more proxies than its leaves and residents."""
    table = edited("proxies", slice(None), [50, 9, 30, 4, 4, 10, 11])
    table.residents[:] = [3, 0, 2, 0, 0, 0, 0]
    assert table.sizes.tolist() == [53, 9, 32, 4, 4, 10, 11]
    assert table.least.tolist() == [3 + 8 + 23, 8, 2 + 21, 4, 4, 10, 11]
