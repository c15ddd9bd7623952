"""Tests of the triangulation of USD's geometric primitives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.core.surface.meshes import volume
from usdsplat.core.surface import gprims
from usdsplat.core.surface.gprims import Shape

SOLIDS: dict[str, tuple[Shape, float]] = {
    "sphere": (gprims.sphere(radius=2), 4 / 3 * np.pi * 8),
    "cube": (gprims.cube(size=3), 27),
    "cylinder": (gprims.cylinder(radius=2, height=3), 12 * np.pi),
    "frustum": (gprims.cylinder(radius=2, top=1, height=3), 7 * np.pi),
    "cone": (gprims.cone(radius=2, height=3), 4 * np.pi),
    "funnel": (gprims.cylinder(radius=0, top=2, height=3), 4 * np.pi),
    "capsule": (gprims.capsule(radius=2, height=3), 12 * np.pi + 4 / 3 * np.pi * 8),
    "swallowed": (gprims.capsule(radius=2, top=0.5, height=1), 4 / 3 * np.pi * 8),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_have_their_volume(name: str) -> None:
    """Oracle: the formulas of solids; positive, since triangles face outwards."""
    shape, expected = SOLIDS[name]
    assert volume(shape.points, shape.triangles) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("name", SOLIDS)
def test_normals_are_unit_length_and_face_as_triangles_do(name: str) -> None:
    """Oracle: the triangles' own normals; none of them is without area."""
    shape, _ = SOLIDS[name]
    p = shape.points[shape.triangles].astype(np.float64)
    facing = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    length = np.linalg.norm(facing, axis=1, keepdims=True)
    assert (length > 0).all()
    np.testing.assert_allclose(np.linalg.norm(shape.normals, axis=2), 1, atol=1e-6)
    assert (np.einsum("tk,tck->tc", facing / length, shape.normals) > 0.999).all()
    assert shape.uvs.shape == (*shape.triangles.shape, 2)
    assert shape.uvs.min() == 0
    assert shape.uvs.max() == 1


@pytest.mark.parametrize("radius", [1.0, 250.0])
def test_a_ball_is_round_to_a_thousandth(radius: float) -> None:
    """Oracle: the radius, at corners, and at middles of triangles, which are furthest inside."""
    ball = gprims.sphere(radius=radius)
    corners = ball.points[ball.triangles].astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(corners, axis=2), radius, rtol=1e-6)
    np.testing.assert_allclose(ball.normals, corners / radius, atol=1e-6)
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    assert (np.einsum("tk,tk->t", facing, corners[:, 0]) > radius * (1 - 1e-3)).all()


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
@pytest.mark.parametrize("make", [gprims.cylinder, gprims.cone, gprims.capsule])
def test_shapes_stand_on_their_axis(make: Any, axis: gprims.Axis) -> None:
    """Oracle: extents: half the height along it, and a cap more; the radius across; the tip up."""
    shape = make(radius=0.5, height=3.0, axis=axis)
    along = "XYZ".index(axis)
    reach = np.full(3, 0.5)
    reach[along] = 2.0 if make is gprims.capsule else 1.5
    np.testing.assert_allclose(shape.points.max(axis=0), reach, rtol=1e-6)
    np.testing.assert_allclose(shape.points.min(axis=0), -reach, rtol=1e-6)
    if make is gprims.cone:
        tip = shape.points[shape.points[:, along] > 1.49]
        assert (np.delete(tip, along, axis=1) == 0).all()


@pytest.mark.parametrize(("axis", "reach"), [("X", [0, 3, 1]), ("Y", [1, 0, 3]), ("Z", [1, 3, 0])])
def test_a_plane_lies_as_its_schema_says(axis: gprims.Axis, reach: list[float]) -> None:
    """Oracle: UsdGeomPlane: width along x, or z with axis X; length along y, or z with axis Y."""
    shape = gprims.plane(width=2, length=6, axis=axis)
    np.testing.assert_array_equal(shape.points.max(axis=0), reach)
    np.testing.assert_array_equal(shape.points.min(axis=0), -np.float32(reach))
    up = np.eye(3)["XYZ".index(axis)]
    assert (shape.normals == up).all()
    p = shape.points[shape.triangles]
    facing = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    np.testing.assert_allclose(facing, np.broadcast_to(12 * up, facing.shape))


def test_capsules_of_two_radii_are_the_hull_of_two_balls() -> None:
    """Oracle: along every direction the larger of the two balls' reaches."""
    shape = gprims.capsule(radius=2, top=1, height=3)
    rng = np.random.default_rng(2)
    towards = rng.normal(size=(200, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    reach = np.maximum(2 - 1.5 * towards[:, 2], 1 + 1.5 * towards[:, 2])
    np.testing.assert_allclose((towards @ shape.points.T).max(axis=1), reach, rtol=1e-3)
