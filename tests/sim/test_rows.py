"""Tests of reductions over rows of a few numbers."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.sim.rows import differ, largest


@pytest.mark.parametrize("k", [1, 3, 4])
def test_they_are_reductions_of_rows(k: int) -> None:
    """Oracle: NumPy's reductions along the last axis."""
    rng = np.random.default_rng(k)
    first = rng.normal(size=(500, k)).astype(np.float32)
    first[3, 0] = np.nan
    first[4] = -np.inf
    second = np.where(rng.random((500, k)) < 0.2, first + 1, first)
    before = first.copy()
    np.testing.assert_array_equal(largest(first), first.max(axis=1))
    np.testing.assert_array_equal(differ(first, second), (first != second).any(axis=1))
    np.testing.assert_array_equal(first, before)


def test_there_may_be_no_rows() -> None:
    """Oracle: shapes."""
    none = np.empty((0, 3), np.float32)
    assert largest(none).shape == differ(none, none).shape == (0,)
