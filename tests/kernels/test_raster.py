"""Tests of coverage: each pixel belongs to one triangle of a sheet, and tile lists are complete."""

from __future__ import annotations

import numpy as np
import pytest

from tests.render.surface_scenes import screen_of, sheet
from usdsplat.kernels import bins, raster, triangles
from usdsplat.render.surfaces import view_record


def set_up(device, screen, points, corners):
    """What the raster kernels have of one double-sided mesh in camera space."""
    points = np.ascontiguousarray(points, np.float32)
    corners = np.ascontiguousarray(corners, np.int32)
    view = view_record(screen)
    appearance = np.zeros(1, triangles.APPEARANCE)
    appearance["double_sided"] = 1
    firsts, vertex_firsts = np.array([0, len(corners)]), np.array([0, len(points)])
    vertices = np.empty((len(points), triangles.VERTEX))
    boxes = np.empty((len(corners), 4), np.int32)
    matrices = np.eye(4)[None, :3]
    device.run(triangles.place, view, appearance, vertex_firsts, matrices, points, vertices)
    device.run(
        triangles.boxes, view, appearance, firsts, vertex_firsts, vertices, corners, boxes
    )  # fmt: skip
    return view, (appearance, firsts, vertex_firsts, corners, vertices), boxes


def times_covered(device, screen, points, corners):
    """How many triangles cover each pixel: each is drawn alone, into every tile."""
    view, shapes, boxes = set_up(device, screen, points, corners)
    grid = bins.grid_of(*screen.window)
    x0, y0, x1, y1 = screen.window
    tiles = int(grid["columns"][0] * grid["rows"][0])
    depth = np.empty((y1 - y0, x1 - x0), np.float32)
    winner = np.empty(depth.shape, np.int32)
    total = np.zeros(depth.shape, np.int64)
    starts = np.arange(tiles + 1)
    for t in range(len(corners)):
        lists = np.full(tiles, t, np.int32)
        device.run(raster.raster, view, shapes, boxes, grid, starts, lists, depth, winner)
        total += winner >= 0
    return total


def jittered(screen, columns, rows, rng, *, jitter, depths):
    """A sheet that fills the picture and more, each vertex moved along and across its ray."""
    width, height = screen.size
    points, corners, _ = sheet(
        columns, rows, lambda u, v: (u * (width + 40) - 20, v * (height + 40) - 20, u)
    )
    step = np.array([(width + 40) / columns, (height + 40) / rows])
    pixel = points[:, :2] + jitter * step * rng.uniform(-1, 1, (len(points), 2))
    z = rng.uniform(*depths, len(points))
    scale = 1.0 if screen.orthographic else z[:, None]
    points = np.concatenate(
        [(pixel - screen.center) / screen.focal * scale, z[:, None]], axis=1
    )  # fmt: skip
    turned = rng.random(len(corners)) < 0.5
    corners[turned] = corners[turned][:, ::-1]
    return points, corners[:, np.array([1, 2, 0])]


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_a_sheet_covers_each_pixel_once(device, orthographic, seed):
    """Oracle: a triangulation of the plane; corners at random, and depths too."""
    screen = screen_of((90, 70), orthographic=orthographic)
    points, corners = jittered(
        screen, 9, 8, np.random.default_rng(seed), jitter=0.3, depths=(0.2, 5.0)
    )
    np.testing.assert_array_equal(times_covered(device, screen, points, corners), 1)


@pytest.mark.parametrize("orthographic", [False, True])
def test_corners_on_pixels_are_covered_once(device, orthographic):
    """Oracle: a triangulation of the plane whose every corner is a pixel's centre up to
    rounding."""
    screen = screen_of((60, 40), orthographic=orthographic)
    rng = np.random.default_rng(4)
    points, corners = jittered(screen, 25, 20, rng, jitter=0.0, depths=(3.0, 3.0))
    assert len(points) == 26 * 21
    np.testing.assert_array_equal(times_covered(device, screen, points, corners), 1)


@pytest.mark.parametrize("seed", range(3))
def test_a_floor_through_the_near_plane_has_no_cracks(device, seed):
    """Oracle: the plane's closed form; the sheet reaches from behind the eye to the distance."""
    screen = screen_of((80, 60), clip=(0.25, 1e3))
    rng = np.random.default_rng(seed)
    points, corners, _ = sheet(7, 9, lambda u, v: (80 * (u - 0.5), np.ones_like(u), 50 * v**2 - 3))
    inner = (abs(points[:, 0]) < 39) & (points[:, 2] > -2.9) & (points[:, 2] < 46)
    points[inner] += rng.uniform(-0.1, 0.1, (inner.sum(), 3)) * [30, 0, 3]
    v, u = np.indices((60, 80))
    with np.errstate(divide="ignore"):
        z = screen.focal[1] / (v - screen.center[1])
    x = (u - screen.center[0]) / screen.focal[0] * z
    expected = (z >= 0.25) & (z <= 47) & (abs(x) <= 40)
    assert 1000 < expected.sum() < expected.size
    np.testing.assert_array_equal(times_covered(device, screen, points, corners), expected)


def test_the_edge_belongs_to_the_left_and_the_top(device):
    """Oracle: the top-left rule; a square whose corners are pixel centres."""
    screen = screen_of((16, 16), orthographic=True)
    pixel = np.array([[4, 5], [9, 5], [9, 8], [4, 8]], float)
    points = np.c_[(pixel - screen.center) / screen.focal, np.full(4, 2.0)]
    expected = np.zeros((16, 16))
    expected[5:8, 4:9] = 1
    for corners in ([[0, 1, 2], [0, 2, 3]], [[1, 3, 0], [3, 1, 2]]):
        np.testing.assert_array_equal(times_covered(device, screen, points, corners), expected)


@pytest.mark.parametrize("chunks", [1, 5])
def test_lists_hold_every_tile_that_a_triangle_covers_in_order(device, chunks):
    """Oracle: drawing every triangle into every tile gives the same picture."""
    screen = screen_of((200, 150), data=(-20, -9, 230, 170))
    rng = np.random.default_rng(7)
    large = rng.normal(size=(40, 3, 3)) * [1.5, 1.5, 2] + [0, 0, 3]
    small = rng.uniform([-0.6, -0.4, 0.8], [0.7, 0.5, 1.2], (60, 1, 3))
    points = np.concatenate([large, small + 0.05 * rng.normal(size=(60, 3, 3))]).reshape(-1, 3)
    corners = np.arange(300).reshape(-1, 3)
    view, shapes, boxes = set_up(device, screen, points, corners)
    grid = bins.grid_of(*screen.window)
    tiles = int(grid["columns"][0] * grid["rows"][0])
    starts, lists, _ = device.run(
        raster.tile_lists, view, shapes, boxes, grid, tiles, chunks,
        lambda _, shape, dtype: device.resident(shape, dtype),
    )  # fmt: skip
    starts, lists = device.fetch(starts), device.fetch(lists)
    assert len(lists) < 0.7 * tiles * len(corners), "there is something to leave out"
    for tile in range(tiles):
        assert np.all(np.diff(lists[starts[tile] : starts[tile + 1]]) > 0)
    pictures = []
    every = np.tile(np.arange(100, dtype=np.int32), tiles)
    for begin, rows in ((starts, lists), (np.arange(tiles + 1) * 100, every)):
        depth, winner = np.empty((179, 250), np.float32), np.empty((179, 250), np.int32)
        device.run(raster.raster, view, shapes, boxes, grid, begin, rows, depth, winner)
        pictures.append((depth, winner))
    np.testing.assert_array_equal(pictures[0][0], pictures[1][0])
    np.testing.assert_array_equal(pictures[0][1], pictures[1][1])
    assert len(np.unique(pictures[0][1])) > 20, "there is something to see"
