"""Tests of one step of the Gray-Scott reaction."""

from __future__ import annotations

import numpy as np
import pytest

from tests.devices import all_cores
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.sim.reaction import gray_scott, seed

pytestmark = pytest.mark.usefixtures("on_device")

F = np.float32
FEED, KILL, DU, DV = 0.037, 0.06, 0.16, 0.08
SIDE = 96


def lattice():
    """Rows, neighbours and weights of a periodic square lattice with four neighbours."""
    x, y = np.divmod(np.arange(SIDE * SIDE), SIDE)
    near = [((x + i) % SIDE) * SIDE + (y + j) % SIDE for i, j in ((-1, 0), (0, -1), (0, 1), (1, 0))]
    rows = np.arange(SIDE * SIDE + 1, dtype=np.int64) * 4
    nbr = np.stack(near, axis=1).astype(np.int32).ravel()
    return rows, nbr, np.ones(len(nbr), F)


def start():
    """A square nucleus, a little noisy."""
    uv = np.tile(np.array([1, 0], F), (SIDE, SIDE, 1))
    uv[40:56, 40:56] = 0.5, 0.25
    uv += np.random.default_rng(1).uniform(0, 0.02, uv.shape).astype(F)
    return uv.reshape(-1)


def run(device, graph, uv, count, feed, kill):
    """uv after `count` steps."""
    now, then = uv.copy(), np.empty_like(uv)
    for _ in range(count):
        device.run(gray_scott, *graph, now, feed, kill, F(DU), F(DV), F(1), then)
        now, then = then, now
    return now


def dense(uv, count):
    """The same in float64, with shifted pictures instead of lists."""
    u, v = np.moveaxis(uv.reshape(SIDE, SIDE, 2).astype(np.float64), -1, 0)
    for _ in range(count):
        flow_u, flow_v = (
            sum(np.roll(f, s, a) for s in (1, -1) for a in (0, 1)) - 4 * f for f in (u, v)
        )
        made = u * v * v
        u, v = (
            u + F(DU) * flow_u - made + F(FEED) * (1 - u),
            v + F(DV) * flow_v + made - (F(FEED) + F(KILL)) * v,
        )
    return np.stack([u, v], axis=-1).reshape(-1)


@pytest.mark.parametrize(("count", "tolerance"), [(100, 1e-6), (2000, 1e-4)])
def test_a_lattice_goes_as_in_float64(count, tolerance) -> None:
    """Oracle: a dense float64 implementation with the same stencil."""
    feed, kill = np.array([FEED], F), np.array([KILL], F)
    found = run(open_device(), lattice(), start(), count, feed, kill)
    wanted = dense(start(), count)
    assert wanted[1::2].max() > 0.2
    assert np.abs(found - wanted)[1::2].max() <= tolerance


def test_rates_of_each_point_and_odd_lists() -> None:
    """Oracle: the formula, for a point with seven neighbours, in float64."""
    rng = np.random.default_rng(2)
    uv = rng.uniform(0, 1, (8, 2)).astype(F)
    w = rng.uniform(0, 1, 7).astype(F)
    rows = np.array([0, 7, 7, 7, 7, 7, 7, 7, 7], np.int64)
    feed, kill = np.linspace(0.02, 0.06, 8).astype(F), np.linspace(0.05, 0.07, 8).astype(F)
    out = np.empty(16, F)
    nbr = np.arange(1, 8, dtype=np.int32)
    open_device().run(
        gray_scott, rows, nbr, w, uv.ravel(), feed, kill, F(DU), F(DV), F(0.5), out
    )  # fmt: skip
    u, v = uv.astype(np.float64).T
    flow_u, flow_v = np.zeros(8), np.zeros(8)
    flow_u[0], flow_v[0] = w @ (u[1:] - u[0]), w @ (v[1:] - v[0])
    wanted_u = u + 0.5 * (DU * flow_u - u * v * v + feed * (1 - u))
    wanted_v = v + 0.5 * (DV * flow_v + u * v * v - (feed + kill) * v)
    np.testing.assert_allclose(out[::2], wanted_u, atol=3e-7)
    np.testing.assert_allclose(out[1::2], wanted_v, atol=3e-7)


def test_threads_do_not_matter() -> None:
    """Oracle: one thread, bit for bit."""
    feed, kill = np.full(SIDE * SIDE, FEED, F), np.array([KILL], F)
    one, all_of_them = (
        run(device, lattice(), start(), 50, feed, kill)
        for device in (CpuDevice(threads=1), all_cores())
    )
    assert one.tobytes() == all_of_them.tobytes()


def test_seeds_are_mixed_in_by_weight() -> None:
    """Oracle: linear interpolation; weights beyond 0 to 1 are as the limits."""
    uv = np.tile(np.array([1, 0], F), (4, 1))
    open_device().run(seed, uv, np.array([-1, 0, 0.5, 2], F), F(0.5), F(0.25))
    np.testing.assert_array_equal(uv, [[1, 0], [1, 0], [0.75, 0.125], [0.5, 0.25]])
