"""Tests that carriers are evenly spaced, and that patterns do not depend on a capture's density."""

from __future__ import annotations

import numpy as np
import pytest

from tests.devices import all_cores
from tests.sim.patterns import area, wavelength
from usdsplat.core.cloud import SplatCloud
from usdsplat.formats import read
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.points.nearest import nearest
from usdsplat.sim.carriers import NEAREST, Carriers, poisson_disk
from usdsplat.sim.parameters import RdParameters
from usdsplat.sim.reaction import Reaction
from usdsplat.sim.seeds import nuclei, plant, untouched

CAPTURES = ("statue_angel.sog", "playbot_lod3.sog", "pod.spz")


def shell(count=3000, seed=0):
    """A unit sphere of flat splats, unevenly spread: many above, few but large below."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points = points[(points[:, 2] > 0) | (rng.random(count) < 0.3)]
    n = len(points)
    turn = np.column_stack([1 + points[:, 2], -points[:, 1], points[:, 0], np.zeros(n)])  # z to p
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    size = np.where(points[:, 2] > 0, 0.06, 0.12)[:, None]
    return SplatCloud(
        positions=points.astype(np.float32),
        scales=(size * [1, 1, 0.01]).astype(np.float32),
        rotations=turn.astype(np.float32),
        opacities=np.full(n, 0.9, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )


def joined(cloud, points, size, opacity):
    """A cloud and more splats."""
    n = len(points)
    return SplatCloud(
        positions=np.concatenate([cloud.positions, np.asarray(points, np.float32)]),
        scales=np.concatenate([cloud.scales, np.full((n, 3), size, np.float32)]),
        rotations=np.concatenate([cloud.rotations, np.tile(np.float32([1, 0, 0, 0]), (n, 1))]),
        opacities=np.concatenate([cloud.opacities, np.full(n, opacity, np.float32)]),
        sh=np.zeros((len(cloud) + n, 1, 3), np.float32),
    )


@pytest.fixture(scope="module")
def device(any_device):
    """All threads."""
    return open_device()


@pytest.fixture(scope="module")
def carriers(any_device, device):
    """Of the shell."""
    return Carriers.of(device, shell(), distance=0.06, seed=1)


def test_they_cover_a_surface_evenly(device, carriers) -> None:
    """Oracle: the sphere. A carrier for each square of the spacing, on the surface, none missing
    anywhere, neighbours at even distances, normals outward."""
    radius = np.linalg.norm(carriers.positions, axis=1)
    assert np.abs(radius - 1).mean() < 0.01
    assert len(carriers) == pytest.approx(4 * np.pi / carriers.spacing**2, rel=0.15)
    probes = np.random.default_rng(2).normal(size=(2000, 3)).astype(np.float32)
    probes /= np.linalg.norm(probes, axis=1, keepdims=True)
    assert nearest(device, carriers.positions, probes, 1)[1].max() < 1.5 * carriers.spacing
    apart = nearest(device, carriers.positions, carriers.positions, 2)[1][:, 1]
    assert apart.std() / apart.mean() < 0.12
    assert (np.einsum("ij,ij->i", carriers.normals, carriers.positions) > 0.9).all()
    assert (carriers.dimension == 2).all()


def test_faint_huge_and_lonely_splats_have_none(device, carriers) -> None:
    """Oracle: the same capture without them: no carrier is away from the sphere."""
    spoilt = joined(shell(), np.random.default_rng(3).uniform(2, 3, (20, 3)), 0.02, 0.05)
    spoilt = joined(spoilt, [[0, 0, 1.2]], 5.0, 0.9)
    spoilt = joined(spoilt, [[4, 0, 0], [0, 4, 0], [np.nan, 0, 0]], 0.001, 0.9)
    found = Carriers.of(device, spoilt, distance=0.06, seed=1)
    assert np.abs(np.linalg.norm(found.positions, axis=1) - 1).max() < 0.1
    assert len(found) == pytest.approx(len(carriers), rel=0.02)


def test_there_are_no_more_than_allowed(device) -> None:
    """Oracle: the bound; the spacing is larger for it."""
    found = Carriers.of(device, shell(), distance=0.06, most=1000)
    assert 700 < len(found) <= 1000
    assert found.spacing > 0.06


def test_a_capture_without_a_surface_has_none(device) -> None:
    """Oracle: (1, 0) everywhere, the state without a pattern."""
    cloud = shell(10)
    faint = SplatCloud(
        positions=cloud.positions, scales=cloud.scales, rotations=cloud.rotations,
        opacities=np.zeros(len(cloud), np.float32), sh=cloud.sh,
    )  # fmt: skip
    found = Carriers.of(device, faint)
    assert len(found) == 0
    uv = found.bind(device, faint.positions).read(device, untouched(0))
    np.testing.assert_array_equal(uv, untouched(len(faint)))


def test_splats_read_their_nearest(device, carriers) -> None:
    """Oracle: float64 NumPy with all distances: K of the 8 nearest, radius 1.2 of the last's."""
    points = shell().positions[:50] * np.float32(1.01)
    uv = np.random.default_rng(4).uniform(0, 1, (len(carriers), 2)).astype(np.float32)
    binding = carriers.bind(device, points)
    apart = np.linalg.norm(points[:, None].astype(np.float64) - carriers.positions[None], axis=-1)
    near = np.argsort(apart, axis=1)[:, :NEAREST]
    distance = np.take_along_axis(apart, near, axis=1)
    k = (1 - (distance / (1.2 * distance[:, -1:])) ** 2) ** 3
    wanted = np.einsum("ne,nec->nc", k / k.sum(1, keepdims=True), uv[near])
    np.testing.assert_allclose(binding.read(device, uv), wanted, atol=1e-4)


def test_splats_far_from_all_read_nothing(device, carriers) -> None:
    """Oracle: (1, 0) beyond three spacings, the carriers' within."""
    points = np.float32([[0, 0, 1 + 2.5 * carriers.spacing], [0, 0, 1 + 3.5 * carriers.spacing]])
    uv = np.full((len(carriers), 2), 0.5, np.float32)
    found = carriers.bind(device, points).read(device, uv)
    np.testing.assert_allclose(found, [[0.5, 0.5], [1, 0]], atol=1e-6)


def test_threads_do_not_matter() -> None:
    """Oracle: one thread, bit for bit."""
    carriers = Carriers.of(all_cores(), shell(), distance=0.06, seed=1)
    alone = Carriers.of(CpuDevice(threads=1), shell(), distance=0.06, seed=1)
    assert alone.positions.tobytes() == carriers.positions.tobytes()
    assert alone.normals.tobytes() == carriers.normals.tobytes()


def test_neighbours_are_rows_where_strays_were_dropped(device) -> None:
    """Oracle: the lengths of all lists: strays that have no neighbours are dropped, after which the
    cells, and with them the order of the others, are different ones."""
    points = 0.3 * np.random.default_rng(7).normal(size=(40, 3)) + [1.9, -0.4, 0.7]
    carriers = Carriers.of(device, joined(shell(), points, 0.004, 0.9), distance=0.06, seed=1)
    graph = carriers.graph
    assert np.array_equal(graph.order, np.arange(len(carriers)))
    assert np.array_equal(graph.positions, carriers.positions)
    own = np.repeat(np.arange(len(carriers)), np.diff(graph.rows))
    apart = np.linalg.norm(carriers.positions[own] - carriers.positions[graph.neighbors], axis=1)
    assert apart.max() < 8 * carriers.spacing


def test_captures_have_the_same_pattern(device, data) -> None:
    """Oracle: each other. Wavelengths in spacings within 10 %, areas within 0.05, after 6,000
    steps, with nothing tuned to any of them."""
    lengths, areas = [], []
    for name in CAPTURES:
        carriers = Carriers.of(device, read(data / "splats" / name).cloud, most=10_000)
        rd = RdParameters(preset="labyrinth")
        reaction = Reaction(device, carriers.graph, rd, normals=carriers.normals)
        uv = untouched(len(carriers))
        plant(
            device, uv, nuclei(device, carriers.positions, rd, reaction.scale, graph=carriers.graph)
        )
        v = reaction.step(uv, 6000)[carriers.graph.order, 1]
        lengths.append(wavelength(reaction, v))
        areas.append(area(v))
    middle = np.mean(lengths)
    assert 9 < middle < 15 and 0.3 < np.mean(areas) < 0.6
    assert np.ptp(lengths) <= 0.1 * middle, lengths
    assert np.ptp(areas) <= 0.05, areas


def test_a_sample_keeps_what_is_far_enough_in_the_order_of_priorities(device) -> None:
    """Oracle: a loop over all points kept before, in double precision."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (9000, 3)).astype(np.float32)
    priority = rng.integers(0, 5000, len(points)).astype(np.float32)  # some are equal
    kept: list[int] = []
    for row in np.argsort(priority, kind="stable"):
        away = np.linalg.norm(points[kept].astype(np.float64) - points[row], axis=1)
        if not (away < 0.15).any():
            kept.append(int(row))
    assert np.array_equal(poisson_disk(device, points, priority, 0.15), np.sort(kept))
    assert len(kept) > 500
