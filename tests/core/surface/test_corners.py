"""Tests of values at the corners of a surface's triangles."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.surface.meshes import (
    CUBE_EDGES,
    CUBE_FACES,
    CUBE_POINTS,
    OCTAHEDRON_FACES,
    OCTAHEDRON_POINTS,
    grid,
    surface,
    topology,
)
from usdsplat.core.cloud import F32
from usdsplat.core.errors import StageError
from usdsplat.core.surface.refine import Surface


def seamed() -> tuple[F32, list[list[int]], F32]:
    """Points of 4 x 4 quads, the quads, and coordinates that leap by 10 at x = 2."""
    points, faces = grid(4, 4)
    rng = np.random.default_rng(4)
    wavy = points[:, :2] + rng.uniform(-0.3, 0.3, (25, 2)).astype(np.float32)
    uvs = wavy[np.array(faces)]
    right = np.array([points[face, 0].mean() > 2 for face in faces])
    uvs[right, :, 0] += 10
    return points, faces, uvs.reshape(-1, 2)


@pytest.mark.parametrize("scheme", ["none", "catmullClark"])
def test_constant_and_uniform_values_spread(scheme: str) -> None:
    """Oracle: the one value, and that of the authored face."""
    it = surface(CUBE_FACES, 8, scheme=scheme)
    assert (it.corners(np.float32([[1, 2, 3]]), "constant") == [1, 2, 3]).all()
    uniform = it.corners(np.arange(6) * 1.5, "uniform")
    assert uniform.shape == (len(it.triangles), 3, 1)
    assert (uniform[..., 0] == 1.5 * it.faces[:, None]).all()


def test_vertex_values_move_as_points_do() -> None:
    """Oracle: the refined points themselves, with and without indices."""
    it = surface(CUBE_FACES, 8, levels=2)
    fine = it.points(CUBE_POINTS)[it.triangles]
    np.testing.assert_array_equal(it.corners(CUBE_POINTS, "vertex"), fine)
    shuffled = it.corners(CUBE_POINTS[::-1], "vertex", np.arange(8, dtype=np.int32)[::-1])
    np.testing.assert_array_equal(shuffled, fine)


@pytest.mark.parametrize("scheme", ["catmullClark", "loop"])
def test_varying_values_are_linear(scheme: str) -> None:
    """Oracle: the coordinates of a flat grid at its evenly divided points."""
    points, faces = grid(2, 2)
    if scheme == "loop":
        faces = [each for a, b, c, d in faces for each in ([a, b, c], [a, c, d])]
    it = surface(faces, 9, levels=2, scheme=scheme)
    values = it.corners(points, "varying")
    assert len(np.unique(values.reshape(-1, 3), axis=0)) == 81
    np.testing.assert_array_equal(values, (values * 4).round() / 4)


def test_values_without_a_seam_move_as_points_do() -> None:
    """Oracle: vertex interpolation, creases included; equal values need no indices to be one."""
    it = surface(CUBE_FACES, 8, dict.fromkeys(CUBE_EDGES[:5], 1.4), levels=2)
    indices = np.array(CUBE_FACES, np.int32).ravel()
    expected = it.corners(CUBE_POINTS, "vertex")
    for rule in (
        it.corners(CUBE_POINTS, "faceVarying", indices),
        it.corners(CUBE_POINTS[indices], "faceVarying"),
    ):
        np.testing.assert_allclose(rule, expected, atol=1e-6)


def test_loop_values_without_a_seam_move_as_points_do() -> None:
    """Oracle: vertex interpolation of an octahedron with a crease."""
    it = surface(OCTAHEDRON_FACES, 6, {(0, 2): 2.5, (2, 1): 2.5}, levels=2, scheme="loop")
    indices = np.array(OCTAHEDRON_FACES, np.int32).ravel()
    found = it.corners(OCTAHEDRON_POINTS, "faceVarying", indices)
    np.testing.assert_allclose(found, it.corners(OCTAHEDRON_POINTS, "vertex"), atol=1e-6)


def test_indices_are_of_values_not_of_places() -> None:
    """Oracle: the same four indices on each face leave a seam at each edge: bilinear."""
    it = surface(CUBE_FACES, 8, levels=1)
    square = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]])
    values = it.corners(square, "faceVarying", np.tile(np.arange(4, dtype=np.int32), 6))
    assert {tuple(row) for row in values.reshape(-1, 2)} == {
        (x / 2, y / 2) for x in range(3) for y in range(3)
    }


def test_seams_are_splines_with_corners() -> None:
    """Oracle: along the seam x = 2 knot insertion of the values on one side, (1 6 1) / 8 inside and
    the values themselves where the seam ends; neither side hears of the other."""
    points, faces, uvs = seamed()
    it = surface(faces, 25)
    values = it.corners(uvs, "faceVarying")
    corners = it.points(points)[it.triangles]
    left = values[..., 0] < 6
    at = {tuple(np.round(p[:2], 3)): v for p, v in zip(corners[left], values[left], strict=True)}
    cage = {
        tuple(points[v]): uvs[4 * f + k]
        for f, face in enumerate(faces)
        for k, v in enumerate(face)
        if uvs[4 * f + k, 0] < 6
    }
    line = np.array([cage[(2, y, 0)] for y in range(5)])
    np.testing.assert_allclose(at[(2, 0)], line[0], atol=1e-6)
    np.testing.assert_allclose(at[(2, 2)], np.array([1, 6, 1]) / 8 @ line[1:4], atol=1e-6)
    np.testing.assert_allclose(at[(2, 1.5)], (line[1] + line[2]) / 2, atol=1e-6)


@pytest.mark.parametrize(
    ("rule", "corner", "inner"),
    [
        ("none", "spline", "spline"),
        ("cornersOnly", "itself", "spline"),
        ("cornersPlus1", "itself", "spline"),
        ("cornersPlus2", "itself", "spline"),
        ("boundaries", "itself", "itself"),
        ("all", "itself", "itself"),
    ],
)
def test_the_rule_says_where_seams_are_linear(rule: str, corner: str, inner: str) -> None:
    """Oracle: an island of two quads: at its corners and halfway along its side (1 6 1) / 8 of
    the values, or the values themselves."""
    points, faces = grid(4, 3)
    uvs = points[np.array(faces), :2].copy()
    uvs[[5, 6]] += 20
    it = surface(faces, 20, face_varying=rule)
    values = it.corners(uvs.reshape(-1, 2), "faceVarying")
    island = {tuple(row) for row in values[values.min(axis=(1, 2)) > 15].reshape(-1, 2)}
    spline = {"corner": (21.125, 21.125), "inner": (22, 21)}
    assert ((21, 21) in island) == (corner == "itself")
    assert (spline["corner"] in island) == (corner == "spline")
    assert spline["inner"] in island
    bent = uvs.copy()
    bent[[5, 6], [1, 0]] += np.float32([0, -1])  # halfway along the side, one value in two corners
    values = it.corners(bent.reshape(-1, 2), "faceVarying")
    moved = {tuple(row) for row in values[values.min(axis=(1, 2)) > 15].reshape(-1, 2)}
    assert ((22, 20) in moved) == (inner == "itself")
    assert ((22, 20.25) in moved) == (inner == "spline")


def test_where_three_pieces_meet_values_stay() -> None:
    """Oracle: cornersPlus1 keeps the value at the junction, cornersOnly makes it a spline."""
    points, faces = grid(4, 4)
    uvs = points[np.array(faces), :2].copy()
    piece = np.array([0 if y < 2 else 1 + (x > 1) for y in range(4) for x in range(4)])
    uvs += 20 * piece[:, None, None]
    uvs[5, 2] += [0, 1]
    uvs[6, 3] += [0, 1]  # the lower piece's value at (2, 2)
    for rule, expected in (("cornersOnly", 2.75), ("cornersPlus1", 3.0)):
        it = surface(faces, 25, face_varying=rule)
        values = it.corners(uvs.reshape(-1, 2), "faceVarying")[it.faces == 5]
        found = values[np.isclose(values[..., 0], 2)][:, 1].max()
        assert found == pytest.approx(expected)


def test_bilinear_surfaces_have_bilinear_values() -> None:
    """Oracle: values of a coordinate stay on the even grid, seam or none."""
    points, faces = grid(2, 2)
    it = surface(faces, 9, scheme="bilinear", levels=2)
    uvs = points[np.array(faces).ravel(), :2]
    corners = it.points(points)[it.triangles]
    np.testing.assert_array_equal(it.corners(uvs, "faceVarying"), corners[..., :2])


@pytest.mark.parametrize(
    ("values", "interpolation", "indices", "message"),
    [
        (7, "vertex", None, "box: found 7 vertex values, expected 8"),
        (5, "uniform", None, "box: found 5 uniform values, expected 6"),
        (2, "constant", None, "box: found 2 constant values, expected 1"),
        (9, "varying", None, "box: found 9 varying values, expected 8"),
        (23, "faceVarying", None, "box: found 23 face-varying values, expected 24"),
        (8, "faceVarying", [0, 1], "box: found 2 face-varying indices, expected 24"),
        (8, "vertex", [0, 9], "box: found primvar index 9, expected 0 or more and less than 8"),
        (8, "facet", None, "box: found interpolation 'facet', expected constant, uniform"),
    ],
)
def test_values_that_do_not_fit_are_refused(
    values: int, interpolation: str, indices: list[int] | None, message: str
) -> None:
    """Oracle: one sentence that says how many there are and how many there should be."""
    it = Surface(topology(CUBE_FACES), points=8, where="box")
    rows = None if indices is None else np.array(indices, np.int32)
    with pytest.raises(StageError, match=message):
        it.corners(np.zeros((values, 2), np.float32), interpolation, rows)
