"""Tests of benchmarks.lod_world: the cities of `benchmarks.lod_scale`."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import UsdGeom

from benchmarks import lod_world
from usdsplat.core.quaternion import to_matrix
from usdsplat.core.sh import evaluate
from usdsplat.interchange import files


def test_spiral():
    """A square number of tiles fills a square around the origin without a gap. Oracle: the grid."""
    for edge in (1, 3, 5):
        half = range(-(edge // 2), edge // 2 + 1)
        assert set(lod_world.spiral(edge * edge)) == {(x, z) for x in half for z in half}


def test_tiles_lie_side_by_side_and_differ():
    """A tile lies on its square, but for the leaves of trees, and tiles differ. Oracle: the
    declared edge."""
    first, second = (lod_world.city_tile(number, 4000) for number in (0, 1))
    assert len(first) == len(second) == 4000
    reach = np.abs(first.positions[:, [0, 2]])
    assert np.mean(reach <= lod_world.EDGE / 2) > 0.99
    column, row = lod_world.spiral(2)[1]
    moved = second.positions - lod_world.EDGE * np.float32([column, 0, row])
    assert np.mean(np.abs(moved[:, [0, 2]]) <= lod_world.EDGE / 2) > 0.99
    assert not np.array_equal(np.sort(moved[:, 1]), np.sort(first.positions[:, 1]))


def test_walls_are_flat():
    """Splats of the ground and of the walls are thin across them. Oracle: the ground's normal is
    y."""
    tile = lod_world.city_tile(0, 4000)
    ground = tile.positions[:, 1] == 0
    assert ground.sum() > 500
    normals = to_matrix(tile.rotations[ground].astype(np.float64))[:, :, 2]
    assert np.abs(normals[:, 1]).min() == pytest.approx(1, abs=1e-5)
    assert (tile.scales[ground, 2] < tile.scales[ground, :2].mean(axis=1)).mean() > 0.99


def test_degrees_have_the_same_city():
    """A tile of degree 3 has the splats of that of degree 0, whose highlights are brightest from
    where the ground mirrors the sun. Oracle: the law of reflection."""
    plain, glossy = (lod_world.city_tile(0, 4000, degree) for degree in (0, 3))
    np.testing.assert_array_equal(glossy.positions, plain.positions)
    np.testing.assert_array_equal(glossy.sh[:, :1], plain.sh)
    ground = glossy.sh[glossy.positions[:, 1] == 0]
    towards = np.random.default_rng(0).normal(size=(500, 3))
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    mean = evaluate(np.broadcast_to(ground.mean(axis=0), (500, 16, 3)), towards)[:, 0]
    x, y, z = lod_world._SUN
    assert towards[mean.argmax()] @ [x, -y, z] > 0.95


def test_tiles_are_made_once(tmp_path):
    """Tiles that exist are not written again. Oracle: the times of the files."""
    paths = lod_world.write_tiles(tmp_path, 1000, processes=1)
    assert [path.name for path in paths] == ["tile_0000_1000.usdc"]
    before = paths[0].stat().st_mtime_ns
    assert lod_world.write_tiles(tmp_path, 1000, processes=1) == paths
    assert paths[0].stat().st_mtime_ns == before


def test_instances(tmp_path):
    """Instances stand in a square grid, one of them at the origin. Oracle: the grid."""
    [tile] = lod_world.write_tiles(tmp_path, 1000, processes=1)
    lod_world.write_instances(tmp_path / "many.usda", tile, 9, 10.0)
    stage = files.open_stage(tmp_path / "many.usda")
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath("/world/cities"))
    places = np.array(instancer.GetPositionsAttr().Get())
    assert len(places) == 9 and not places[0].any()
    step = 10.0 * lod_world.GAP
    grid = [(x * step, z * step) for x in (-1, 0, 1) for z in (-1, 0, 1)]
    np.testing.assert_allclose(np.sort(places[:, [0, 2]], axis=0), np.sort(grid, axis=0), rtol=1e-6)
