"""Tests of the normals of surfaces that splats lie on."""

from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.points.splat_shapes import Shape, cube, plane, shape_of, sphere, squares, torus
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.points.surface_normals import surface_normals

pytestmark = pytest.mark.usefixtures("on_device")


@pytest.mark.parametrize("shape", [sphere(3000), torus(12000)], ids=["sphere", "torus"])
def test_normals_of_smooth_shapes_are_exact_and_point_outwards(shape: Shape) -> None:
    """Oracle: closed form."""
    errors = shape.errors(shape.found(open_device()))
    assert errors.mean() <= 3
    assert np.mean(errors <= 10) >= 0.99
    assert errors.max() < 90


def test_a_cube_keeps_its_edges() -> None:
    """Beyond two spacings from an edge. Oracle: closed form."""
    shape = cube(31)
    errors = shape.errors(shape.found(open_device()))
    assert errors.max() < 90
    to_edge = np.sort(1 - np.abs(shape.positions), axis=1)[:, 1]
    beyond = errors[to_edge > 2 * shape.spacing]
    assert np.mean(beyond <= 5) >= 0.98
    assert beyond.max() <= 10


def test_the_normals_of_a_plane_agree_and_are_trusted() -> None:
    """Oracle: closed form; both sides are alike, but all splats are on the same one."""
    shape = plane(40)
    found = shape.found(open_device())
    errors = shape.errors(found)
    errors = errors if errors[0] < 90 else 180 - errors
    assert errors.mean() <= 3
    assert errors.max() <= 10
    assert np.median(found.confidence) > 0.8
    assert found.occlusion.max() < 0.1


def test_a_volume_is_not_trusted() -> None:
    """Oracle: closed form: round splats that fill a ball lie on no surface."""
    rng = np.random.default_rng(2)
    points = rng.uniform(-1, 1, (8000, 3))
    points = points[np.linalg.norm(points, axis=1) < 1]
    n = len(points)
    splats = points, np.tile([1, 0, 0, 0], (n, 1)), np.full((n, 3), 0.05), np.full(n, 0.5)
    ball = surface_normals(open_device(), *(np.float32(array) for array in splats))
    shell = sphere(3000).found(open_device())
    assert np.median(ball.confidence) < 0.4 < np.quantile(shell.confidence, 0.05)


def test_occlusion_is_the_hidden_part_of_the_sky() -> None:
    """Oracle: closed form: an endless wall of height h at distance d hides
    (1 - cos(atan(h / d))) / 2 of the sky, weighted by the cosine; here the wall is 4 long, and
    there are 26 rays."""
    rows = 60
    flat = 2 * np.concatenate([squares(rows), np.zeros((rows * rows, 1))], axis=1)
    floor, up = flat[flat[:, 0] > 0], np.tile([0.0, 0, 1], (rows * rows, 1))
    wall = np.stack([np.zeros(rows * rows), flat[:, 1], flat[:, 0]], axis=1)[flat[:, 0] > 0]
    points = np.concatenate([floor, wall])
    normals = np.concatenate([up[: len(floor)], np.tile([1.0, 0, 0], (len(wall), 1))])
    found = shape_of(points, normals, 16, jitter=0).found(open_device())
    x, y = floor[:, 0], np.abs(floor[:, 1])
    for low, high in ((0.2, 0.3), (0.5, 0.6), (0.8, 1.0)):
        rows_there = np.flatnonzero((x > low) & (x < high) & (y < 0.5))
        hidden = (1 - np.cos(np.arctan2(2, x[rows_there]))) / 2
        assert found.occlusion[rows_there].mean() == pytest.approx(hidden.mean(), abs=0.1)


def test_nothing_depends_on_threads() -> None:
    """Oracle: one thread, bit for bit."""
    shape = torus(3000)
    one, two = (shape.found(open_device(threads=count)) for count in (1, 2))
    np.testing.assert_array_equal(one.normals, two.normals)
    np.testing.assert_array_equal(one.confidence, two.confidence)
    np.testing.assert_array_equal(one.occlusion, two.occlusion)


@pytest.mark.parametrize("factor", [2.0**-20, 2.0**12])
def test_nothing_depends_on_the_unit(factor: float) -> None:
    """Oracle: the same splats in another unit, a power of two, so that rounding is the same."""
    shape = sphere(1000)
    positions, rotations, scales, opacities = shape.splats
    unit = np.float32(factor)
    found, other = (
        shape.found(open_device()),
        surface_normals(open_device(), unit * positions, rotations, unit * scales, opacities),
    )
    np.testing.assert_allclose(other.normals, found.normals, atol=1e-4)
    np.testing.assert_allclose(other.confidence, found.confidence, atol=1e-4)


def test_the_order_of_rows_hardly_matters() -> None:
    """Oracle: the same splats in another order; equal cells of the curve are sorted by row."""
    shape = sphere(2000)
    rows = np.random.default_rng(7).permutation(2000)
    found = shape.found(open_device())
    other = surface_normals(open_device(), *(array[rows] for array in shape.splats))
    cosines = np.einsum("ij,ij->i", found.normals[rows], other.normals)
    assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).max() < 1


def test_normals_are_not_averaged_over_edges_of_colour() -> None:
    """A splat on an edge takes the normal of the side that has its colour. Oracle: closed form."""
    shape = cube(20)
    of_sides = np.float32(0.5 + 0.5 * shape.normals)
    plain = shape.errors(shape.found(open_device()))
    colored = shape.errors(surface_normals(open_device(), *shape.splats, of_sides))
    assert colored.mean() < 0.9 * plain.mean()


def test_strays_and_broken_splats_have_no_confidence() -> None:
    """Oracle: closed form; the other splats are as without them, almost."""
    shape = sphere(1500)
    positions, rotations, scales, opacities = (array.copy() for array in shape.splats)
    positions[3], positions[100], positions[200] = np.nan, np.inf, (40, 3, 2)
    rotations[5], scales[7], opacities[9] = np.nan, np.inf, np.nan
    rotations[11] = 0
    found = surface_normals(open_device(), positions, rotations, scales, opacities)
    for array in (found.normals, found.confidence, found.occlusion):
        assert np.isfinite(array).all()
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1, atol=1e-5)
    assert not found.confidence[[3, 100, 200]].any()
    errors = np.delete(shape.errors(found), [3, 100, 200])
    assert errors.mean() < 3
    assert errors.max() < 30


@pytest.mark.parametrize("count", [0, 1, 2, 6])
def test_few_splats_have_no_confidence(count: int) -> None:
    """Oracle: closed form: fewer than seven splats define no surface."""
    shape = sphere(50)
    found = surface_normals(open_device(), *(array[:count] for array in shape.splats))
    assert found.normals.shape == (count, 3)
    assert np.isfinite(found.normals).all()
    assert not found.confidence.any()
    assert ((found.occlusion >= 0) & (found.occlusion <= 1)).all()


def test_splats_at_one_place_are_finite() -> None:
    """Oracle: closed form."""
    shape = sphere(100)
    splats = np.zeros_like(shape.positions), *shape.splats[1:]
    found = surface_normals(open_device(), *splats)
    assert np.isfinite(found.normals).all()
    assert not found.confidence.any()
