"""Tests of splats that follow carriers. Oracles: rigid and linear maps, and the definition."""

from __future__ import annotations

import numpy as np
import pytest

from tests.devices import all_cores
from tests.sim.test_carriers import shell
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim.carriers import Binding, Carriers
from usdsplat.sim.following import Motion, follow, motion_of
from usdsplat.sim.gradients import LocalGradients
from usdsplat.sim.neighbors import nearest

BAND = 0.75, 1.25


@pytest.fixture(scope="module")
def device(any_device):
    """All threads."""
    return open_device()


@pytest.fixture(scope="module")
def setting(device):
    """A capture, its carriers, what its splats are bound to, and the carriers' neighbours."""
    cloud = shell()
    carriers = Carriers.of(device, cloud, distance=0.12)
    near, _ = nearest(device, carriers.positions, carriers.positions, 13)
    others = np.ascontiguousarray(near[:, 1:])
    gradients = LocalGradients.of(device, carriers.positions, others, carriers.normals)
    return cloud, carriers, carriers.bind(device, cloud.positions), gradients


def turned(seed=0):
    """A random rotation."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def moved(device, setting, map_of, band=BAND):
    """Positions and gradients of the splats after the carriers have moved."""
    cloud, carriers, binding, gradients = setting
    now = map_of(carriers.positions.astype(np.float64)).astype(np.float32)
    motion = motion_of(device, gradients, now, carriers.spacing, band)
    positions = cloud.positions.copy()
    gradient = np.tile(np.eye(3, dtype=np.float32), (len(positions), 1, 1))
    follow(device, binding, motion, positions, gradient)
    return positions, gradient


def test_splats_at_rest_stay_bit_for_bit(device, setting):
    """Oracle: the capture, and the identity."""
    positions, gradient = moved(device, setting, lambda p: p)
    assert np.array_equal(positions, setting[0].positions)
    assert (gradient == np.eye(3)).all()


@pytest.mark.parametrize("stretch", [(1.0, 1.0, 1.0), (1.2, 0.9, 1.1)])
def test_splats_follow_a_linear_map(device, setting, stretch):
    """Oracle: the map itself; sheets do not stretch along their normals, so only splats in the
    sheet are compared where the map is no rotation."""
    linear = turned() @ np.diag(stretch)
    positions, gradient = moved(device, setting, lambda p: p @ linear.T + (0.3, -0.2, 0.5))
    expected = setting[0].positions.astype(np.float64) @ linear.T + (0.3, -0.2, 0.5)
    spacing = setting[1].spacing
    assert np.abs(positions - expected).max() < (0.01 if stretch[0] == 1 else 0.15) * spacing
    if stretch[0] == 1:
        assert np.abs(gradient - linear).max() < 0.02


def test_maps_stay_within_the_band(device, setting):
    """Oracle: singular values by LAPACK."""
    _, gradient = moved(device, setting, lambda p: p * (3.0, 1.0, 0.2))
    values = np.linalg.svd(gradient.astype(np.float64), compute_uv=False)
    assert values.max() < BAND[1] + 1e-4  # means of maps may be smaller, never larger


def test_a_carrier_that_tears_off_does_not_drag_splats_along(device):
    """Oracle: by hand. A splat between two carriers follows the nearest one if the other one is
    far from where that one's map puts it."""
    binding = Binding(near=np.int32([[0, 1]]), weights=np.float32([[0.6, 0.4]]))
    maps = np.tile(np.eye(3, dtype=np.float32), (2, 1, 1))
    poses = np.float32([[0, 0, 0], [1, 0, 0]])
    for away, share in ((0.2, 0.4), (5.0, 0.0)):
        shifts = np.float32([[0, 1, 0], [0, 1 + away, 0]])
        motion = Motion(poses=poses, displacements=shifts, maps=maps, spacing=1.0)
        positions = np.float32([[0.4, 0, 0]])
        follow(device, binding, motion, positions)
        np.testing.assert_allclose(positions, [[0.4, 1 + share * away, 0]], atol=1e-6)


def test_any_number_of_threads_gives_the_same_bits(setting):
    """Oracle: one thread."""

    def wave(p):
        return p + 0.1 * np.sin(3 * p[:, ::-1])

    alone, every = (moved(d, setting, wave) for d in (CpuDevice(threads=1), all_cores()))
    assert all(np.array_equal(a, b) for a, b in zip(alone, every, strict=True))
