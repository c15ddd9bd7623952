"""Tests of kernels of the simulation on the simulated GPU: those whose threads cooperate, and one
of each kind of the others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.device import CpuDevice, Device
from usdsplat.kernels.sim import blend_solids as solids
from usdsplat.kernels.sim import (
    contact,
    flight,
    grid,
    harmonics,
    lists,
    reaction,
    relax,
    sweep,
)

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # kernels may overflow
F = np.float32
BITS = (2, 3, 2)
Arrays = list[np.ndarray[Any, Any]]


def both(work: Callable[[Device], Arrays]) -> tuple[Arrays, Arrays]:
    """What the GPU makes, and what the CPU makes."""
    return work(CudaDevice()), work(CpuDevice())


def points(n: int = 60, seed: int = 1) -> Any:
    """In a box of edge 2.4, some at one place, some nowhere."""
    out = np.random.default_rng(seed).uniform(-1.2, 1.2, (n, 3)).astype(F)
    out[n // 2] = out[n // 3]
    out[5], out[7, 1] = np.nan, np.inf
    return out


def test_the_box_of_each_block() -> None:
    """Oracle: the CPU's loop, to the bit."""

    def work(device: Device) -> Arrays:
        lower, upper = np.empty((2, 3)), np.empty((2, 3))
        device.run(grid.bounds, points(grid.BLOCK + 40), lower, upper)
        return [lower, upper]

    for found, wanted in zip(*both(work), strict=True):
        np.testing.assert_array_equal(found, wanted)


def cells(device: Device, where: Any, inverse: float) -> Arrays:
    """First slot of each cell, and the row of each slot."""
    n = len(where)
    entry, moved, rows, order = (np.empty(n, np.int32) for _ in range(4))
    start = np.empty((1 << sum(BITS)) + 1, np.int32)
    device.run(grid.keys, where, inverse, BITS, entry)
    histogram = np.empty((2, 1 << grid.TOP_BITS), np.int64)
    device.run(grid.sort_cells, entry, sum(BITS), histogram, moved, rows, start, order)
    return [start, order]


def test_points_are_sorted_into_cells() -> None:
    """Oracle: the CPU's loops, to the bit."""
    for found, wanted in zip(*both(lambda device: cells(device, points(), 1.5)), strict=True):
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize(("widest", "k_max"), [(0.0, 64), (0.9, 64), (0.9, 5)])
def test_lists_of_neighbours(widest: float, k_max: int) -> None:
    """Oracle: the CPU's loops, to the bit; lists that are too long keep the nearest."""
    where = points()
    reach = np.random.default_rng(2).uniform(0.4, 0.9, len(where)).astype(F)
    start, order = cells(CpuDevice(), where, 1.5)
    placed, n = where[order], len(where)

    def work(device: Device) -> Arrays:
        found = np.zeros(grid.BLOCK * k_max, np.int32)
        counts, dropped, twins = np.zeros(n, np.int64), np.ones(1, np.int64), np.zeros(n, bool)
        device.run(lists.coincident, placed, reach, start, 1.5, BITS, twins)
        device.run(
            lists.search, placed, reach, F(widest), start, 1.5, BITS, k_max, 0, found, counts,
            dropped,
        )  # fmt: skip
        rows = np.concatenate([[0], np.cumsum(counts)])
        neighbors = np.zeros(rows[-1], np.int32)
        device.run(lists.pack, found, k_max, 1, rows, neighbors)
        return [counts, dropped, twins, neighbors]

    found, wanted = both(work)
    assert wanted[0].max() > 4 and wanted[2].any()
    for a, b in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_step_of_the_reaction() -> None:
    """Oracle: the CPU's loop, to what the order of sums leaves."""
    rng = np.random.default_rng(3)
    counts = rng.integers(0, 30, 40)
    row = np.concatenate([[0], np.cumsum(counts)])
    nbr, w = rng.integers(0, 40, row[-1]).astype(np.int32), rng.uniform(0, 0.1, row[-1]).astype(F)
    uv, feed = rng.uniform(0, 1, 80).astype(F), rng.uniform(0, 0.1, 40).astype(F)

    def work(device: Device) -> Arrays:
        out = np.empty(80, F)
        device.run(
            reaction.gray_scott, row, nbr, w, uv, feed, np.array([0.06], F), F(0.2), F(0.1),
            F(1), out,
        )  # fmt: skip
        return [out]

    (found,), (wanted,) = both(work)
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_largest_and_sums_and_whether_of_a_block() -> None:
    """Oracle: the CPU's loops; sums to what their order leaves."""
    now, then = points(grid.BLOCK + 20), points(grid.BLOCK + 20, seed=4)
    then[[5, 7]] = now[[5, 7]]
    sizes = np.random.default_rng(5).uniform(0.5, 1, len(now)).astype(F)

    def work(device: Device) -> Arrays:
        far = device.run(lists.drift, now, then)
        late = [
            device.run(lists.stale, now, sizes, then, sizes, 0.1, 1.2, drift)
            for drift in (0.0, -10.0)
        ]
        return [np.array(far), np.array(late)]

    (far, late), (wanted_far, wanted_late) = both(work)
    np.testing.assert_array_equal(far, wanted_far)
    np.testing.assert_array_equal(late, wanted_late)


def test_a_sweep_of_redistribution() -> None:
    """Oracle: the CPU's loop."""
    rng = np.random.default_rng(6)
    n = 30
    where = rng.uniform(0, 2, (n, 3)).astype(F)
    normals = np.tile(np.array([0, 0, 1], F), (n, 1))
    rows = np.arange(n + 1, dtype=np.int64) * 4
    neighbors = rng.integers(0, n, 4 * n).astype(np.int32)

    def work(device: Device) -> Arrays:
        out = np.empty((n, 3), F)
        moved = device.run(
            relax.sweep, where, np.ones(n, F), normals, np.arange(n, dtype=np.int32), rows,
            neighbors, F(0.4), F(0.5), out,
        )  # fmt: skip
        return [out, np.array(moved)]

    for found, wanted in zip(*both(work), strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_turns_of_gradients() -> None:
    """Oracle: the CPU's loop, and how many are turned by a quarter."""
    gradient = np.tile(np.eye(3, dtype=F), (20, 1, 1))
    gradient[[3, 11]] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]

    def work(device: Device) -> Arrays:
        out = np.empty((20, 4), F)
        device.run(harmonics.turns, gradient, F(0.99), out)
        return [out]

    (out,), (wanted,) = both(work)
    assert np.count_nonzero(out[:, 0] < 1) == 2
    np.testing.assert_allclose(out, wanted, atol=1e-6)


@pytest.mark.parametrize("masked", [0, 20])
def test_flight(masked: int) -> None:
    """Oracle: the CPU's loop; also with factors for each splat."""
    rng = np.random.default_rng(7)
    where, speed = rng.uniform(-1, 1, (20, 3)).astype(F), rng.uniform(-1, 1, (20, 3)).astype(F)
    flags = rng.integers(0, 16, 20).astype(np.uint32)
    factors = rng.uniform(0, 1, (masked, 4)).astype(F)

    def work(device: Device) -> Arrays:
        positions, velocities = where.copy(), speed.copy()
        device.run(
            flight.fly, positions, velocities, flags, np.uint32(1), np.uint32(2),
            np.array([0, -0.1, 0], F), np.array([1, 0, 0], F), np.zeros((0, 3), F), np.eye(4),
            np.eye(3), F(0.5), 2.0, 0.3, F(0.9), F(2.5), factors, F(0.04), F(10), 3,
        )  # fmt: skip
        return [positions, velocities]

    for found, wanted in zip(*both(work), strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-5)


def table(*places: tuple[float, float, float]) -> Any:
    """Capsules along z that move by 1 along x in a step, with friction."""
    out = np.zeros((len(places), solids.COLUMNS))
    for body, place in zip(out, places, strict=True):
        body[solids.BLEND], body[solids.CLEARANCE], body[solids.FRICTION] = 0.02, 1.0, 0.3
        body[solids.BOUND], body[solids.CENTRE : solids.CENTRE + 3] = 0.9, place
        for first in (solids.SIZE, solids.SIZE_BEFORE):
            body[first : first + 4] = 0.3, 0.0, 0.5, 0.0
        body[solids.LOW : solids.LOW + 3] = -0.3, -0.3, -0.8
        body[solids.HIGH : solids.HIGH + 3] = 0.3, 0.3, 0.8
        for turn, at in ((solids.TURN, solids.PLACE), (solids.TURN_BEFORE, solids.PLACE_BEFORE)):
            body[turn : turn + 9] = np.eye(3).ravel()
            body[at : at + 3] = place
        body[solids.PLACE_BEFORE] -= 1.0
        body[solids.SHIFT] = 25.0
        body[solids.SWEPT], body[solids.THIN] = 1.0, 0.1
    return out


@pytest.mark.parametrize("kernel", ["contact", "sweep"])
def test_affectors(kernel: str) -> None:
    """Oracle: the CPU's loop; who is struck and how often, exactly."""
    bodies = table((0, 0, 0), (0.5, 0.2, 0), (40, 0, 0))
    rng = np.random.default_rng(8)
    n = solids.BLOCK + 100
    where = rng.uniform(5, 6, (n, 3)).astype(F)
    near = np.concatenate([np.arange(20), solids.BLOCK + np.arange(20)])
    where[near] = rng.uniform(-0.4, 0.6, (40, 3))
    where[3] = np.nan
    scales = np.full((n, 3), 0.01, F)
    flags = np.ones(n, np.uint32)
    flags[7], flags[9] = 3, 0

    def work(device: Device) -> Arrays:
        positions, velocities = where.copy(), np.zeros((n, 3), F)
        since, struck = np.full(n, np.inf, F), np.zeros(n, np.uint8)
        room = np.zeros((2, 3), np.int32)
        meshes = np.zeros((0, 8)), np.zeros(0, F)
        state = flags, scales, positions, velocities, since, struck, room
        if kernel == "sweep":
            counts = np.zeros(2, np.int64)
            device.run(sweep.sweep, bodies, *meshes, 0.04, 1.0, where, *state, counts)
        else:
            counts = np.zeros((2, contact.COUNTS), np.int64)
            everyone = np.arange(3, dtype=np.int32)
            device.run(
                contact.contact, bodies, everyone, *meshes, 0.04, 0.02, 1.0, 1e-7, where, *state,
                counts,
            )  # fmt: skip
        return [counts, struck, since, positions, velocities]

    found, wanted = both(work)
    assert wanted[0].sum() > 4
    for a, b in zip(found, wanted, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5)
