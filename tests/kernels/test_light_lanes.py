"""Tests of casters that are evaluated sixteen at a time."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from usdsplat.kernels import light_lanes, lighting
from usdsplat.kernels.bins import grid_of, tile_lists, tiles_in
from usdsplat.kernels.casters import CASTER, enlarge, nearest_of
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.lanes import load
from usdsplat.kernels.position import VIEW
from usdsplat.kernels.project import RECORD
from usdsplat.kernels.ray_hit import CENTER, GX, GY, HX, HY, HZ, RAY_HIT, REACH, SPREAD

WIDTH = 64
COUNT = 900


def listed(rng, device):
    """Casters of two appearances in the order of their keys, and their lists by tile."""
    size = rng.uniform(1, 9, COUNT)
    records = np.zeros((COUNT, RECORD), np.float32)
    records[:, :2] = rng.uniform(-5, WIDTH + 5, (COUNT, 2))
    records[:, 2] = records[:, 4] = -0.5 / size**2
    records[:, 5] = np.log(rng.uniform(0.02, 0.98, COUNT))
    reach = 2 * (records[:, 5] + np.log(255.0))
    records[:, 6] = records[:, 7] = size * np.sqrt(reach)
    hits = np.zeros((COUNT, RAY_HIT), np.float32)
    hits[:, [GX, GY, HX, HY, HZ]] = rng.uniform(-0.01, 0.01, (COUNT, 5))
    hits[:, CENTER], hits[:, SPREAD] = rng.uniform(1, 3, COUNT), rng.uniform(0.01, 0.1, COUNT)
    hits[:, REACH] = hits[:, SPREAD] * np.sqrt(reach)
    order = np.argsort([nearest_of.py_func(hit) for hit in hits])
    records, hits = records[order], hits[order]
    casters, out = np.empty((COUNT, CASTER), np.float32), np.zeros_like(records)
    device.run(enlarge, records, hits, (np.arange(COUNT) % 2).astype(np.int32), casters, out)
    grid = grid_of(0, 0, WIDTH, WIDTH)
    starts, lists, _ = device.run(tile_lists, out, grid, tiles_in(grid), 4, buffers)
    return casters, (starts, lists, grid)


def buffers(_name, shape, dtype):
    return np.empty(shape, dtype)


def scene(rng, device, *, parallel, casts=(1, 1), own=1):
    """The arguments of `shine` before `get`, with receivers all over the picture."""
    casters, tiles = listed(rng, device)
    light = np.zeros(1, lighting.LIGHT)
    light["z"], light["kind"] = -1, lighting.DISTANT
    light["red"] = light["green"] = light["blue"] = 1
    light["cone_end"], light["distance"], light["casts"] = 9, -1, 1
    light["face"] = lighting.ALL_FACES
    n = 3000
    points = rng.uniform((-4, -4, 0.9), (WIDTH + 4, WIDTH + 4, 4), (n, 3))
    if not parallel:
        points[:, :2] *= points[:, 2:]
    normals = np.tile(np.float32([0, 0, -1, 1]), (n, 1))
    shapes = np.zeros((n, 6), np.float32)
    shapes[:, 5] = rng.uniform(0, 0.01, n)
    views = np.ones(2, VIEW)
    views["cx"] = views["cy"] = 0
    views["is_parallel"] = parallel
    matrix, lit = np.ascontiguousarray(np.eye(4)[:3]), lighting.ONE_PRIM
    return (
        light, points, normals, shapes, lighting.NO_PRIMS, lit, own, matrix, views,
        (casters, np.array(casts, np.uint8)), tiles, np.empty((0, 0), np.float32),
    )  # fmt: skip


@numba.njit
def product_of(x):
    return light_lanes.product(load(x, np.uint64(0)))


def test_a_product_is_that_of_halves_in_turn():
    """Oracle: NumPy in float32, in the same order."""
    numbers = np.random.default_rng(5).uniform(0.5, 2, 16).astype(np.float32)
    rest = numbers
    while len(rest) > 1:
        rest = rest[: len(rest) // 2] * rest[len(rest) // 2 :]
    assert product_of(numbers) == rest[0]


@pytest.mark.parametrize("parallel", [True, False])
def test_sixteen_casters_at_a_time_pass_what_each_does(parallel):
    """Oracle: the form of one caster after the other, which a GPU runs; receivers in full shadow,
    partly lit, and outside the picture."""
    device = open_device("cpu")
    args = scene(np.random.default_rng(3), device, parallel=parallel)
    expected, found = (np.zeros((len(args[1]), lighting.SUMS), np.float32) for _ in range(2))
    device.run(lighting.illuminate, *args, light_lanes.NO_THROUGH, expected)
    device.run(light_lanes.shine, *args, buffers, found)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    dark, lit = expected[:, 0] == 0, expected[:, 0] == 1
    assert dark.sum() > 100 and lit.sum() > 100 and (~dark & ~lit).sum() > 1000


@pytest.mark.parametrize("casts", [(1, 0), (0, 1), (0, 0)])
def test_appearances_that_cast_nothing_are_left_out(casts):
    """Oracle: the form of one caster after the other; without any caster all is lit."""
    device = open_device("cpu")
    args = scene(np.random.default_rng(6), device, parallel=True, casts=casts, own=-1)
    expected, found = (np.zeros((len(args[1]), lighting.SUMS), np.float32) for _ in range(2))
    device.run(lighting.illuminate, *args, light_lanes.NO_THROUGH, expected)
    device.run(light_lanes.shine, *args, buffers, found)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert (expected[:, 0] == 0).any() == any(casts)


def test_a_receiver_does_not_depend_on_those_beside_it(monkeypatch):
    """Oracle: all receivers at once, against every third alone and against small parts, bit for
    bit."""
    device = open_device("cpu")
    light, points, normals, shapes, *others = scene(np.random.default_rng(4), device, parallel=True)
    whole = np.zeros((len(points), lighting.SUMS), np.float32)
    device.run(light_lanes.shine, light, points, normals, shapes, *others, buffers, whole)
    third = tuple(np.ascontiguousarray(each[::3]) for each in (points, normals, shapes))
    some, parts = np.zeros_like(whole[::3]), np.zeros_like(whole)
    device.run(light_lanes.shine, light, *third, *others, buffers, some)
    np.testing.assert_array_equal(some, whole[::3])
    monkeypatch.setattr(light_lanes, "RECEIVERS", 700)
    device.run(light_lanes.shine, light, points, normals, shapes, *others, buffers, parts)
    np.testing.assert_array_equal(parts, whole)
