from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from usdsplat.delegate.instancing import InstancerSpec, Link, Placement, expand

RNG = np.random.default_rng(7)


def scatter(prototypes, shown=None):
    n = len(prototypes)
    spec = InstancerSpec(
        transforms=RNG.normal(size=(n, 4, 4)),
        prototypes=np.array(prototypes, np.int64),
        shown=np.ones(n, bool) if shown is None else np.array(shown),
    )
    return SimpleNamespace(spec=spec)


def matrix(instance):
    return np.reshape(instance.transform, (4, 4))


def test_a_field_without_instancers_is_seen_once_where_it_is():
    """Oracle: the identity of its only level."""
    world = RNG.normal(size=(4, 4))
    (seen,) = expand([Placement(path="/a")], [(world,)], [True], {})
    assert (seen.path, seen.index) == ("/a", 0)
    np.testing.assert_array_equal(matrix(seen), world)


def test_nested_instancers_multiply_like_loops_in_loops():
    """Oracle: two plain loops and their matrix products, written out."""
    outer, inner = scatter([0, 1, 0]), scatter([2, 2, 0, 2], shown=[True, False, True, True])
    links = (Link(instancer="/o", prototype=0), Link(instancer="/i", prototype=2))
    levels = tuple(RNG.normal(size=(3, 4, 4)))
    seen = expand([Placement(path="/a", links=links)], [levels], [True], {"/o": outer, "/i": inner})
    expected = [
        (4 * i + j, levels[0] @ outer.spec.transforms[i] @ levels[1] @ inner.spec.transforms[j]
         @ levels[2])
        for i in (0, 2)
        for j in (0, 3)
    ]  # fmt: skip
    assert [each.index for each in seen] == [index for index, _ in expected]
    np.testing.assert_allclose([matrix(each) for each in seen], [m for _, m in expected], rtol=1e-9)


def test_indices_stay_distinct_when_one_prim_is_seen_in_several_ways():
    """Oracle: instances of one field differ in path or index, as `InstanceSpec` promises; and an
    index does not move when another instance is hidden."""
    links = (Link(instancer="/o", prototype=0),)
    ways = [Placement(path="/a"), Placement(path="/a", links=links), Placement(path="/b")]
    levels = [(np.eye(4),), (np.eye(4), np.eye(4)), (np.eye(4),)]
    instancers = {"/o": scatter([0, 1, 0])}
    seen = expand(ways, levels, [True, True, True], instancers)
    assert [(each.path, each.index) for each in seen] == [
        ("/a", 0),
        ("/a", 1),
        ("/a", 3),
        ("/b", 0),
    ]
    seen = expand(ways, levels, [False, True, True], instancers)
    assert [(each.path, each.index) for each in seen] == [("/a", 1), ("/a", 3), ("/b", 0)]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_nowhere_is_left_out(bad):
    """Oracle: a matrix that is not finite has no place in the world."""
    scattered = scatter([0, 0])
    scattered.spec.transforms[1, 0, 3] = bad
    links = (Link(instancer="/o", prototype=0),)
    seen = expand(
        [Placement(path="/a", links=links)], [(np.eye(4),) * 2], [True], {"/o": scattered}
    )
    assert [each.index for each in seen] == [0]
