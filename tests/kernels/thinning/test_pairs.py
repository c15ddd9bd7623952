"""Tests of merging pairs of splats: costs and results."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.formats.samples import random_cloud
from usdsplat.core import covariance
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.thinning import pairs

pytestmark = pytest.mark.usefixtures("on_device")

BY_COLOR, BY_OPACITY = 0.7, 1.3


def weighed(cloud):
    """Covariances, masses and logarithms of volumes, as the kernels have them."""
    n = len(cloud)
    found = np.empty((n, 6)), np.empty(n), np.empty(n)
    open_device().run(pairs.weigh, cloud.scales, cloud.rotations, cloud.opacities, *found)
    return found


def reference(cloud):
    """The same from core's covariances, and the matrices themselves, in float64."""
    matrices = covariance.from_scale_rotation(
        cloud.scales.astype(np.float64), cloud.rotations.astype(np.float64)
    )
    return matrices, mass_of(matrices, cloud.opacities), volume_of(matrices)


def mass_of(matrices, opacities):
    """Opacity times the root mean square area, from the squared axes of each ellipsoid."""
    a, b, c = np.linalg.eigvalsh(matrices).T
    return np.sqrt((a * b + b * c + c * a) / 3) * opacities


def volume_of(matrices):
    """Half the logarithm of the blurred determinant."""
    blur = pairs.SOFTNESS * np.trace(matrices, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
    return 0.5 * np.linalg.slogdet(matrices + blur)[1]


def test_the_area_is_that_of_projections() -> None:
    """Oracle: determinants of a random covariance projected along three directions at right
    angles, of which the mean square is that of all directions: it is a quadratic form of them."""
    random = np.random.default_rng(0)
    root = random.normal(size=(3, 3))
    matrix = root @ root.T
    axes, _ = np.linalg.qr(random.normal(size=(3, 3)))
    squares = [
        np.linalg.det(across.T @ matrix @ across)
        for across in (np.delete(axes, i, axis=1) for i in range(3))
    ]
    found = pairs.area(*matrix[np.triu_indices(3)])
    assert found == pytest.approx(math.sqrt(np.mean(squares)), rel=1e-12)


def test_splats_are_weighed() -> None:
    """Oracle: core's covariances and NumPy's eigenvalues and determinants, float64."""
    cloud = random_cloud(50, 0)
    covariances, masses, volumes = weighed(cloud)
    matrices, expected, logarithms = reference(cloud)
    upper = matrices[:, *np.triu_indices(3)]
    np.testing.assert_allclose(covariances, upper, rtol=1e-5, atol=1e-6 * upper.max())
    np.testing.assert_allclose(masses, expected, rtol=1e-5)
    np.testing.assert_allclose(volumes, logarithms, rtol=0, atol=1e-5)


def cheapest(cloud, rows, near):
    """Partners and costs."""
    covariances, masses, volumes = weighed(cloud)
    partners, costs = np.empty(len(rows), np.int32), np.empty(len(rows))
    open_device().run(
        pairs.cheapest, rows, near, cloud.positions, covariances, masses, volumes, cloud.opacities,
        cloud.sh.reshape(len(cloud), -1), BY_COLOR, BY_OPACITY, partners, costs,
    )  # fmt: skip
    return partners, costs


def test_the_cheapest_is_that_of_all_pairs() -> None:
    """Oracle: the sum of Kullback-Leibler divergences of both from the Gaussian of their moments,
    written out for every pair with NumPy's determinants; variances of two weighted values."""
    cloud = random_cloud(40, 1)
    rows = np.arange(0, 40, 2, dtype=np.int32)
    m = len(rows)
    matrices, masses, volumes = (each[rows] for each in reference(cloud))
    expected = np.full((m, m), np.inf)
    for s in range(m):
        for t in range(m):
            if s == t:
                continue
            part = masses[s] / (masses[s] + masses[t])
            i, j = rows[s], rows[t]
            points = cloud.positions[[i, j]].astype(np.float64)
            apart = points[0] - points[1]
            both = part * matrices[s] + (1 - part) * matrices[t]
            both += part * (1 - part) * np.outer(apart, apart)
            nats = volume_of(both) - part * volumes[s] - (1 - part) * volumes[t]
            color = ((cloud.sh[i].astype(np.float64) - cloud.sh[j]) ** 2).sum()
            opacity = (np.float64(cloud.opacities[i]) - cloud.opacities[j]) ** 2
            nats += part * (1 - part) * (BY_COLOR * color + BY_OPACITY * opacity)
            expected[s, t] = (masses[s] + masses[t]) ** pairs.SEEN * nats
    near = np.tile(np.arange(m, dtype=np.int32), (m, 1))
    partners, costs = cheapest(cloud, rows, near)
    np.testing.assert_array_equal(partners, expected.argmin(axis=1))
    np.testing.assert_allclose(costs, expected.min(axis=1), rtol=1e-4)


def test_a_splat_without_neighbours_has_no_partner() -> None:
    """Oracle: closed form; itself and -1 are none."""
    cloud = random_cloud(3, 0)
    near = np.array([[0, -1], [-1, -1], [1, 2]], np.int32)
    partners, costs = cheapest(cloud, np.arange(3, dtype=np.int32), near)
    np.testing.assert_array_equal(partners, [-1, -1, 1])
    np.testing.assert_array_equal(np.isinf(costs), [True, True, False])


def matched(partners, most):
    """Pairs, in the order in which they were taken."""
    m = len(partners)
    found, taken = np.full((most, 2), -1, np.int32), np.zeros(m, np.bool_)
    count = pairs.match(np.arange(m), np.array(partners, np.int32), most, taken, found)
    assert taken.sum() == 2 * count
    return found[:count].tolist()


def test_no_splat_is_in_two_pairs() -> None:
    """Oracle: a person, who takes them one after the other."""
    assert matched([1, 0, 1, 4, 5, 3, -1], 7) == [[0, 1], [3, 4]]
    assert matched([1, 0, 3, 2, 5, 4], 2) == [[0, 1], [2, 3]]


def merged(cloud, velocities=None):
    """The first two rows of a cloud as one: changed arrays, and the rows that are gone."""
    n = len(cloud)
    covariances, masses, volumes = weighed(cloud)
    positions, opacities = cloud.positions.copy(), cloud.opacities.copy()
    sh = cloud.sh.reshape(n, -1).copy()
    velocities = np.empty((n, 0), np.float32) if velocities is None else velocities.copy()
    other, gone = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    open_device().run(
        pairs.merge, np.array([[0, 1]], np.int32), np.arange(n, dtype=np.int32), positions,
        covariances, masses, volumes, opacities, sh, velocities, other, gone,
    )  # fmt: skip
    assert other.sum() == 1 and not (other & gone).any()
    arrays = (positions, covariances, masses, volumes, opacities, sh, velocities)
    return [each[other][0] for each in arrays], gone


@pytest.mark.parametrize("seed", range(4))
def test_a_pair_keeps_its_moments(seed) -> None:
    """Oracle: mean and covariance of a mixture, E[xx] - E[x]E[x], and its mass, float64."""
    cloud = random_cloud(3, 1, seed)
    cloud.opacities[:] *= 0.1
    velocities = np.random.default_rng(seed).normal(size=(3, 3)).astype(np.float32)
    matrices, masses, _ = reference(cloud)
    found, gone = merged(cloud, velocities)
    weights = masses[:2] / masses[:2].sum()
    points = cloud.positions[:2].astype(np.float64)
    mean = weights @ points
    second = np.einsum("i,ijk->jk", weights, matrices[:2] + points[:, :, None] * points[:, None])
    both = second - np.outer(mean, mean)
    np.testing.assert_array_equal(gone, [masses[0] < masses[1], masses[0] >= masses[1], False])
    np.testing.assert_allclose(found[0], mean, rtol=1e-5)
    np.testing.assert_allclose(found[1], both[np.triu_indices(3)], atol=1e-5 * np.trace(both))
    assert found[2] == pytest.approx(masses[:2].sum(), rel=1e-5)
    assert mass_of(both, found[4]) == pytest.approx(masses[:2].sum(), rel=1e-5)
    assert found[3] == pytest.approx(volume_of(both), abs=1e-4)
    np.testing.assert_allclose(found[5], weights @ cloud.sh[:2].reshape(2, -1), atol=1e-5)
    np.testing.assert_allclose(found[6], weights @ velocities[:2], atol=1e-5)


def test_what_would_be_more_than_opaque_grows() -> None:
    """Oracle: closed form: twice the mass of one of two equal ones at one place; half of the
    surplus, by its logarithm, goes into the area."""
    cloud = random_cloud(1, 0)
    cloud = type(cloud)(
        **{
            name: np.repeat(getattr(cloud, name), 2, axis=0)
            for name in ("positions", "scales", "rotations", "opacities", "sh")
        }
    )
    cloud.opacities[:] = 0.9
    matrices, masses, _ = reference(cloud)
    found, gone = merged(cloud)
    surplus = 1.8 / pairs.OPAQUE
    assert gone.tolist() == [False, True]
    assert found[4] == np.float32(pairs.OPAQUE)
    expected = math.sqrt(surplus) * matrices[0][np.triu_indices(3)]
    np.testing.assert_allclose(found[1], expected, rtol=1e-5, atol=1e-6 * expected.max())
    assert found[2] == pytest.approx(2 * masses[0] / math.sqrt(surplus), rel=1e-5)
