"""Tests of nearest points."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.kernels.devices import open_device
from usdsplat.kernels.points.nearest import nearest

pytestmark = pytest.mark.usefixtures("on_device")


def brute_force(points, queries, k):
    """Indices and distances from all pairs, in float32; equal ones by index."""
    d = points[None] - queries[:, None]
    d2 = d[..., 0] * d[..., 0] + d[..., 1] * d[..., 1] + d[..., 2] * d[..., 2]
    found = np.argsort(d2, axis=1, kind="stable")[:, :k]
    return found, np.sqrt(np.take_along_axis(d2, found, axis=1))


@pytest.mark.parametrize("k", [1, 8, 30])
def test_they_are_those_of_all_pairs_at_any_density(k) -> None:
    """Oracle: brute force; densities differ by 1e12, and queries lie in all of them and outside."""
    random = np.random.default_rng(k)
    size = 10.0 ** random.uniform(-2, 2, (4000, 1))
    points = (random.normal(size=(4000, 3)) * size).astype(np.float32)
    far = random.normal(size=(100, 3)).astype(np.float32) * 1000
    queries = np.concatenate([points[::10], far])
    indices, distances = nearest(open_device(), points, queries, k)
    expected, expected_distances = brute_force(points, queries, k)
    np.testing.assert_array_equal(indices, expected)
    np.testing.assert_array_equal(distances, expected_distances)


def test_equal_distances_go_by_index() -> None:
    """Oracle: brute force on a lattice, in whole numbers, each point there twice."""
    lattice = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), -1).reshape(-1, 3)
    points = np.random.default_rng(1).permutation(np.tile(lattice, (2, 1))).astype(np.float32)
    indices, _ = nearest(open_device(), points, points, 15)
    np.testing.assert_array_equal(indices, brute_force(points, points, 15)[0])


def test_many_at_one_place() -> None:
    """Oracle: closed form: the least indices."""
    indices, distances = nearest(
        open_device(), np.ones((5000, 3), np.float32), np.ones((3, 3), np.float32), 4
    )
    np.testing.assert_array_equal(indices, np.tile(np.arange(4), (3, 1)))
    assert not distances.any()


@pytest.mark.parametrize("n", [0, 1, 3])
def test_missing_ones_are_marked(n) -> None:
    """Oracle: closed form."""
    points = np.arange(3 * n, dtype=np.float32).reshape(n, 3)
    indices, distances = nearest(open_device(), points, np.zeros((2, 3), np.float32), 4)
    expected = np.where(np.arange(4) < n, np.arange(4), -1)
    np.testing.assert_array_equal(indices, np.tile(expected, (2, 1)))
    np.testing.assert_array_equal(np.isinf(distances[0]), expected < 0)


def test_what_is_not_finite_is_never_found_and_finds_nothing() -> None:
    """Oracle: the sound points alone."""
    points = np.random.default_rng(2).normal(size=(200, 3)).astype(np.float32)
    points[::7, 2] = np.nan
    points[1::7, 0] = np.inf
    indices, _ = nearest(open_device(), points, points, 5)
    sound = np.isfinite(points).all(axis=1)
    assert (indices[~sound] == -1).all()
    rows = np.flatnonzero(sound)
    np.testing.assert_array_equal(
        indices[sound], rows[brute_force(points[sound], points[sound], 5)[0]]
    )


def test_one_thread_and_several_find_the_same() -> None:
    """Oracle: a single thread."""
    points = np.random.default_rng(3).normal(size=(5000, 3)).astype(np.float32)
    (a, _), (b, _) = (nearest(open_device(threads=t), points, points, 8) for t in (1, None))
    np.testing.assert_array_equal(a, b)
