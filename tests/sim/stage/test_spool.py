"""Tests of matching rows of splats from frame to frame."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.core.cloud import I64
from usdsplat.sim.stage.spool import forward, match, union


def ids(*values: int) -> I64:
    return np.array(values, np.int64)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (ids(1, 2, 5), ids(2, 5, 9)),
        (ids(1, 2), ids()),
        (ids(), ids(3)),
        (ids(1), ids(2, 3, 4)),
        (ids(7, 8, 9), ids(1, 7, 8, 9)),
    ],
    ids=str,
)
def test_rows_are_matched_by_identity(first: I64, second: I64) -> None:
    """Oracle: a dictionary."""
    where = {int(each): row for row, each in enumerate(second)}
    rows = match(first, second)
    assert rows is not None
    assert rows.tolist() == [where.get(int(each), -1) for each in first]


def test_the_same_rows_need_no_match() -> None:
    """Oracle: None says so."""
    assert match(ids(1, 4), ids(1, 4)) is None


def test_velocities_lead_to_the_next_frame_or_nowhere() -> None:
    """Oracle: distance by time; splats that die do not move."""
    old = np.array([[0, 0, 0], [1, 1, 1]], np.float32)
    new = np.array([[9, 9, 9], [0, 2, 0]], np.float32)
    found = forward(old, new, ids(1, -1), 24.0)
    np.testing.assert_array_equal(found, [[0, 48, 0], [0, 0, 0]])


def test_a_union_holds_both() -> None:
    """Oracle: by hand."""
    first = np.array([[0, 0, 0], [1, 1, 1]], np.float32)
    second = np.array([[-1, 0.5, 0], [0, 2, 0.5]], np.float32)
    np.testing.assert_array_equal(union(first, second), [[-1, 0, 0], [1, 2, 1]])
    assert union(first, None) is first
