"""Tests of the triangulation of polygons."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.core.cloud import F64
from usdsplat.core.surface.refine import Surface
from usdsplat.core.surface.topology import Topology
from usdsplat.core.surface.triangulate import triangulate

SHAPES = {
    "square": [[0, 0], [1, 0], [1, 1], [0, 1]],
    "dart with its notch at the second corner": [[0, 2], [1, 0.5], [2, 2], [1, -2]],
    "dart with its notch at the first corner": [[1, 0.5], [2, 2], [1, -2], [0, 2]],
    "L": [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]],
    "U": [[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]],
    "comb": [[0, 0], [7, 0], [7, 3], [6, 1], [5, 3], [4, 1], [3, 3], [2, 1], [1, 3], [0, 1]],
    "ring with a bridge": [
        *([0, 0], [3, 0], [3, 3], [0, 3], [0, 0]),
        *([1, 1], [1, 2], [2, 2], [2, 1], [1, 1]),
    ],
}


def area(polygon: F64) -> float:
    """Signed area by the shoelace formula."""
    x, y = polygon.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("turn", range(3))
@pytest.mark.parametrize("reverse", [False, True])
def test_triangles_cover_the_polygon_once(name: str, turn: int, reverse: bool) -> None:
    """Oracle: all have the polygon's sense, and areas that add up to its own; in any plane."""
    flat = np.array(SHAPES[name], np.float64)
    flat = flat[::-1] if reverse else flat
    if name.startswith("dart"):
        flat = flat[::-1]
    points = np.roll(np.concatenate([flat, np.ones((len(flat), 1))], axis=1), turn, axis=1)
    cuts, owner = triangulate(np.array([len(flat)]), np.arange(len(flat)), points)
    assert (owner == 0).all()
    assert len(cuts) == len(flat) - 2
    areas = np.array([area(flat[cut]) for cut in cuts]) * np.sign(area(flat))
    assert (areas > -1e-12).all()
    assert areas.sum() == pytest.approx(abs(area(flat)))


def test_polygons_keep_their_order() -> None:
    """Oracle: a triangle, a pentagon and a quad, fans written out."""
    cuts, owner = triangulate(np.array([3, 5, 4]), np.arange(12), None)
    assert owner.tolist() == [0, 1, 1, 1, 2, 2]
    fans = [[0, 1, 2], [3, 4, 5], [3, 5, 6], [3, 6, 7], [8, 9, 10], [8, 10, 11]]
    assert cuts.tolist() == fans


def test_the_cut_is_that_of_the_rest_points() -> None:
    """Oracle: a dart is cut through its notch, whatever points are asked for later."""
    dart = np.float32([[0, 0, 0], [2, -2, 0], [1, 0, 0], [2, 2, 0]])
    rest = dart[[1, 2, 3, 0]]
    topology = Topology(
        counts=np.int32([4]), indices=np.int32([0, 1, 2, 3]), scheme="none", left_handed=False
    )
    surface = Surface(topology, points=4, rest=rest)
    assert surface.triangles.tolist() == [[3, 0, 1], [1, 2, 3]]
    np.testing.assert_array_equal(surface.points(2 * dart), 2 * dart)
    handed = Topology(
        counts=np.int32([4]), indices=np.int32([0, 1, 2, 3]), scheme="none", left_handed=True
    )
    assert Surface(handed, points=4, rest=rest).triangles.tolist() == [[3, 1, 0], [1, 3, 2]]


def test_a_polygon_that_crosses_itself_is_cut_all_the_same() -> None:
    """Oracle: as many triangles as corners but two, no corner unknown."""
    star = np.array([[np.cos(a), np.sin(a), 0] for a in 4 * np.pi / 5 * np.arange(5)])
    bow = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]], np.float64)
    for points in (star, bow, np.zeros((6, 3))):
        cuts, _ = triangulate(np.array([len(points)]), np.arange(len(points)), points)
        assert cuts.shape == (len(points) - 2, 3)
        assert set(cuts.ravel()) == set(range(len(points)))
