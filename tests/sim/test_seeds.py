"""Tests of the initial seeds of a pattern."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim.neighbors import Neighbors
from usdsplat.sim.parameters import NeighborsParameters, RdParameters
from usdsplat.sim.seeds import SEED_RADIUS, nuclei, plant, untouched

POINTS = np.random.default_rng(7).uniform(0, 100, (20_000, 3)).astype(np.float32) * np.float32(
    [1, 1, 0]
)


def test_points_are_balls_about_the_chosen() -> None:
    """Oracle: what a Poisson process covers, 1 - exp(-density * area), within four deviations; and
    no nucleus is smaller than its radius."""
    rd = RdParameters(seed_density=0.002)
    found = nuclei(open_device(), POINTS, rd, 1.0, seed=1)
    centres = 0.002 * len(POINTS)
    covered = 1 - np.exp(-centres * np.pi * SEED_RADIUS**2 / 1e4)
    assert set(np.unique(found)) == {0, 1}
    assert found.mean() == pytest.approx(covered, abs=4 * covered / np.sqrt(centres))


def test_one_at_least_and_none_where_none_is_wanted() -> None:
    """Oracle: the docstring."""
    device = open_device()
    tiny = nuclei(device, POINTS[:50], RdParameters(seed_density=1e-6), 0.1)
    assert tiny.sum() >= 1
    assert nuclei(device, POINTS, RdParameters(seed_density=0.0), 1.0).sum() == 0
    assert len(nuclei(device, POINTS[:0], RdParameters(), 1.0)) == 0


def test_no_part_goes_without() -> None:
    """Oracle: two sheets that do not touch, the second too small to expect a centre by chance."""
    device = open_device()
    grid = np.stack(np.meshgrid(*[np.arange(20.0)] * 2), -1).reshape(-1, 2).astype(np.float32)
    flat = np.concatenate([grid, grid[:280] + np.float32([500, 500])])
    points = np.concatenate([flat, np.zeros((len(flat), 1), np.float32)], 1)
    neighbors = Neighbors(device, NeighborsParameters(), symmetric=True)
    graph = neighbors.update(points, np.full(len(points), 2.3, np.float32))
    rd = RdParameters(seed_density=0.002)
    for seed in range(20):
        found = nuclei(device, points, rd, 0.2, seed=seed, graph=graph)
        assert found[:400].any()
        assert found[400:].any()
    lonely = [nuclei(device, points, rd, 0.2, seed=seed)[400:].any() for seed in range(20)]
    assert not all(lonely)


def test_noise_covers_as_much_in_patches() -> None:
    """Oracle: the part asked for; neighbours mostly agree, for patches are 10 lattice units."""
    found = nuclei(open_device(), POINTS, RdParameters(seed_mode="noise"), 1.0, seed=3)
    assert found.mean() == pytest.approx(0.002 * np.pi * 25, abs=1e-3)
    order = np.lexsort((POINTS[:, 0] % 1, POINTS[:, 1] // 1, POINTS[:, 0] // 1))
    first, second = order[:-1], order[1:]
    close = np.linalg.norm(POINTS[first] - POINTS[second], axis=1) < 1
    assert (found[first] == found[second])[close].mean() > 0.93


def test_a_selection_is_a_nucleus() -> None:
    """Oracle: weights above one half."""
    rd = RdParameters(seed_mode="selection")
    weight = np.linspace(0, 1, 100, dtype=np.float32)
    found = nuclei(open_device(), POINTS[:100], rd, 1.0, selection=weight)
    np.testing.assert_array_equal(found, weight > 0.5)
    assert nuclei(open_device(), POINTS[:100], rd, 1.0).all()


@pytest.mark.parametrize("mode", ["points", "noise"])
def test_they_hang_on_seed_and_identity_alone(mode) -> None:
    """Oracle: the same on one thread and for permuted rows; others for another seed."""
    rd = RdParameters(seed_mode=mode)
    ids = np.arange(len(POINTS))
    found = nuclei(open_device(), POINTS, rd, 1.0, seed=5)
    again = nuclei(CpuDevice(threads=1), POINTS[::-1].copy(), rd, 1.0, seed=5, ids=ids[::-1].copy())
    np.testing.assert_array_equal(again[::-1], found)
    assert (nuclei(open_device(), POINTS, rd, 1.0, seed=6) != found).any()


def test_planting() -> None:
    """Oracle: (0.5, 0.25) in a nucleus, (1, 0) elsewhere."""
    uv = untouched(2)
    plant(open_device(), uv, np.array([0, 1], np.float32))
    np.testing.assert_array_equal(uv, [[1, 0], [0.5, 0.25]])
