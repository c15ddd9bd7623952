"""Tests of planes through the neighbours of splats."""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.devices import open_device
from usdsplat.kernels.normals.planes import planes
from usdsplat.kernels.points.nearest import nearest


def planes_of(positions, rotations, scales, weights, k=25):
    """Axes and flatness of all splats."""
    device, n = open_device(), len(positions)
    neighbors, distances = nearest(device, positions, positions, k)
    axes, flatness = np.empty((n, 3), np.float32), np.empty(n, np.float32)
    device.run(
        planes, positions, rotations, scales, weights, neighbors, distances, axes, flatness
    )  # fmt: skip
    return axes, flatness, neighbors, distances


def test_they_are_the_least_eigenvectors_of_weighted_covariances() -> None:
    """Oracle: NumPy's eigh of the covariance in float64, point splats without extent."""
    rng = np.random.default_rng(4)
    n = 200
    positions = (rng.normal(size=(n, 3)) * [1, 0.7, 0.2]).astype(np.float32)
    rotations = np.tile(np.float32([1, 0, 0, 0]), (n, 1))
    weights = rng.uniform(0.001, 0.004, n).astype(np.float32)
    scales = np.zeros((n, 3), np.float32)
    axes, flatness, neighbors, distances = planes_of(positions, rotations, scales, weights)
    checked = 0
    for i in range(n):
        at, reach = neighbors[i], float(distances[i, -1])
        w = np.clip(weights[at] / reach**2, 1e-6, 1)
        w = w * np.maximum(1 - (distances[i] / reach) ** 2, 0.02)
        values, vectors = np.linalg.eigh(np.cov(positions[at].T.astype(np.float64), aweights=w))
        if values[0] < 0.5 * values[1]:
            assert abs(vectors[:, 0] @ axes[i]) > 1 - 1e-4
            checked += 1
        usual = distances[at[1:], 6].mean()
        if distances[i, 6] < 2 * usual:
            assert abs(flatness[i] - (1 - values[0] / values[1])) < 1e-3
    assert checked > n / 2


def test_a_stray_has_no_flatness() -> None:
    """Oracle: closed form: a splat above a sheet, at ten times its spacing."""
    at = np.stack(np.meshgrid(np.arange(10), np.arange(10)), axis=-1).reshape(-1, 2)
    sheet = np.concatenate([at, np.zeros((100, 1))], axis=1)
    positions = np.concatenate([sheet, [[5, 5, 10]]]).astype(np.float32)
    n = len(positions)
    splats = np.tile(np.float32([1, 0, 0, 0]), (n, 1)), np.full((n, 3), 0.1, np.float32)
    axes, flatness, _, _ = planes_of(positions, *splats, np.full(n, 0.1, np.float32))
    assert flatness[100] == 0
    assert flatness[:100].min() > 0.9
    np.testing.assert_allclose(np.abs(axes[:100, 2]), 1, atol=1e-6)
