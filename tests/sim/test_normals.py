"""Tests of normals of splats."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.clouds import even_sphere, sphere
from usdsplat.core import quaternion
from usdsplat.kernels.devices import open_device
from usdsplat.sim.neighbors import Neighbors
from usdsplat.sim.normals import captured, grown, manifold_dimension
from usdsplat.sim.parameters import NeighborsParameters


def graph_of(points, radius, symmetric=True):
    """Neighbours within a radius."""
    search = Neighbors(open_device(), NeighborsParameters(), symmetric=symmetric)
    return search.update(points, np.full(len(points), radius, np.float32))


def facing(normals, seed=0):
    """Rotations whose local x or z axis is the normal or its opposite, and flat scales."""
    random = np.random.default_rng(seed)
    n = len(normals)
    signs = random.choice([-1, 1], n)[:, None]
    side = np.cross(normals, random.normal(size=(n, 3)))
    side /= np.linalg.norm(side, axis=1)[:, None]
    thin = normals * signs
    third = np.cross(thin, side)
    along_x = random.random(n) < 0.5
    x_first = np.stack([thin, side, third], axis=2)
    z_first = np.stack([side, third, thin], axis=2)
    matrices = np.where(along_x[:, None, None], x_first, z_first)
    scales = np.where(along_x[:, None], [0.01, 0.1, 0.2], [0.1, 0.2, 0.01])
    return quaternion.from_matrix(matrices).astype(np.float32), scales.astype(np.float32)


def test_captured_normals_are_thin_axes_on_the_outer_side() -> None:
    """Oracle: closed form: the sphere's normals, whichever axis is thin and whatever its sign; of
    two spheres each is turned outwards by its own outermost splat."""
    ball = even_sphere(3000)
    small = 0.5 * even_sphere(1000) + np.array([4, 0, 0], np.float32)
    points = np.concatenate([ball, small.astype(np.float32)])
    truth = np.concatenate([ball, even_sphere(1000)])
    rotations, scales = facing(truth)
    normals = captured(open_device(), graph_of(points, 0.15), rotations, scales)
    np.testing.assert_allclose(normals, truth, atol=2e-6)


def test_sides_are_consistent_where_normals_are_noisy() -> None:
    """Oracle: closed form: of normals up to 35 degrees off, all are on the outer side."""
    ball = even_sphere(5000)
    noisy = ball + np.random.default_rng(1).normal(0, 0.2, ball.shape)
    noisy /= np.linalg.norm(noisy, axis=1)[:, None]
    rotations, scales = facing(noisy)
    normals = captured(open_device(), graph_of(ball, 0.12), rotations, scales)
    assert (np.einsum("ij,ij->i", normals, ball) > 0).all()


def test_grown_normals_are_those_of_the_surface() -> None:
    """Oracle: closed form: the sphere's, with the signs of those before; and NumPy's eigenvectors
    of the weighted covariance of a few."""
    points = sphere(5000)
    before = points * np.random.default_rng(2).choice([-1, 1], (5000, 1)).astype(np.float32)
    graph = graph_of(points, 0.15)
    normals, surfaceness = grown(open_device(), graph, before)
    cosines = np.einsum("ij,ij->i", normals, before)
    assert cosines.min() > 0.98
    assert np.median(cosines) > 0.999
    assert np.median(surfaceness) > 0.95
    for s in range(0, 5000, 100):
        listed = graph.neighbors[graph.rows[s] : graph.rows[s + 1]]
        near = np.concatenate([graph.positions[s : s + 1], graph.positions[listed]])
        offset = (near - near[0]).astype(np.float64) / 0.15
        weights = np.maximum(1 - (offset**2).sum(axis=1), 0) ** 3
        values, vectors = np.linalg.eigh(np.cov(offset.T, aweights=weights, ddof=0))
        row = graph.order[s]
        assert abs(vectors[:, 0] @ normals[row]) == pytest.approx(1, abs=1e-5)
        assert surfaceness[row] == pytest.approx(1 - values[0] / values[1], abs=1e-4)


def test_volumes_are_no_surfaces() -> None:
    """Oracle: closed form: noise in a box fills it, noise in a thin one is a sheet."""
    points = np.random.default_rng(3).uniform(0, 1, (8000, 3)).astype(np.float32)
    _, surfaceness = grown(open_device(), graph_of(points, 0.12), np.zeros_like(points))
    assert manifold_dimension(surfaceness) == 3
    sheet = points * np.array([1, 1, 0.01], np.float32)
    _, surfaceness = grown(open_device(), graph_of(sheet, 0.05), np.zeros_like(points))
    assert manifold_dimension(surfaceness) == 2


@pytest.mark.parametrize("n", [0, 1, 2, 20])
def test_normals_stay_where_neighbours_define_no_plane(n) -> None:
    """Oracle: closed form: points on a line."""
    points = np.zeros((n, 3), np.float32)
    points[:, 0] = np.arange(n)
    before = np.tile(np.array([0, 1, 0], np.float32), (n, 1))
    normals, surfaceness = grown(open_device(), graph_of(points, 2.5), before)
    np.testing.assert_array_equal(normals, before)
    assert not surfaceness.any()
