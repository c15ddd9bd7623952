"""Tests of the weights of the Laplacian."""

from __future__ import annotations

import numpy as np
import pytest

from tests.devices import all_cores
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.sim.laplacian import laplacian, merge, missing, row_sums

pytestmark = pytest.mark.usefixtures("on_device")

F = np.float32


def brute(points, h):
    """Rows and neighbours within each point's own radius."""
    apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
    near = (apart < h[:, None]) & ~np.eye(len(points), dtype=bool)
    rows = np.concatenate([[0], np.cumsum(near.sum(1))])
    return rows.astype(np.int64), np.nonzero(near)[1].astype(np.int32)


def weigh(points, h, dimension=2, directions=None, across=1.0, device=None):
    """Graph, weights and sums."""
    rows, nbr = brute(points, h)
    w, sums = np.empty(len(nbr), F), np.empty((len(h), 2), F)
    (device or open_device()).run(
        laplacian, points, rows, nbr, h, np.empty((0, 3), F) if directions is None else directions,
        across, np.full(len(h), dimension, F), w, sums,
    )  # fmt: skip
    return rows, nbr, w, sums


def applied(graph, values):
    """L of values."""
    rows, nbr, w, *_ = graph
    own = np.repeat(np.arange(len(rows) - 1), np.diff(rows))
    return np.bincount(own, w * (values[nbr] - values[own]).astype(np.float64), len(rows) - 1)


def plane(side, spacing):
    """A square lattice in z = 0, and which of its points have all their neighbours."""
    x, y = np.divmod(np.arange(side * side), side)
    points = np.stack([x, y, 0 * x], axis=1).astype(F) * F(spacing)
    return points, (np.minimum(x, y) >= 4) & (np.maximum(x, y) < side - 4)


def test_squares_have_the_laplacian_of_squares() -> None:
    """Oracle: L x^2 = L y^2 = 2, L x = 0, by symmetry exactly on a lattice."""
    points, inner = plane(20, 0.1)
    graph = weigh(points, np.full(len(points), 0.25, F))
    x, y = points[:, 0].astype(np.float64), points[:, 1].astype(np.float64)
    for values, wanted in ((x * x, 2), (y * y, 2), (x, 0), (x * y, 0)):
        np.testing.assert_allclose(applied(graph, values)[inner], wanted, atol=1e-3)


def test_a_volume_has_three_dimensions() -> None:
    """Oracle: L x^2 = 2 in a cubic lattice, with d = 3."""
    x = np.stack(np.meshgrid(*[np.arange(9)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    graph = weigh(x.astype(F), np.full(len(x), 2.3, F), dimension=3)
    inner = (x.min(1) >= 3) & (x.max(1) < 6)
    for axis in range(3):
        values = x[:, axis].astype(np.float64) ** 2
        np.testing.assert_allclose(applied(graph, values)[inner], 2, atol=1e-4)


def test_its_error_falls_with_the_square_of_the_spacing() -> None:
    """Oracle: L sin(x) sin(y) = -2 sin(x) sin(y); order at least 1.8."""
    errors = []
    for side, spacing in ((24, 0.2), (48, 0.1)):
        points, inner = plane(side, spacing)
        graph = weigh(points, np.full(len(points), 2.33 * spacing, F))
        values = np.sin(points[:, 0].astype(np.float64)) * np.sin(points[:, 1].astype(np.float64))
        error = (applied(graph, values) + 2 * values)[inner]
        errors.append(np.sqrt((error**2).mean()))
    assert np.log2(errors[0] / errors[1]) >= 1.8


@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_directions_stretch_diffusion(angle) -> None:
    """Oracle: D = 1 / sqrt(c) along and sqrt(c) across, det D = 1, on a fine lattice: L of a
    quadratic form M is 2 trace(D M)."""
    points, _ = plane(31, 0.1)
    centre = 15 * 31 + 15
    along = np.array([np.cos(angle), np.sin(angle), 0])
    across = np.array([-along[1], along[0], 0])
    directions = np.tile(along, (len(points), 1)).astype(F)
    graph = weigh(points, np.full(len(points), 0.9, F), directions=directions, across=0.4)
    offset = points.astype(np.float64) - points[centre]
    for axis, wanted in ((along, 2 / np.sqrt(0.4)), (across, 2 * np.sqrt(0.4))):
        found = applied(graph, (offset @ axis) ** 2)[centre]
        assert found == pytest.approx(wanted, rel=0.02)


def test_conserving_weights_are_the_mean_of_both_sides() -> None:
    """Oracle: (W + W') / 2 of the dense matrix."""
    rng = np.random.default_rng(3)
    points = rng.uniform(0, 1, (200, 3)).astype(F)
    h = rng.uniform(0.1, 0.4, 200).astype(F)
    rows, nbr, w, _ = weigh(points, h, dimension=3)
    extra = np.zeros(200, np.int64)
    missing(rows, nbr, extra)
    both = np.concatenate([[0], np.cumsum(np.diff(rows) + extra)])
    both_nbr, both_w = np.empty(both[-1], np.int32), np.empty(both[-1], F)
    merge(rows, nbr, w, both, both_nbr, both_w)
    sums = np.empty(200, F)
    open_device().run(row_sums, both, both_w, sums)

    def matrix(rows, nbr, w):
        full = np.zeros((200, 200))
        full[np.repeat(np.arange(200), np.diff(rows)), nbr] = w
        return full

    one_sided = matrix(rows, nbr, w)
    found = matrix(both, both_nbr, both_w)
    np.testing.assert_allclose(found, (one_sided + one_sided.T) / 2, rtol=1e-6)
    np.testing.assert_array_equal(found, found.T)
    np.testing.assert_allclose(sums, found.sum(1), rtol=1e-5)
    assert (np.diff(both_nbr)[np.diff(np.repeat(np.arange(200), np.diff(both))) == 0] > 0).all()


def test_points_alone_and_threads() -> None:
    """Oracle: a point without neighbours has no flow; one thread, bit for bit."""
    points = np.random.default_rng(5).uniform(0, 1, (3000, 3)).astype(F)
    points[0] = 50
    h = np.full(3000, 0.1, F)
    graphs = [weigh(points, h, device=each) for each in (CpuDevice(threads=1), all_cores())]
    assert graphs[0][3][0, 0] == 0
    assert graphs[0][2].tobytes() == graphs[1][2].tobytes()
    assert graphs[0][3].tobytes() == graphs[1][3].tobytes()
