"""Tests of coincident points."""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.points.coincident import coincident


def test_points_at_one_place_follow_each_other() -> None:
    """Oracle: places as Python's tuples, counted one after the other; -0 is 0."""
    random = np.random.default_rng(0)
    points = random.integers(-1, 3, (500, 3)).astype(np.float32)
    points[::7] *= np.float32(-0.0)
    order, ranks = coincident(points)
    assert sorted(order.tolist()) == list(range(500))
    before: dict[tuple[float, ...], list[int]] = {}
    previous = None
    for row, rank in zip(order.tolist(), ranks.tolist(), strict=True):
        place = tuple(points[row].tolist())
        rows = before.setdefault(place, [])
        assert rank == len(rows) and (rank == 0 or previous == place)
        assert rows == sorted(rows) and (not rows or row > rows[-1])
        rows.append(row)
        previous = place
    assert len(before) < 100


def test_no_points_are_nowhere() -> None:
    """Oracle: closed form."""
    order, ranks = coincident(np.empty((0, 3), np.float32))
    assert order.shape == ranks.shape == (0,)
