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

BY_COLOR, BY_OPACITY, FACTOR = 0.7, 1.3, 2.0
WEIGHTS = np.array([BY_COLOR, BY_OPACITY, FACTOR])


def weighed(cloud, blur=0.0):
    """Covariances, masses and logarithms of volumes, as the kernels have them."""
    n = len(cloud)
    found = np.empty((n, 6)), np.empty(n), np.empty(n)
    open_device().run(pairs.weigh, cloud.scales, cloud.rotations, cloud.opacities, blur, *found)
    return found


def reference(cloud, blur=0.0):
    """The same from core's covariances, and the matrices themselves, in float64."""
    matrices = covariance.from_scale_rotation(
        cloud.scales.astype(np.float64), cloud.rotations.astype(np.float64)
    )
    matrices += blur * np.eye(3)
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


@pytest.mark.parametrize("blur", [0.0, 0.01])
def test_splats_are_weighed(blur) -> None:
    """Oracle: core's covariances and NumPy's eigenvalues and determinants, float64."""
    cloud = random_cloud(50, 0)
    covariances, masses, volumes = weighed(cloud, blur)
    matrices, expected, logarithms = reference(cloud, blur)
    upper = matrices[:, *np.triu_indices(3)]
    np.testing.assert_allclose(covariances, upper, rtol=1e-5, atol=1e-6 * upper.max())
    np.testing.assert_allclose(masses, expected, rtol=1e-5)
    np.testing.assert_allclose(volumes, logarithms, rtol=0, atol=1e-5)


@pytest.mark.parametrize("opacity", [0.3, 1.0, 1.5, 4.0])
def test_the_mass_of_a_flat_top_is_what_pictures_show(opacity) -> None:
    """Oracle: the integral of min(1, o exp(-r^2 / 2)) over the plane, summed, over 2 pi."""
    r = np.linspace(0, 12, 200_001)
    shown = np.trapezoid(np.minimum(1, opacity * np.exp(-r * r / 2)) * r, r)
    assert pairs.solid(opacity) == pytest.approx(shown, rel=1e-6)
    assert pairs.peak_of(pairs.solid(opacity)) == pytest.approx(opacity, rel=1e-12)


def hidden(cloud):
    """The overlap of the first two splats."""
    covariances, masses, _ = weighed(cloud)
    return pairs.overlap(0, 1, cloud.positions, covariances, masses)


def product(cloud, along):
    """The integral of the product of the first two opacities in a picture along an axis, over
    2 pi."""
    matrices, _, _ = reference(cloud)
    across = np.delete(np.arange(3), along)
    first, second = (each[np.ix_(across, across)] for each in matrices[:2])
    apart = (cloud.positions[0] - cloud.positions[1]).astype(np.float64)[across]
    both = first + second
    peak = math.sqrt(np.linalg.det(first) * np.linalg.det(second) / np.linalg.det(both))
    falloff = math.exp(-0.5 * apart @ np.linalg.solve(both, apart))
    return float(cloud.opacities[0] * cloud.opacities[1] * peak * falloff)


@pytest.mark.parametrize("apart", [0.0, 0.05, 0.2])
def test_splats_hide_as_much_of_each_other_as_pictures_show(apart) -> None:
    """Oracle: closed form in a picture along any axis, for round splats one behind the other; and
    for flat ones side by side, in a picture that shows their faces, over the square root of 3: the
    root mean square over three axes, along two of which they are seen edge on."""
    cloud = random_cloud(2, 0)
    cloud.scales[:], cloud.positions[1] = 0.1, cloud.positions[0]
    assert hidden(cloud) == pytest.approx(product(cloud, 2), rel=1e-5)
    cloud.rotations[:], cloud.scales[:] = (1, 0, 0, 0), (0.1, 0.15, 1e-5)
    cloud.positions[1] += np.array([apart, 0, 0], np.float32)
    assert hidden(cloud) == pytest.approx(product(cloud, 2) / math.sqrt(3), rel=1e-3)


def listed(cloud, rows, found, k=None):
    """Candidates of all rows and their costs, -1 and inf for rows that are gone."""
    n = len(cloud)
    near = np.full((n, k or found.shape[1]), -1, np.int32)
    costs = np.full(near.shape, np.inf, np.float32)
    open_device().run(pairs.compare, rows, found, *values(cloud), WEIGHTS, near, costs)
    return near, costs


def values(cloud):
    """What costs are computed from."""
    sh = cloud.sh.reshape(len(cloud), -1)
    return (cloud.positions, *weighed(cloud), cloud.opacities, sh)


def all_costs(cloud, rows):
    """The sum of Kullback-Leibler divergences of both splats of each pair of rows from the Gaussian
    of their moments, written out with NumPy's determinants, plus the variances of two weighted
    values; (m, m), float64."""
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
            expected[s, t] = FACTOR * (masses[s] + masses[t]) ** 0.75 * nats
    return expected


def test_the_cheapest_is_that_of_all_pairs() -> None:
    """Oracle: all pairs, see `all_costs`."""
    cloud = random_cloud(40, 1)
    rows = np.arange(0, 40, 2, dtype=np.int32)
    m = len(rows)
    expected = all_costs(cloud, rows)
    near, costs = listed(cloud, rows, np.tile(np.arange(m, dtype=np.int32), (m, 1)))
    np.testing.assert_array_equal(near[rows, 0], rows[expected.argmin(axis=1)])
    np.testing.assert_allclose(costs[rows, 0], expected.min(axis=1), rtol=1e-4)
    for s, i in enumerate(rows):
        others = near[i][near[i] >= 0]
        assert sorted(others) == sorted(set(rows.tolist()) - {int(i)})
        np.testing.assert_allclose(costs[i][: m - 1], expected[s, others // 2], rtol=1e-4)


def test_a_splat_without_neighbours_has_no_partner() -> None:
    """Oracle: closed form; itself and -1 are none."""
    cloud = random_cloud(3, 0)
    found = np.array([[0, -1], [-1, -1], [1, 2]], np.int32)
    near, costs = listed(cloud, np.arange(3, dtype=np.int32), found)
    np.testing.assert_array_equal(near[:, 0], [-1, -1, 1])
    np.testing.assert_array_equal(np.isinf(costs[:, 0]), [True, True, False])


@pytest.mark.parametrize("k", [3, 7])
def test_candidates_follow_merges(k) -> None:
    """Oracle: sets, for a pair that becomes one and another that is as it was: a splat's candidates
    that are gone are replaced by the rows that they merged into, a merged one has those of both,
    and where there are more than k, the cheapest by `all_costs`."""
    cloud = random_cloud(12, 1, seed=3)
    rows = np.arange(12, dtype=np.int32)
    found = np.array([[t for t in range(12) if t != s][:k] for s in range(12)], np.int32)
    found[0], found[1] = [5, 4, 1, 2, 3, 6, 8][:k], [0, 7, 9, 5, 10, 11, 2][:k]
    near, costs = listed(cloud, rows, found)
    before = near.copy()
    heirs, mates = np.full(12, -1, np.int32), np.full(12, -1, np.int32)
    heirs[1], mates[0] = 0, 1
    cloud.positions[0] += np.float32(0.1)  # as if merged
    open_device().run(
        pairs.follow, np.delete(rows, 1), heirs, mates, *values(cloud), WEIGHTS, near, costs
    )
    expected = all_costs(cloud, rows)
    for s in np.delete(rows, 1):
        others = set(before[s].tolist()) | (set(before[1].tolist()) if s == 0 else set())
        others = {0 if t == 1 else t for t in others} - {int(s)}
        cheapest = sorted(others, key=lambda t, s=s: expected[s, t])[:k]
        count = len(cheapest)
        assert set(near[s, :count].tolist()) == set(cheapest) and (near[s, count:] == -1).all()
        assert near[s, 0] == cheapest[0]
        np.testing.assert_allclose(costs[s, :count], expected[s, near[s, :count]], rtol=1e-4)
        assert np.isinf(costs[s, count:]).all()


def matched(partners, most):
    """Pairs, in the order in which they were taken."""
    m = len(partners)
    found, taken = np.full((most, 2), -1, np.int32), np.zeros(m, np.bool_)
    near = np.array(partners, np.int32)[:, None]
    count = pairs.match(np.arange(m, dtype=np.int32), near, most, taken, found)
    assert taken.sum() == 2 * count
    return found[:count].tolist()


def test_no_splat_is_in_two_pairs() -> None:
    """Oracle: a person, who takes them one after the other."""
    assert matched([1, 0, 1, 4, 5, 3, -1], 7) == [[0, 1], [3, 4]]
    assert matched([1, 0, 3, 2, 5, 4], 2) == [[0, 1], [2, 3]]


GROWTH = 0.7


def merged(cloud, velocities=None, peak=pairs.OPAQUE):
    """The first two rows of a cloud as one: changed arrays, and the rows that are gone."""
    n = len(cloud)
    covariances, masses, volumes = weighed(cloud)
    positions, opacities = cloud.positions.copy(), cloud.opacities.copy()
    sh = cloud.sh.reshape(n, -1).copy()
    velocities = np.empty((n, 0), np.float32) if velocities is None else velocities.copy()
    other = np.zeros(n, np.bool_)
    heirs, mates = np.full(n, -1, np.int32), np.full(n, -1, np.int32)
    open_device().run(
        pairs.merge, np.array([[0, 1]], np.int32), peak, GROWTH, positions, covariances, masses,
        volumes, opacities, sh, velocities, other, heirs, mates,
    )  # fmt: skip
    gone = heirs >= 0
    assert other.sum() == 1 and not (other & gone).any()
    assert heirs[gone] == np.flatnonzero(other) and mates[other] == np.flatnonzero(gone)
    arrays = (positions, covariances, masses, volumes, opacities, sh, velocities)
    return [each[other][0] for each in arrays], gone


@pytest.mark.parametrize("seed", range(4))
def test_a_pair_keeps_its_moments(seed) -> None:
    """Oracle: mean and covariance of a mixture, E[xx] - E[x]E[x], and its mass without the overlap,
    float64."""
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
    shown = masses[:2].sum() - hidden(cloud)
    np.testing.assert_array_equal(gone, [masses[0] < masses[1], masses[0] >= masses[1], False])
    np.testing.assert_allclose(found[0], mean, rtol=1e-5)
    np.testing.assert_allclose(found[1], both[np.triu_indices(3)], atol=1e-5 * np.trace(both))
    assert found[2] == pytest.approx(shown, rel=1e-5)
    assert mass_of(both, found[4]) == pytest.approx(shown, rel=1e-5)
    assert found[3] == pytest.approx(volume_of(both), abs=1e-4)
    np.testing.assert_allclose(found[5], weights @ cloud.sh[:2].reshape(2, -1), atol=1e-5)
    np.testing.assert_allclose(found[6], weights @ velocities[:2], atol=1e-5)


@pytest.mark.parametrize("peak", [pairs.OPAQUE, 1.2, 4.0])
def test_what_would_be_more_than_opaque_grows_or_gets_a_flat_top(peak) -> None:
    """Oracle: closed form: two round splats of opacity 0.9 at one place show 2 x 0.9 - 0.9^2 / 2 of
    the area of one. Below a high peak this is 1 + ln o; else the excess over what the peak shows
    makes the splat larger, to the power GROWTH."""
    cloud = random_cloud(2, 0)
    cloud.positions[1], cloud.rotations[:] = cloud.positions[0], (1, 0, 0, 0)
    cloud.scales[:], cloud.opacities[:] = 0.1, 0.9
    found, gone = merged(cloud, peak=peak)
    dense = 2 * 0.9 - 0.9**2 / 2
    most = peak if peak <= 1 else 1 + math.log(peak)
    opacity, grow = math.exp(dense - 1), 1.0
    if dense > most:
        opacity, grow = peak, (dense / most) ** GROWTH
    assert gone.tolist() == [False, True]
    assert found[4] == pytest.approx(opacity, rel=1e-5)
    np.testing.assert_allclose(found[1][[0, 3, 5]], grow * 0.01, rtol=1e-4)
    assert found[2] == pytest.approx(min(dense, most) * grow * 0.01, rel=1e-4)
