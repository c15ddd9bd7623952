"""Tests of closest points, rays and winding numbers of meshes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.sim.shapes import sheet, soup, sphere
from usdsplat.core.errors import StageError
from usdsplat.kernels.devices import open_device
from usdsplat.sim.closest import Triangles
from usdsplat.sim.specs import Surface


@pytest.fixture(scope="module")
def device(any_device):
    return open_device()


def corners_of(surface):
    return surface.points.astype(np.float64)[surface.triangles]


def squared_distances(points, corners):
    """Of all points to all triangles, float64, (n, t): the plane's where the foot is inside by
    the barycentric equations, else the least of the edges'."""
    p = points[:, None].astype(np.float64)
    a, b, c = corners[None, :, 0], corners[None, :, 1], corners[None, :, 2]
    best = np.full((p.shape[0], a.shape[1]), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        length = np.maximum((edge * edge).sum(-1), 1e-300)
        part = np.clip(((p - start) * edge).sum(-1) / length, 0, 1)
        apart = p - start - part[..., None] * edge
        best = np.minimum(best, (apart * apart).sum(-1))
    normal = np.cross(b - a, c - a)
    area = np.maximum((normal * normal).sum(-1), 1e-300)
    v = (np.cross(p - a, c - a) * normal).sum(-1) / area
    w = (np.cross(b - a, p - a) * normal).sum(-1) / area
    plane = ((p - a) * normal).sum(-1) ** 2 / area
    inside = (v >= 0) & (w >= 0) & (v + w <= 1) & (area > 1e-300)
    return np.where(inside, np.minimum(best, plane), best)


@pytest.mark.parametrize("count", [1, 5, 777])
def test_closest_points_are_those_of_all_triangles_tried(device, count):
    """Oracle: brute force in float64. A face may differ only where another is as close."""
    surface = soup(count, 1)
    points = np.random.default_rng(2).uniform(-2, 2, (1500, 3)).astype(np.float32)
    hits = Triangles(device, surface).closest(points)
    all_squared = squared_distances(points, corners_of(surface))
    least = all_squared.min(axis=1)
    assert np.allclose(hits.squared, least, rtol=1e-6, atol=1e-12)
    own = all_squared[np.arange(len(points)), hits.faces]
    assert np.all(own <= least + 1e-12)
    rebuilt = np.einsum("nk,nkx->nx", hits.weights, corners_of(surface)[hits.faces])
    assert np.abs(rebuilt - hits.points).max() <= 1e-6
    assert hits.weights.min() >= -1e-7
    away = np.linalg.norm(points - hits.points.astype(np.float64), axis=1)
    assert np.abs(away - np.sqrt(least)).max() <= 1e-6


def test_of_equally_close_triangles_the_lowest_row_is_found(device):
    """Oracle: by hand: points above a corner that many triangles share, above edges, and copies
    of one triangle, whatever the order of rows."""
    surface = sheet(8)
    rng = np.random.default_rng(3)
    triangles = surface.triangles[rng.permutation(len(surface.triangles))]
    turned = np.stack([np.roll(row, k % 3) for k, row in enumerate(triangles)])
    surface = Surface(points=surface.points, triangles=np.concatenate([turned, turned]))
    corners = corners_of(surface)
    at = surface.points + np.array([0, 0, 0.5], np.float32)
    edges = (surface.points[turned[:, 0]] + surface.points[turned[:, 1]]) / 2
    edges = edges + np.array([0, 0, 0.25], np.float32)
    points = np.concatenate([at, edges]).astype(np.float32)
    hits = Triangles(device, surface).closest(points)
    expected = np.argmin(squared_distances(points, corners), axis=1)
    assert np.array_equal(hits.faces, expected)


def test_nothing_is_found_beyond_the_limit(device):
    """Oracle: distance to the plane z = 0."""
    points = np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.5], [np.nan, 0, 0]], np.float32)
    hits = Triangles(device, sheet(4)).closest(points, within=0.4)
    assert hits.faces[0] >= 0 and hits.faces[1] == -1 and hits.faces[2] == -1
    assert hits.squared[0] == pytest.approx(0.09, rel=1e-6) and np.isinf(hits.squared[1])
    assert np.array_equal(hits.points[1], points[1])


def hit_ways(origins, directions, corners):
    """Ways of all rays to all triangles by Möller and Trumbore, float64, (n, t), inf: misses."""
    o, d = origins[:, None].astype(np.float64), directions[:, None].astype(np.float64)
    a, b, c = corners[None, :, 0], corners[None, :, 1], corners[None, :, 2]
    across = np.cross(d, c - a)
    determinant = ((b - a) * across).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((o - a) * across).sum(-1) / determinant
        v = (d * np.cross(o - a, b - a)).sum(-1) / determinant
        way = ((c - a) * np.cross(o - a, b - a)).sum(-1) / determinant
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (way >= 0) & (determinant != 0)
    return np.where(hit, way, np.inf)


def test_rays_hit_what_all_triangles_tried_give(device):
    """Oracle: another algorithm, Möller-Trumbore, over all triangles in float64."""
    surface = soup(600, 4)
    rng = np.random.default_rng(5)
    origins = rng.uniform(-2, 2, (2000, 3)).astype(np.float32)
    directions = (rng.uniform(-0.7, 0.7, (2000, 3)) - origins).astype(np.float32)
    directions[:400, rng.integers(0, 3)] = 0
    directions[400:500, :2] = 0
    hits = Triangles(device, surface).rays(origins, directions)
    ways = hit_ways(origins, directions, corners_of(surface))
    least = ways.min(axis=1)
    assert 300 < np.isfinite(least).sum() < 1990
    assert np.array_equal(hits.faces >= 0, np.isfinite(least))
    found = hits.faces >= 0
    way = least[found, None] * directions[found]
    assert np.allclose(hits.squared[found], (way * way).sum(axis=1), rtol=1e-5, atol=1e-9)
    assert np.abs(hits.points[found] - (origins[found] + way)).max() <= 1e-5


def test_no_ray_slips_through_an_edge(device):
    """Oracle: the sheet has no holes; rays at its grid's lines and corners, from above, askew."""
    surface = sheet(16)
    inner = surface.points[(np.abs(surface.points) < 0.99).all(axis=1)]
    origins = (inner + np.array([0.37, 0.11, 0.83])).astype(np.float32)
    hits = Triangles(device, surface).rays(origins, inner - origins)
    assert np.all(hits.faces >= 0)
    assert np.abs(hits.squared - ((inner - origins) ** 2).sum(axis=1)).max() <= 1e-6
    missing = Triangles(device, surface).rays(origins, np.zeros_like(origins))
    assert np.all(missing.faces == -1)


def exact_winding(points, corners):
    """Sum of solid angles in float64: interior angles of spherical triangles (Girard)."""
    total = np.zeros(len(points))
    for triangle in corners:
        ray = triangle[None] - points[:, None].astype(np.float64)
        ray /= np.linalg.norm(ray, axis=2, keepdims=True)
        normals = [np.cross(ray[:, k], ray[:, (k + 1) % 3]) for k in range(3)]
        normals = [x / np.maximum(np.linalg.norm(x, axis=1), 1e-300)[:, None] for x in normals]
        excess = -np.pi * np.ones(len(points))
        for k in range(3):
            cosine = -(normals[k] * normals[(k + 1) % 3]).sum(1)
            excess += np.arccos(np.clip(cosine, -1, 1))
        side = np.sign((ray[:, 0] * np.cross(ray[:, 1], ray[:, 2])).sum(1))
        total += side * excess
    return total / (4 * np.pi)


@pytest.mark.parametrize("part", [1.0, 0.8], ids=["closed", "open"])
def test_winding_numbers_are_sums_of_solid_angles(device, part):
    """Oracle: Girard's sum of angles over all triangles, float64; the distant groups cost less
    than 0.02, and the closed sphere is 1 inside and 0 outside."""
    surface = sphere(3)
    keep = surface.points[surface.triangles].mean(axis=1)[:, 2] < 2 * part - 1
    surface = Surface(points=surface.points, triangles=surface.triangles[keep])
    points = np.random.default_rng(6).uniform(-1.5, 1.5, (400, 3)).astype(np.float32)
    tree = Triangles(device, surface)
    expected = exact_winding(points, corners_of(surface))
    every, grouped = tree.winding(points, far=np.inf), tree.winding(points)
    assert np.abs(every - expected).max() <= 1e-5
    assert np.abs(grouped - expected).max() <= 0.02
    if part == 1:
        radius = np.linalg.norm(points, axis=1)
        off = np.abs(radius - 1) > 0.02
        assert np.array_equal((grouped > 0.5)[off], (radius < 1)[off])


def test_a_mesh_that_moved_answers_as_one_built_there(device):
    """Oracle: a tree built anew; the answers' bits, but for a box's order nothing depends on."""
    before, rng = sphere(3), np.random.default_rng(7)
    moved = before.points * [1, 2, 0.5] + 0.1 * np.sin(7 * before.points[:, [1, 2, 0]])
    after = Surface(points=moved.astype(np.float32), triangles=before.triangles)
    points = rng.uniform(-2, 2, (3000, 3)).astype(np.float32)
    tree = Triangles(device, before)
    tree.winding(points)
    tree.refit(after)
    fresh = Triangles(device, after)
    for found, expected in (
        (tree.closest(points), fresh.closest(points)),
        (tree.rays(points, -points), fresh.rays(points, -points)),
    ):
        for name in ("faces", "weights", "squared", "points"):
            assert np.array_equal(getattr(found, name), getattr(expected, name))
    assert np.abs(tree.winding(points) - fresh.winding(points)).max() <= 0.02


def test_answers_have_the_same_bits_on_any_number_of_threads():
    """Oracle: one thread."""
    points = np.random.default_rng(8).uniform(-2, 2, (5000, 3)).astype(np.float32)
    bits = []
    for threads in (1, 2):
        tree = Triangles(open_device(threads=threads), sphere(4))
        close, seen = tree.closest(points), tree.rays(points, -points)
        arrays = (close.faces, close.weights, close.squared, close.points)
        arrays += (seen.faces, seen.weights, seen.squared, seen.points, tree.winding(points))
        bits.append([a.tobytes() for a in arrays])
    assert bits[0] == bits[1]


def test_meshes_that_cannot_be_questioned_are_one_sentence(device):
    """Oracle: the sentences."""
    good = sheet(2)
    bad = good.points.copy()
    bad[3, 1] = np.inf
    for points, triangles, said in (
        (good.points, good.triangles[:0], "no triangles"),
        (good.points, good.triangles + 5, "a point that does not exist"),
        (bad, good.triangles, "a point that is not finite"),
    ):
        with pytest.raises(StageError, match=said):
            Triangles(device, Surface(points=points, triangles=triangles))
    with pytest.raises(StageError, match="other triangles"):
        Triangles(device, good).refit(sheet(3))
