"""Tests of neighbour lists, and of how long they stay valid."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.kernels.devices import open_device
from usdsplat.sim.neighbors import Neighbors
from usdsplat.sim.parameters import NeighborsParameters

N = 3000
EXACT = NeighborsParameters(skin=0.0, k_max=512)


def points(n=N, seed=1, size=3.0):
    """White noise in a box about the origin."""
    return np.random.default_rng(seed).uniform(-size, size, (n, 3)).astype(np.float32)


def radii(n=N, seed=2, low=0.2, high=0.8):
    """Random radii."""
    return np.random.default_rng(seed).uniform(low, high, n).astype(np.float32)


def squared(positions):
    """Squared distances of all pairs in float32."""
    d = positions[None] - positions[:, None]
    return d[..., 0] * d[..., 0] + d[..., 1] * d[..., 1] + d[..., 2] * d[..., 2]


def by_rows(graph):
    """The set of neighbours of each row, as rows."""
    return [
        set(graph.order[graph.neighbors[graph.rows[s] : graph.rows[s + 1]]].tolist())
        for s in graph.rank
    ]


def brute_force(positions, support, symmetric):
    """The same, from all pairs."""
    limit = np.broadcast_to((support * support)[:, None], (len(support),) * 2)
    d2 = squared(positions)
    near = (d2 < (np.maximum(limit, limit.T) if symmetric else limit)) & (d2 > 0)
    return [set(np.flatnonzero(row).tolist()) for row in near]


@pytest.mark.parametrize("symmetric", [False, True])
@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_lists_are_those_of_all_pairs(symmetric, offset) -> None:
    """Oracle: brute force over all pairs; the table of 4096 cells is smaller than the domain."""
    positions = points() * np.array([1, 1, 30], np.float32) + np.float32(offset)
    support = radii() * 3
    search = Neighbors(open_device(), EXACT, symmetric=symmetric)
    graph = search.update(positions, support)
    expected = brute_force(positions, search.clamped(support), symmetric)
    assert by_rows(graph) == expected
    assert sum(map(len, expected)) > 3 * N
    assert graph.dropped == 0


def test_lists_ascend_and_slots_and_rows_are_inverse() -> None:
    """Oracle: closed form."""
    graph = Neighbors(open_device(), EXACT).update(points(), radii())
    for s in range(N):
        assert (np.diff(graph.neighbors[graph.rows[s] : graph.rows[s + 1]]) > 0).all()
    np.testing.assert_array_equal(graph.order[graph.rank], np.arange(N))
    np.testing.assert_array_equal(graph.positions, points()[graph.order])


@pytest.mark.parametrize("n", [N, 12_000])
def test_long_lists_keep_the_nearest(n) -> None:
    """Oracle: NumPy's stable sort by distance; the larger case overflows the buffer of hits."""
    positions, support = points(n, size=1.0), np.full(n, 0.9, np.float32)
    graph = Neighbors(open_device(), NeighborsParameters(skin=0.0, k_max=20)).update(
        positions, support
    )
    for s in range(0, n, n // 100):
        d = graph.positions - graph.positions[s]
        d2 = d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1] + d[:, 2] * d[:, 2]
        near = np.argsort(d2, kind="stable")[1:21]
        listed = graph.neighbors[graph.rows[s] : graph.rows[s + 1]]
        np.testing.assert_array_equal(listed, np.sort(near))
    assert graph.dropped == n


def test_lists_hold_all_neighbours_until_they_are_built_again() -> None:
    """Oracle: brute force at each step of a random walk; lists must both be kept and rebuilt."""
    random = np.random.default_rng(5)
    positions, support = points(1000, size=1.0), radii(1000, low=0.15, high=0.3)
    search = Neighbors(open_device(), NeighborsParameters(k_max=512))
    builds = []
    for _ in range(30):
        graph = search.update(positions, support)
        listed = by_rows(graph)
        clamped = search.clamped(support)
        assert all(
            near <= found
            for near, found in zip(brute_force(positions, clamped, False), listed, strict=True)
        )
        np.testing.assert_array_equal(graph.positions, positions[graph.order])
        builds.append(graph.build)
        positions = positions + random.normal(0, 0.0015, positions.shape).astype(np.float32)
        support = support * np.float32(1.003)
    assert 2 <= builds[-1] <= 20


def test_what_does_not_change_is_not_made_again() -> None:
    """Oracle: identity of the object."""
    search = Neighbors(open_device(), EXACT)
    positions, support = points(100), radii(100)
    graph = search.update(positions, support)
    assert search.update(positions.copy(), support.copy()) is graph


@pytest.mark.parametrize("symmetric", [False, True])
def test_a_restart_takes_the_same_decisions(symmetric) -> None:
    """Oracle: the run that was not interrupted; all arrays of all later graphs, bit for bit."""
    random = np.random.default_rng(6)
    device = open_device()
    walk = [points(2000)]
    for _ in range(12):
        walk.append(walk[-1] + random.normal(0, 0.008, walk[0].shape).astype(np.float32))
    walk[0][7] = walk[0][8]
    support = radii(2000)
    first = Neighbors(device, NeighborsParameters(), symmetric=symmetric, seed=3)
    for positions in walk[:6]:
        first.update(positions, support)
    second = Neighbors(device, NeighborsParameters(), symmetric=symmetric, seed=3)
    second.restore({key: value.copy() for key, value in first.memory().items()})
    for positions in walk[6:]:
        a, b = first.update(positions, support), second.update(positions, support)
        assert a.build == b.build
        for name in ("order", "rank", "rows", "neighbors", "positions", "support"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert first.memory()["counts"][1] > 2


def test_one_thread_and_several_find_the_same() -> None:
    """Oracle: a single thread."""
    graphs = [
        Neighbors(open_device(threads=threads), EXACT).update(points(), radii())
        for threads in (1, None)
    ]
    for name in ("order", "rows", "neighbors"):
        np.testing.assert_array_equal(getattr(graphs[0], name), getattr(graphs[1], name))


def test_coincident_points_are_separated_for_the_search_only() -> None:
    """Oracle: closed form: neighbours of each other, at most 1e-4 radii away from their place."""
    positions, support = points(500), np.full(500, 0.5, np.float32)
    positions[100:104] = positions[3]
    before = positions.copy()
    graph = Neighbors(open_device(), EXACT).update(positions, support)
    np.testing.assert_array_equal(positions, before)
    same = {3, 100, 101, 102, 103}
    listed = by_rows(graph)
    assert all(same - {i} <= listed[i] for i in same)
    moved = np.abs(graph.positions - positions[graph.order]).max(axis=1)
    assert set(graph.order[moved > 0].tolist()) == same
    assert moved.max() <= 1e-4 * 0.5 * 1.01


def test_what_is_not_finite_has_no_neighbours() -> None:
    """Oracle: the sound points alone."""
    positions, support = points(1000), radii(1000)
    bad = np.arange(0, 1000, 10)
    broken, odd = positions.copy(), support.copy()
    broken[bad[:50], 1], broken[bad[50:], 0] = np.nan, np.inf
    odd[5], odd[15] = np.nan, -1
    graph = Neighbors(open_device(), EXACT).update(broken, odd)
    listed = by_rows(graph)
    assert all(not listed[i] for i in (*bad, 5, 15))
    sound = np.setdiff1d(np.arange(1000), bad)
    alone = Neighbors(open_device(), EXACT)
    expected = by_rows(alone.update(positions[sound], odd[sound]))
    for i, row in enumerate(sound):
        if row not in (5, 15):
            assert listed[row] == set(sound[list(expected[i])].tolist())


@pytest.mark.parametrize("n", [0, 1, 2])
def test_few_points(n) -> None:
    """Oracle: closed form."""
    positions = np.arange(3 * n, dtype=np.float32).reshape(n, 3)
    graph = Neighbors(open_device(), EXACT).update(positions, np.full(n, 9, np.float32))
    assert len(graph.neighbors) == n * (n - 1)


@pytest.mark.parametrize(
    ("h_min", "h_max", "expected"),
    [
        (-1, -1, (0.5 / 8**0.5, 0.5 * 8**0.5)),
        (0.1, -1, (0.1, 0.8)),
        (-1, 0.8, (0.1, 0.8)),
        (0.1, 0.4, (0.1, 0.4)),
        (0.1, 5.0, (0.1, 0.8)),
    ],
)
def test_radii_are_limited(h_min, h_max, expected) -> None:
    """Oracle: closed form: a ratio of at most 8 about the median."""
    search = Neighbors(open_device(), NeighborsParameters(h_min=h_min, h_max=h_max))
    search.update(points(101), np.geomspace(0.005, 50, 101).astype(np.float32))
    np.testing.assert_allclose(search.limits, expected, rtol=1e-6)
    clamped = search.clamped(np.array([1e-9, 0.5, 1e9, np.nan, -1], np.float32))
    middle = min(max(0.5, expected[0]), expected[1])
    np.testing.assert_allclose(clamped, [expected[0], middle, expected[1], 0, 0], rtol=1e-6)
