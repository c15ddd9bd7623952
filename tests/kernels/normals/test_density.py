"""Tests of grids of optical density, and of rays through them."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.kernels.devices import open_device
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.normals.density import optical_depth
from usdsplat.kernels.points.optical_grids import OpticalGrids


@kernel(over="out", writes=("out",))
def depths(i, density, origins, directions, reach, out):
    """Write the optical depth of each ray."""
    out[i] = optical_depth(
        density, origins[i, 0], origins[i, 1], origins[i, 2], directions[i, 0], directions[i, 1],
        directions[i, 2], 0.5, reach,
    )  # fmt: skip


def grids_of(positions, scales, opacities, cell):
    """The grids of unturned splats."""
    rotations = np.tile(np.float32([1, 0, 0, 0]), (len(positions), 1))
    arrays = (np.float32(positions), rotations, np.float32(scales), np.float32(opacities))
    return OpticalGrids.of(open_device(), *arrays, cell=cell)


@pytest.mark.parametrize("opacity", [0.1, 0.5, 0.95])
def test_rays_through_a_sheet_collect_its_optical_depth(opacity: float) -> None:
    """Oracle: closed form: splats per area times the integral of one, -ln(1 - o exp(-r^2 / 2)),
    by NumPy. Steps of rays grow, so that a thin sheet may count up to 1.8 times."""
    at = np.stack(np.meshgrid(np.arange(60), np.arange(60)), axis=-1).reshape(-1, 2) - 29.5
    positions = np.concatenate([at, np.zeros((3600, 1))], axis=1)
    grids = grids_of(positions, np.tile([0.6, 0.6, 0.05], (3600, 1)), np.full(3600, opacity), 1.5)
    r = np.linspace(0, 8, 20001)
    mass = 2 * np.pi * np.trapezoid(-np.log(1 - opacity * np.exp(-(r**2) / 2)) * r, r) * 0.36
    origins = np.float32([[0.3, -0.2, z] for z in np.arange(-12, -4, 0.25)])
    rays = np.tile(np.float32([0, 0, 1]), (len(origins), 1))
    out = np.empty(len(origins), np.float32)
    open_device().run(depths, grids.density, origins, rays, 30.0, out)
    assert out.mean() == pytest.approx(mass, rel=0.3)
    assert out.min() > 0.9 * mass
    assert out.max() < 1.8 * mass


def test_all_matter_within_a_grid_is_in_it() -> None:
    """Oracle: closed form: the sum over a grid's cells is the mass of the splats."""
    rng = np.random.default_rng(5)
    positions, scales = rng.normal(size=(500, 3)), rng.uniform(0.01, 0.03, (500, 3))
    grids = grids_of(positions, scales, np.full(500, 0.5), 0.1)
    two = np.sort(scales, axis=1)[:, 1:].prod(axis=1).sum() * 2 * np.pi
    dilogarithm = 0.5822405264650126  # of 1/2
    totals = grids.density.sum(axis=(1, 2, 3)) * (0.1 * 2.0 ** np.arange(len(grids.density))) ** 3
    np.testing.assert_allclose(totals / 0.1, two * dilogarithm, rtol=2e-3)


def test_broken_splats_are_nowhere() -> None:
    """Oracle: the grids without them."""
    positions = np.random.default_rng(6).normal(size=(50, 3))
    broken = np.concatenate([positions, [[np.nan, 0, 0], [np.inf, 0, 0]]])
    ones = np.ones((52, 3))
    found = grids_of(broken, 0.1 * ones, 0.5 * ones[:, 0], 0.1)
    expected = grids_of(positions, 0.1 * ones[:50], 0.5 * ones[:50, 0], 0.1)
    np.testing.assert_array_equal(found.density, expected.density)
