"""Tests of the table of a tree."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from usdsplat.core.node_table import NESTED, NodeTable, check_nodes, nested
from usdsplat.interchange.lod.measuring import splats_below

# 0 -> 1, 2; 1 -> 3, 4; 4 -> 5
FIRST, COUNT = [1, 3, 0, 0, 5, 0], [2, 2, 0, 0, 1, 0]


def table():
    """A tree of six nodes."""
    return NodeTable(
        low=np.zeros((6, 3), np.float32),
        high=np.ones((6, 3), np.float32),
        errors=np.zeros(6, np.float32),
        first_child=np.array(FIRST, np.int32),
        child_count=np.array(COUNT, np.int32),
        chunk=np.zeros(6, np.int32),
        first_row=np.cumsum([0, 1, 2, 4, 8, 16]),
        proxies=np.array([1, 2, 4, 8, 16, 32]),
        residents=np.zeros(6, np.int64),
    )


def test_splats_below_are_those_of_leaves():
    """Oracle: closed form: leaves have 4, 8 and 32."""
    assert splats_below(table()).tolist() == [44, 40, 4, 8, 32, 32]


def test_nested_errors_are_raised_where_they_must_be():
    """Oracle: closed form, and `check_nodes`."""
    found = nested(np.array([9.0, 1.0, 0, 0, 2.0, 0]), table())
    assert found.tolist() == [9.0, np.float32(NESTED * (1 + 1e-6) * 2), 0, 0, 2.0, 0]
    flat = nested(np.zeros(6), table())
    assert (flat[[0, 1, 4]] > 0).all() and (flat[[2, 3, 5]] == 0).all()
    for errors in (found, flat):
        whole = table()
        values = {each.name: getattr(whole, each.name) for each in fields(NodeTable)}
        check_nodes(NodeTable(**{**values, "errors": errors}), "tree", chunks=1)
