"""Tests of plain point clouds, which are read as splats."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat import formats
from usdsplat.core.errors import FormatError
from usdsplat.core.sh import dc_to_rgb
from usdsplat.formats.ply.points import LONE_SIGMA, LONGEST, neighbour_distances


def write_points(path, positions, colors=None, *, kind="u1", names=("red", "green", "blue")):
    """Points as plyfile writes them."""
    from plyfile import PlyData, PlyElement

    fields = [(axis, "f4") for axis in "xyz"]
    fields += [(name, kind) for name in names] if colors is not None else []
    rows = np.zeros(len(positions), fields)
    for index, axis in enumerate("xyz"):
        rows[axis] = positions[:, index]
    for index, name in enumerate(names if colors is not None else ()):
        rows[name] = colors[:, index]
    PlyData([PlyElement.describe(rows, "vertex")]).write(path)
    return path


@pytest.mark.parametrize(
    ("kind", "white", "names"),
    [
        ("u1", 255, ("red", "green", "blue")),
        ("u2", 65535, ("red", "green", "blue")),
        ("f4", 1.0, ("red", "green", "blue")),
        ("u1", 255, ("diffuse_red", "diffuse_green", "diffuse_blue")),
    ],
)
def test_points_become_opaque_balls_of_their_colour(tmp_path, kind, white, names):
    """Oracle: the range of the type is 0 to 1; a ball is as wide in every direction."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 3, 0]], np.float32)
    colors = np.array([[white, 0, 0], [0, white, 0], [white, white, white]])
    path = write_points(tmp_path / "p.ply", positions, colors, kind=kind, names=names)
    capture = formats.read(path)
    cloud = capture.cloud
    np.testing.assert_allclose(dc_to_rgb(cloud.sh[:, 0]), colors / white, atol=1e-6)
    assert cloud.positions.tolist() == positions.tolist()
    assert cloud.opacities.tolist() == [1, 1, 1]
    assert cloud.rotations.tolist() == [[1, 0, 0, 0]] * 3
    assert np.ptp(cloud.scales, axis=1).tolist() == [0, 0, 0]
    assert cloud.scales[:2, 0].tolist() == [0.5, 0.5]
    assert "plain points" in capture.notes[0] and capture.format.startswith("PLY points")


def test_points_without_colour_are_grey(tmp_path):
    """Oracle: degree-0 coefficients of 0 are 0.5 by definition."""
    path = write_points(tmp_path / "p.ply", np.eye(3, dtype=np.float32))
    assert not formats.read(path).cloud.sh.any()


def test_a_point_that_is_not_finite_is_named(tmp_path):
    """Oracle: the row that was spoilt."""
    positions = np.zeros((9, 3), np.float32)
    positions[4, 1] = np.nan
    with pytest.raises(FormatError, match="property y of splat 4: found nan"):
        formats.read(write_points(tmp_path / "p.ply", positions))


def test_no_points_and_one_point_are_clouds(tmp_path):
    """Oracle: a lone point has no neighbour to measure by."""
    assert len(formats.read(write_points(tmp_path / "p.ply", np.zeros((0, 3)))).cloud) == 0
    lone = formats.read(write_points(tmp_path / "q.ply", np.ones((1, 3)))).cloud
    np.testing.assert_allclose(lone.scales, LONE_SIGMA)


@pytest.mark.parametrize("shape", ["sphere", "volume", "clusters"])
def test_distances_are_nearly_those_of_the_nearest_neighbours(shape):
    """Oracle: all pairs, in float64."""
    rng = np.random.default_rng(5)
    points = rng.normal(size=(1500, 3))
    if shape == "sphere":
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    if shape == "clusters":
        points = points * 1e-3 + rng.normal(size=(15, 3))[rng.integers(0, 15, 1500)]
    points = points.astype(np.float32)
    gaps = np.linalg.norm(points[:, None].astype(np.float64) - points[None], axis=2)
    np.fill_diagonal(gaps, np.inf)
    true = gaps.min(axis=1)
    found = neighbour_distances(points)
    cap = LONGEST * np.median(found)
    assert np.all(found >= np.minimum(true, cap) * (1 - 1e-5))
    assert np.mean(found <= true * 1.001) > 0.7
    assert np.quantile(found / true, 0.95) < 1.6


def test_repeated_and_stray_points_are_put_right():
    """Oracle: a row of points 1 apart, each twice, and one far away."""
    row = np.arange(100, dtype=np.float32)
    points = np.stack([np.repeat(row, 2), np.zeros(200), np.zeros(200)], axis=1)
    points = np.concatenate([points, [[1e4, 0, 0]]]).astype(np.float32)
    found = neighbour_distances(points)
    assert np.all(found[:200] == 1)
    assert found[200] == LONGEST


def test_points_at_the_ends_of_float32_stay_finite():
    """Oracle: distances of 6e38 are no float32."""
    points = np.array([[3e38, 0, 0], [-3e38, 0, 0]], np.float32)
    assert np.isfinite(neighbour_distances(points)).all()
