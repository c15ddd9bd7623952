"""Tests of dropping splats that are far from all others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.formats.samples import random_cloud
from tests.interchange.samples import assert_same
from usdsplat.core import edit
from usdsplat.core.errors import UsageError
from usdsplat.interchange.outliers import drop_outliers


def by_all_pairs(positions, neighbors, deviations):
    """Whether each is kept, by PCL's definition in float64: the point itself does not count, and
    the deviation is that of a sample."""
    points = positions.astype(np.float64)
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    means = np.sort(apart, axis=1)[:, :neighbors].mean(axis=1)
    return means <= means.mean() + deviations * means.std(ddof=1)


@pytest.mark.parametrize(("neighbors", "deviations"), [(1, 2.0), (8, 1.0), (20, 0.0), (20, 3.0)])
def test_they_are_those_of_the_definition(neighbors, deviations) -> None:
    """Oracle: all pairs, float64."""
    cloud = random_cloud(500, 1)
    kept = by_all_pairs(cloud.positions, neighbors, deviations)
    assert 0 < kept.sum() < 500
    found = drop_outliers(cloud, neighbors=neighbors, deviations=deviations)
    assert_same(found, edit.take(cloud, kept))


def test_one_far_from_a_lattice_goes_alone() -> None:
    """Oracle: a person's expectation."""
    lattice = np.stack(np.meshgrid(*[np.arange(8)] * 3), -1).reshape(-1, 3)
    cloud = random_cloud(513, 0)
    cloud = replace(
        cloud, positions=np.concatenate([lattice, [[30, 3, 3]]]).astype(np.float32), ids=None
    )
    assert_same(drop_outliers(cloud), edit.take(cloud, np.arange(512)))


@pytest.mark.parametrize("deviations", [0.0, 2.0])
def test_where_all_are_alike_all_stay(deviations) -> None:
    """Oracle: closed form: each has one at the same distance, and nobody else near."""
    cloud = random_cloud(2000, 0)
    cloud.positions[:, :2] = 100 * np.arange(1000).repeat(2)[:, None]
    cloud.positions[:, 2] = np.tile([0, 0.1], 1000)
    assert_same(drop_outliers(cloud, neighbors=1, deviations=deviations), cloud)


def test_where_no_distance_is_known_all_stay() -> None:
    """Oracle: closed form: one of nine neighbours of each is infinitely far."""
    cloud = random_cloud(10, 0)
    cloud.positions[0] = 1e30
    assert_same(drop_outliers(cloud), cloud)


def test_one_beyond_what_can_be_squared_goes_alone() -> None:
    """Oracle: closed form: its distance is infinite, and says nothing of the others'."""
    cloud = random_cloud(300, 0)
    cloud.positions[12] = 3e30
    kept = by_all_pairs(np.delete(cloud.positions, 12, axis=0), 20, 2.0)
    expected = np.delete(np.arange(300), 12)[kept]
    assert_same(drop_outliers(cloud), edit.take(cloud, expected))


def test_what_is_nowhere_goes_too() -> None:
    """Oracle: the finite ones alone."""
    cloud = random_cloud(200, 0)
    cloud.positions[::9, 2] = np.nan
    cloud.positions[1::9, 0] = np.inf
    sound = np.isfinite(cloud.positions).all(axis=1)
    assert_same(drop_outliers(cloud), drop_outliers(edit.take(cloud, sound)))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_hardly_any_stay(count) -> None:
    """Oracle: closed form: of two, both are as far from the other."""
    cloud = random_cloud(count, 0)
    assert_same(drop_outliers(cloud), cloud)


def test_many_at_one_place_are_near_each_other() -> None:
    """Oracle: closed form: their distances are 0, also to those with which they share a place."""
    cloud = random_cloud(300, 0)
    cloud.positions[:299] = 1
    assert_same(drop_outliers(cloud), edit.take(cloud, np.arange(299)))


@pytest.mark.parametrize("deviations", [0.0, 0.5])
def test_crowds_count_as_what_they_are(deviations) -> None:
    """Oracle: all pairs, float64; places of one splat to a hundred, other than in order."""
    random = np.random.default_rng(1)
    cloud = random_cloud(600, 0)
    cloud.positions[:] = cloud.positions[np.sort(random.geometric(0.02, 600)) % 97]
    cloud = edit.take(cloud, random.permutation(600))
    kept = by_all_pairs(cloud.positions, 8, deviations)
    assert 0 < kept.sum() < 600
    assert_same(drop_outliers(cloud, neighbors=8, deviations=deviations), edit.take(cloud, kept))


def test_ever_so_many_at_one_place_are_no_work() -> None:
    """Oracle: closed form; a search among them all would not end."""
    cloud = random_cloud(200_000, 0)
    cloud.positions[:] = 1
    cloud.positions[7] = 3
    assert len(drop_outliers(cloud)) == 199_999


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"neighbors": 0}, "neighbors of the outliers: found 0, expected 1 or more"),
        ({"deviations": -0.5}, "deviations of the outliers: found -0.5, expected 0 or more"),
        ({"deviations": float("nan")}, "deviations of the outliers: found nan"),
    ],
)
def test_wrong_numbers_are_refused(options, words) -> None:
    """Oracle: a person's expectation."""
    with pytest.raises(UsageError, match=words):
        drop_outliers(random_cloud(5, 0), **options)
