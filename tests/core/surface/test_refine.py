"""Tests of the refinement of subdivision surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.core.surface.meshes import (
    CUBE_EDGES,
    CUBE_FACES,
    CUBE_POINTS,
    OCTAHEDRON_FACES,
    OCTAHEDRON_POINTS,
    grid,
    surface,
    volume,
)
from usdsplat.core.cloud import F32


def cube(levels: int = 1, creases: Any = None, **rest: Any) -> F32:
    """Refined points of the cube."""
    return surface(CUBE_FACES, 8, creases, levels, **rest).points(CUBE_POINTS)


def test_a_step_of_the_cube_follows_the_published_rules() -> None:
    """Oracle: Catmull and Clark 1978: faces at their middles, edges at the mean of two ends
    and two faces, 3/4, and vertices of valence 3 at a third of the mean of faces, 1/3, and two
    thirds of that of the middles of edges, 2/3: 5/9."""
    fine = cube()
    np.testing.assert_allclose(fine[:8], CUBE_POINTS * 5 / 9, atol=1e-6)
    on_edges, on_faces = fine[8:20], fine[20:]
    np.testing.assert_allclose(np.sort(np.abs(on_edges), axis=1), [[0, 0.75, 0.75]] * 12)
    np.testing.assert_allclose(np.sort(np.abs(on_faces), axis=1), [[0, 0, 1]] * 6)


def test_corners_of_the_cube_approach_its_limit() -> None:
    """Oracle: the limit mask (n² P + 4 ΣE + ΣF) / (n (n + 5)) with n = 3, where neighbours add up
    to P and corners across faces to -P: (9 + 4 - 1) / 24 = 1/2."""
    np.testing.assert_allclose(cube(5)[:8], CUBE_POINTS / 2, atol=1e-3)


def test_a_regular_grid_is_a_bicubic_spline() -> None:
    """Oracle: knot insertion of the uniform cubic B-spline, (1 6 1) / 8 and (1 1) / 2 both ways."""
    rng = np.random.default_rng(1)
    points, faces = grid(4, 4)
    points[:, 2] = rng.normal(size=25)
    heights = points[:, 2].reshape(5, 5).astype(np.float64)
    vertex, edge = np.array([1, 6, 1]) / 8, np.array([0, 4, 4]) / 8
    fine = surface(faces, 25).points(points)
    lookup = {tuple(np.round(p[:2], 4)): p[2] for p in fine}
    for x in (2, 2.5):
        for y in (2, 2.5):
            u, v = (vertex if x == 2 else edge), (vertex if y == 2 else edge)
            expected = v @ heights[1:4, 1:4] @ u
            assert lookup[(x, y)] == pytest.approx(expected, abs=1e-5)


def test_a_step_of_loop_follows_the_published_rules() -> None:
    """Oracle: Loop 1987 at valence 4: beta = (5/8 - (3/8)²) / 4 = 31/256; the four neighbours of a
    tip cancel out, so it moves to 1 - 4 beta = 33/64; edges to (3 a + 3 b) / 8."""
    fine = surface(OCTAHEDRON_FACES, 6, scheme="loop").points(OCTAHEDRON_POINTS)
    np.testing.assert_allclose(fine[:6], OCTAHEDRON_POINTS * 33 / 64, atol=1e-6)
    np.testing.assert_allclose(np.sort(np.abs(fine[6:]), axis=1), [[0, 0.375, 0.375]] * 12)


def test_loop_on_a_regular_grid_is_a_box_spline() -> None:
    """Oracle: the masks of the quartic box spline: 10/16 and six times 1/16; a height of 1."""
    points, quads = grid(4, 4)
    faces = [each for a, b, c, d in quads for each in ([a, b, c], [a, c, d])]
    points[12, 2] = 1
    fine = surface(faces, 25, scheme="loop").points(points)
    lookup = {tuple(np.round(p[:2], 4)): p[2] for p in fine}
    assert lookup[(2, 2)] == pytest.approx(10 / 16)
    for neighbour in ((1, 2), (3, 2), (2, 1), (2, 3), (1, 1), (3, 3)):
        assert lookup[neighbour] == pytest.approx(1 / 16)
    for middle in ((1.5, 2), (2.5, 2), (2, 2.5), (2.5, 2.5)):
        assert lookup[middle] == pytest.approx(3 / 8)
    assert lookup[(1.5, 2.5)] == pytest.approx(1 / 8)
    assert lookup[(1, 3)] == 0


def test_an_infinitely_sharp_cube_stays_a_cube() -> None:
    """Oracle: all points have a largest coordinate of 1, and corners stay."""
    fine = cube(3, dict.fromkeys(CUBE_EDGES, 10))
    np.testing.assert_allclose(np.abs(fine).max(axis=1), 1)
    np.testing.assert_array_equal(fine[:8], CUBE_POINTS)


def test_a_crease_is_a_cubic_spline() -> None:
    """Oracle: knot insertion along the rim of the top: corners (1 6 1) / 8, middles (1 1) / 2."""
    rim = {(4, 5): 10, (5, 7): 10, (6, 7): 10, (4, 6): 10}
    fine = cube(1, rim)
    np.testing.assert_allclose(fine[4:8], CUBE_POINTS[4:8] * [0.75, 0.75, 1])
    top = fine[8:20][fine[8:20, 2] == 1]
    np.testing.assert_allclose(np.sort(np.abs(top), axis=1), [[0, 1, 1]] * 4)


def test_a_sharpness_of_one_is_sharp_for_one_level() -> None:
    """Oracle: the first level of the infinitely sharp cube, then one without creases."""
    sharp = surface(CUBE_FACES, 8, dict.fromkeys(CUBE_EDGES, 10), 1)
    first = sharp.points(CUBE_POINTS)
    quads = np.concatenate([sharp.triangles[::2], sharp.triangles[1::2, 2:]], axis=1).tolist()
    second = surface(quads, len(first)).points(first)
    both = cube(2, dict.fromkeys(CUBE_EDGES, 1))

    def rows(points: F32) -> F32:
        return np.unique(points.round(5) + np.float32(0), axis=0)

    np.testing.assert_allclose(rows(both), rows(second), atol=2e-5)


@given(t=st.floats(0.0, 1.0, width=16))
def test_a_fractional_sharpness_blends(t: float) -> None:
    """Oracle: the smooth cube's first level and the sharp one's, linearly."""
    blend = cube(1, dict.fromkeys(CUBE_EDGES, t))
    expected = (1 - t) * cube() + t * cube(1, dict.fromkeys(CUBE_EDGES, 10))
    np.testing.assert_allclose(blend, expected, atol=1e-5)


def test_one_sharp_edge_is_a_dart() -> None:
    """Oracle: the rule of smooth vertices at its ends, and the middle of the edge itself."""
    fine = cube(1, {(6, 7): 10})
    np.testing.assert_allclose(fine[:8], CUBE_POINTS * 5 / 9, atol=1e-6)
    assert (fine[8:20] == [0, 1, 1]).all(axis=1).any()


def test_a_sharp_corner_stays() -> None:
    """Oracle: the point itself; at half sharpness halfway from it to the smooth one, 7/9."""
    corners: dict[str, Any] = {
        "corner_indices": np.int32([7, 6]),
        "corner_sharpnesses": np.float32([10, 0.5]),
    }
    fine = cube(1, **corners)
    np.testing.assert_allclose(fine[7], CUBE_POINTS[7])
    np.testing.assert_allclose(fine[6], CUBE_POINTS[6] * 7 / 9, rtol=1e-6)
    np.testing.assert_allclose(fine[5], CUBE_POINTS[5] * 5 / 9, rtol=1e-6)


def test_open_edges_are_splines_and_their_corners_stay_if_asked_to() -> None:
    """Oracle: (1 6 1) / 8 at the corner of a square is (1/8, 1/8); or the corner itself."""
    points, faces = grid(1, 1)
    round_ = surface(faces, 4, boundary="edgeOnly").points(points)
    np.testing.assert_allclose(round_[0], [0.125, 0.125, 0])
    pointed = surface(faces, 4, boundary="edgeAndCorner").points(points)
    np.testing.assert_array_equal(pointed[:4], points)


def test_without_boundaries_faces_at_open_edges_are_not_there() -> None:
    """Oracle: of 3 x 3 quads the middle one is left; all where open edges are creased."""
    _, faces = grid(3, 3)
    assert set(surface(faces, 16, boundary="none").faces) == {4}
    rim = [(0, 1), (1, 2), (2, 3), (3, 7), (7, 11), (11, 15), (14, 15), (13, 14), (12, 13)]
    rim += [(8, 12), (4, 8), (0, 4)]
    creased = surface(faces, 16, dict.fromkeys(rim, 10), boundary="none")
    assert set(creased.faces) == set(range(9))


def test_holes_shape_their_neighbours_and_are_not_there() -> None:
    """Oracle: the points of the whole cube, and the triangles of five faces."""
    whole, holed = surface(CUBE_FACES, 8), surface(CUBE_FACES, 8, holes=np.int32([2]))
    np.testing.assert_array_equal(whole.points(CUBE_POINTS), holed.points(CUBE_POINTS))
    np.testing.assert_array_equal(holed.triangles, whole.triangles[whole.faces != 2])


@pytest.mark.parametrize("scheme", ["catmullClark", "bilinear", "none"])
@pytest.mark.parametrize("left_handed", [False, True])
def test_triangles_of_a_cube_face_outwards(scheme: str, left_handed: bool) -> None:
    """Oracle: a positive volume; faces the other way round are left-handed ones."""
    faces = [face[::-1] for face in CUBE_FACES] if left_handed else CUBE_FACES
    it = surface(faces, 8, levels=2, scheme=scheme, left_handed=left_handed)
    points = it.points(CUBE_POINTS)
    size = volume(points, it.triangles)
    assert size > 0
    if scheme != "catmullClark":
        assert size == pytest.approx(8)
    normals = it.normals(points)
    if normals is None:
        assert scheme == "none"
    else:
        p = points[it.triangles]
        facing = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        assert (np.einsum("tk,tck->tc", facing, normals) > 0).all()


@pytest.mark.parametrize(
    ("scheme", "points", "faces"),
    [
        ("catmullClark", 8, CUBE_FACES),
        ("loop", 6, OCTAHEDRON_FACES),
        ("bilinear", 6, OCTAHEDRON_FACES),
    ],
)
def test_refinement_keeps_a_sphere_a_sphere(
    scheme: str, points: int, faces: list[list[int]]
) -> None:
    """Oracle: Euler: vertices - edges + faces = 2, and every edge is run along once each way."""
    it = surface(faces, points, levels=2, scheme=scheme)
    runs = np.concatenate(
        [it.triangles[:, [0, 1]], it.triangles[:, [1, 2]], it.triangles[:, [2, 0]]]
    )
    assert len(np.unique(runs, axis=0)) == len(runs)
    assert {tuple(run) for run in runs} == {tuple(run) for run in runs[:, ::-1]}
    assert len(np.unique(it.triangles)) - len(runs) // 2 + len(it.triangles) == 2


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 10_000),
    scheme=st.sampled_from(["catmullClark", "loop", "bilinear"]),
    boundary=st.sampled_from(["edgeOnly", "edgeAndCorner"]),
)
def test_refinement_commutes_with_affine_maps(seed: int, scheme: str, boundary: str) -> None:
    """Oracle: refine after the map; with all sharpness, fins and loose faces. Ones stay ones."""
    rng = np.random.default_rng(seed)
    faces = [rng.choice(9, 3, replace=False).tolist() for _ in range(rng.integers(1, 12))]
    pairs = {
        tuple(sorted(face[:2])): s for face, s in zip(faces, rng.uniform(0, 4, 4), strict=False)
    }
    it = surface(faces, 9, pairs, 2, scheme=scheme, boundary=boundary)
    points = rng.normal(size=(9, 3)).astype(np.float32)
    matrix, shift = rng.normal(size=(3, 3)), rng.normal(size=3)
    mapped = it.points((points @ matrix + shift).astype(np.float32))
    np.testing.assert_allclose(mapped, it.points(points) @ matrix + shift, atol=2e-5)
    ones = it.corners(np.ones(9), "vertex")
    np.testing.assert_allclose(ones, 1, atol=2e-6)


def test_three_faces_at_one_edge_make_it_sharp() -> None:
    """Oracle: the middle of the edge; its ends, where other edges are open, stay."""
    points = np.float32([[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]])
    points = np.concatenate(
        [points, np.float32([[-1, 0, 1], [-1, 1, 1], [-1, 0, -1], [-1, 1, -1]])]
    )
    it = surface([[0, 2, 3, 1], [0, 1, 5, 4], [0, 1, 7, 6]], 8, boundary="edgeOnly")
    fine = it.points(points)
    np.testing.assert_array_equal(fine[:2], points[:2])
    assert (fine == [0, 0.5, 0]).all(axis=1).any()


def test_normals_differ_across_sharp_edges_alone() -> None:
    """Oracle: those of a sharp cube's six sides; the diagonal at a smooth one's corner."""
    sharp = surface(CUBE_FACES, 8, dict.fromkeys(CUBE_EDGES, 10), 2)
    normals = sharp.normals(sharp.points(CUBE_POINTS))
    assert normals is not None
    np.testing.assert_allclose(
        np.sort(np.abs(normals), axis=2), np.broadcast_to([0, 0, 1], normals.shape), atol=1e-6
    )
    smooth = surface(CUBE_FACES, 8, levels=2)
    normals = smooth.normals(smooth.points(CUBE_POINTS))
    assert normals is not None
    at_corner = normals[smooth.triangles == 7]
    np.testing.assert_allclose(at_corner, np.full_like(at_corner, 3**-0.5), atol=1e-6)


def test_no_faces_make_no_triangles() -> None:
    """Oracle: arrays without rows, points that stay where they are."""
    for scheme in ("none", "catmullClark", "loop", "bilinear"):
        it = surface([], 2, scheme=scheme, levels=2)
        assert it.triangles.shape == (0, 3)
        assert it.points(np.ones((2, 3), np.float32)).shape[1] == 3
        assert it.corners(np.zeros((0, 2)), "faceVarying").shape == (0, 3, 2)


def test_a_pole_of_many_triangles_is_refined() -> None:
    """Oracle: the pole of a flat wheel stays in its middle, as all weights around it are equal."""
    n = 2000
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = np.concatenate([[[0, 0, 0]], rim]).astype(np.float32)
    faces = [[0, 1 + i, 1 + (i + 1) % n] for i in range(n)]
    for scheme in ("catmullClark", "loop"):
        fine = surface(faces, n + 1, {(0, 1): 0.5}, scheme=scheme).points(points)
        np.testing.assert_allclose(fine[0], 0, atol=1e-5)
        assert np.isfinite(fine).all()


def test_points_that_are_not_finite_spoil_what_is_near_them() -> None:
    """Oracle: the points around another corner of a grid, as they are without."""
    points, faces = grid(6, 6)
    it = surface(faces, 49)
    whole = it.points(points)
    points[0] = np.nan, np.inf, -np.inf
    assert np.array_equal(it.points(points)[48], whole[48])
    assert it.normals(it.points(points)) is not None
