"""Tests of the choice of the outer sides."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from usdsplat.kernels.devices import open_device
from usdsplat.kernels.normals.sides import NEAREST, UNIT
from usdsplat.kernels.points.surface_normals import outer_sides


def sides_of(links, pull):
    """The sides of a graph of (a, b, weight)."""
    n = len(pull)
    neighbors = np.full((n, NEAREST + 1), -1, np.int32)
    weights = np.zeros((n, NEAREST), np.int32)
    neighbors[:, 0] = np.arange(n)
    used = np.zeros(n, int)
    for a, b, weight in links:
        neighbors[a, used[a] + 1], weights[a, used[a]] = b, round(weight * UNIT)
        used[a] += 1
    whole = np.int64(np.round(np.array(pull) * UNIT))
    return outer_sides(open_device(), weights, neighbors, whole)


def score(links, pull, sides):
    """The sum that the sides maximise."""
    return np.dot(pull, sides) + sum(w * sides[a] * sides[b] for a, b, w in links)


def test_a_chain_follows_its_links() -> None:
    """Oracle: closed form: signs multiply along a chain, and the only pull decides."""
    rng = np.random.default_rng(1)
    signs = rng.choice([-1, 1], 999)
    links = [(i, i + 1, 0.5 * signs[i]) for i in range(999)]
    pull = np.zeros(1000)
    pull[400] = -0.1
    expected = np.concatenate([[1], np.cumprod(signs)])
    np.testing.assert_array_equal(sides_of(links, pull), -expected * expected[400])


def test_many_weak_pulls_outvote_a_strong_one() -> None:
    """Oracle: closed form: a well-linked sheet turns as a whole."""
    links = [(i, i + 1, 1.0) for i in range(99)]
    pull = np.full(100, 0.01)
    pull[50] = -0.5
    assert (sides_of(links, pull) == 1).all()


@pytest.mark.parametrize("seed", range(5))
def test_small_graphs_are_near_their_best_sum(seed: int) -> None:
    """Oracle: all choices of sides, by brute force; the method is greedy."""
    rng = np.random.default_rng(seed)
    pairs = list(itertools.combinations(range(9), 2))
    chosen = [pairs[k] for k in rng.choice(len(pairs), 18, replace=False)]
    links = [(a, b, rng.uniform(-1, 1)) for a, b in chosen]
    pull = rng.uniform(-0.3, 0.3, 9)
    best = max(score(links, pull, s) for s in itertools.product((-1, 1), repeat=9))
    found = score(links, pull, sides_of(links, pull).astype(int))
    assert found >= 0.7 * best
