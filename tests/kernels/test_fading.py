"""Tests of fading splats against each other. Oracles: the dilogarithm's known values, and sums over
a Gaussian."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.kernels.test_project import project_rows
from usdsplat.kernels import project
from usdsplat.kernels.fading import MOST, WHOLE, depth_of, faded, tallied


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (0.0, 0.0),
        (0.5, math.pi**2 / 12 - math.log(2) ** 2 / 2),
        ((math.sqrt(5) - 1) / 2, math.pi**2 / 10 - math.log((1 + math.sqrt(5)) / 2) ** 2),
        (0.999, float(np.sum(0.999 ** np.arange(1, 40000.0) / np.arange(1, 40000.0) ** 2))),
    ],
)
def test_the_sum_of_depths_has_its_known_values(x, expected):
    """Oracle: Li2 at 1/2 and at the golden ratio (Zagier 2007), and the defining series."""
    depth = -math.log1p(-x)
    assert -math.expm1(-tallied(depth)) * math.pi**2 / 6 == pytest.approx(expected, abs=5e-8)
    assert depth_of(tallied(depth)) == pytest.approx(depth, abs=3e-7)


@pytest.mark.parametrize("opacity", [1e-4, 0.05, 0.5, 0.9, 0.99, 0.999, 1.0])
@pytest.mark.parametrize("weight", [1e-3, 0.1, 0.5, 0.9, 0.9999])
def test_optical_depths_of_a_fade_add_up(opacity, weight):
    """Oracle: the integral of −ln(1 − α) over a Gaussian, by the midpoint rule in the square of
    the radius. A splat faded by a weight and by the rest of 1 have that of the whole one."""
    falloff = np.exp(-0.5 * (np.arange(200_000) + 0.5) / 200_000 * 40)

    def depth(peak):
        return -np.log1p(-peak * falloff).sum()

    whole = depth(min(opacity, MOST))
    parts = faded(np.float32(opacity), weight), faded(np.float32(opacity), 1 - weight)
    assert depth(parts[0]) == pytest.approx(weight * whole, rel=2e-5)
    assert depth(parts[0]) + depth(parts[1]) == pytest.approx(whole, rel=2e-5)


def test_a_weight_fades_the_opacity_and_nothing_else(device):
    """Oracle: the record without a weight, and `faded` of its opacity; a weight of 1 is bit for
    bit without one."""
    rng = np.random.default_rng(4)
    positions = rng.normal(size=(50, 3)) + np.array([0, 0, 9])
    splats = {"scales": rng.uniform(0.01, 0.2, (50, 3)), "opacities": rng.uniform(0.3, 1.0, 50)}
    plain = project_rows(device, positions, **splats, trained=0.0)[0]
    whole = project_rows(device, positions, **splats, trained=0.0, weights=[1.0])[0]
    weight = 20_000 / WHOLE
    half = project_rows(device, positions, **splats, trained=0.0, weights=[weight])[0]
    assert np.array_equal(plain, whole)
    expected = [faded(np.exp(each), weight) for each in plain[:, project.LOG_OPACITY]]
    np.testing.assert_allclose(np.exp(half[:, project.LOG_OPACITY]), expected, rtol=1e-5)
    same = [project.U, project.V, project.A, project.B, project.C, project.DEPTH]
    assert np.array_equal(half[:, same], plain[:, same])
