"""Tests of the division of sorted splats into nodes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from usdsplat.core import morton
from usdsplat.interchange.lod.partition import LEAST_PART, Branch, halves, partition

ALL = 1 << 63


class Keys:
    """Sorted runs in memory."""

    def __init__(self, *runs):
        self.runs = [np.sort(np.asarray(run, np.uint64)) for run in runs]
        self.counts = np.array([len(run) for run in self.runs])

    def below(self, edges):
        return np.stack([np.searchsorted(run, edges) for run in self.runs])


def keys_of(count, seed=0, spread=(1.0, 1.0, 1.0)):
    """Keys of points in a box."""
    points = np.random.default_rng(seed).uniform(0, spread, (count, 3)).astype(np.float32)
    return morton.keys(points, np.zeros(3), 1.0)


def counts(branch: Branch):
    """Numbers of splats of all nodes, and of their children."""
    return [(b.span.count, [c.span.count for c in b.children]) for b in branch.breadth_first()]


def test_leaves_hold_each_splat_once():
    """Oracle: the definition of a partition, for each run."""
    runs = Keys(keys_of(700, 1), keys_of(50, 2), keys_of(0), keys_of(900, 3))
    leaves = [b.span for b in partition(runs, 100).breadth_first() if not b.children]
    for run, count in enumerate(runs.counts):
        ranges = sorted((int(s.first[run]), int(s.last[run])) for s in leaves)
        assert ranges[0][0] == 0 and ranges[-1][1] == count
        assert all(a[1] == b[0] for a, b in itertools.pairwise(ranges))


@pytest.mark.parametrize("spread", [(1, 1, 1), (1, 1, 1e-6), (1, 1e-6, 1e-6), (1e-6, 1e-6, 1e-6)])
def test_no_leaf_is_large_or_tiny(spread):
    """Oracle: the limits: a leaf has at most 100 splats and, as it is at least a quarter of a
    range of more, at least 25."""
    sizes = [
        n for n, below in counts(partition(Keys(keys_of(5000, spread=spread)), 100)) if not below
    ]
    assert sum(sizes) == 5000
    assert max(sizes) <= 100 and min(sizes) >= 101 // LEAST_PART
    tree = counts(partition(Keys(keys_of(5000)), 100))
    assert {len(below) for _, below in tree} <= {0, 1, 2, 3, 4}
    assert all(n == sum(below) for n, below in tree if below)


def test_a_leaf_beside_inner_nodes_is_an_only_child():
    """Oracle: the definition, on a dense half, whose quarters are divided, and a sparse one, which
    is a leaf."""
    runs = Keys(np.arange(270) * (ALL // 2 // 270), ALL // 2 + np.arange(95) * (ALL // 2 // 95))
    nodes = partition(runs, 100).breadth_first()
    are_leaves = [{not child.children for child in node.children} for node in nodes]
    assert all(len(kinds) <= 1 for kinds in are_leaves)
    single = [node for node in nodes if len(node.children) == 1]
    assert single and all(not node.children[0].children for node in single)
    assert all(node.span is node.children[0].span for node in single)


def test_a_uniform_range_is_divided_at_the_coarsest_plane():
    """Oracle: closed form: half of the keys are below half of all possible ones."""
    runs = Keys(np.arange(64) * (ALL // 64))
    whole = partition(runs, 64).span
    low, high = halves(runs, whole)
    assert (low.count, high.count) == (32, 32)
    assert low.high == high.low == ALL // 2


def test_the_coarsest_plane_that_leaves_a_quarter_is_taken():
    """Oracle: closed form: 90 of 100 keys are in the first eighth, so the plane at a half leaves
    too few; that at a sixteenth leaves 45."""
    near = np.arange(90) * (ALL // 8 // 90 + 1)
    runs = Keys(np.concatenate([near, ALL // 2 + np.arange(10)]))
    low, _ = halves(runs, partition(runs, 100).span)
    assert (low.high, low.count) == (ALL // 16, 45)


def test_equal_keys_are_divided_by_their_order():
    """Oracle: closed form: all of the first run come before those of the second."""
    runs = Keys([7] * 10, [7] * 30)
    low, high = halves(runs, partition(runs, 100).span)
    assert low.last.tolist() == [10, 10] and high.first.tolist() == [10, 10]
    tree = partition(runs, 8)
    assert all(b.span.count <= 8 for b in tree.breadth_first() if not b.children)


def test_the_runs_do_not_matter():
    """Oracle: the same keys in one run, and in runs of other lengths."""
    keys = np.sort(np.concatenate([keys_of(900), np.full(300, 12345, np.uint64)]))
    once = counts(partition(Keys(keys), 64))
    for many in (2, 7):
        assert counts(partition(Keys(*np.array_split(keys, many)), 64)) == once
        assert counts(partition(Keys(*(keys[k::many] for k in range(many))), 64)) == once
