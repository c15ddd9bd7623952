"""Tests of optimal transport between points."""

from __future__ import annotations

import numpy as np
import ot
import pytest

from usdsplat.kernels.devices import open_device
from usdsplat.sim.sinkhorn import transport


@pytest.fixture(scope="module")
def device(any_device):
    return open_device()


def points(count, seed):
    """Points of a sphere and of a cube, with normals as features."""
    rng = np.random.default_rng(seed)
    ball = rng.normal(size=(count, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    cube, faces = rng.uniform(-1, 1, (count, 3)), np.zeros((count, 3))
    axes, rows = rng.integers(0, 3, count), np.arange(count)
    cube[rows, axes] = np.sign(cube[rows, axes])
    faces[rows, axes] = cube[rows, axes]
    first = np.concatenate([ball, 0.3 * ball], axis=1)
    return first.astype(np.float32), np.concatenate([cube, 0.3 * faces], axis=1).astype(np.float32)


@pytest.mark.parametrize(
    ("count", "other", "sharpness", "error"),
    [(7, 7, 0.25, 0.03), (40, 40, 0.25, 0.03), (500, 500, 0.25, 0.03), (700, 400, 0.7, 0.06)],
)
def test_the_cost_is_that_of_the_exact_plan(device, count, other, sharpness, error):
    """Oracle: POT's network simplex on the same points. A plan of some entropy costs a little
    more; its columns are balanced up to a few per cent, which can make it cost less."""
    x, y = points(count, 1)[0], points(other, 2)[1]
    exact = ot.emd2([], [], np.square(x[:, None] - y[None]).sum(axis=2).astype(np.float64))
    plan = transport(device, x, y, (sharpness * np.sqrt(4 * np.pi / other)) ** 2)
    assert abs(plan.cost() / exact - 1) <= error


def test_points_that_are_moved_are_found_again(device):
    """Oracle: the plan from points to the same points, translated, is the translation: the cost is
    the squared length, as translations are gradients of convex functions."""
    x = points(2000, 3)[0]
    order = np.random.default_rng(4).permutation(2000)
    y = (x + np.float32([0.5, -0.2, 0.1, 0, 0, 0]))[order]
    plan = transport(device, x, y, 4e-4)
    images, best = plan.images(np.ascontiguousarray(y[:, :3]))
    found = np.linalg.norm(images - y[np.argsort(order), :3], axis=1) < 0.05
    assert found.mean() >= 0.98
    assert (order[best] == np.arange(2000)).mean() >= 0.95
    assert abs(plan.cost() - 0.3) <= 0.003


def test_a_plan_covers_the_target(device):
    """Oracle: the definition of a plan: equal masses arrive everywhere, so that a large part of
    the target's points is the best partner of some point, here on three levels."""
    x, y = points(6000, 5)
    plan = transport(device, x, y, (0.5 * np.sqrt(4 * np.pi / 6000)) ** 2)
    best = plan.images(np.ascontiguousarray(y[:, :3]))[1]
    assert len(np.unique(best)) >= 0.75 * 6000


def test_one_point_goes_to_one_point(device):
    """Oracle: there is only one plan, also where all features are equal."""
    x = np.zeros((1, 6), np.float32)
    plan = transport(device, x, x + 1, 0.1)
    images, best = plan.images(np.float32([[1, 2, 3]]))
    np.testing.assert_allclose(images, [[1, 2, 3]], rtol=1e-6)
    assert best.tolist() == [0] and abs(plan.cost() - 6) <= 1e-5
