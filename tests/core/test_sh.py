"""Tests of the values of spherical harmonics."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from tests.core.strategies import directions
from usdsplat.core import sh

C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005)
C3 = (-0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154)
C4 = (
    2.5033429417967046,
    -1.7701307697799304,
    0.9461746957575601,
    -0.6690465435572892,
    0.10578554691520431,
)


def published(d: np.ndarray) -> np.ndarray:
    """The polynomials as Kerbl et al. 2023 (degrees 0 to 3) and Yu et al. 2021 (4) print them."""
    x, y, z = d.T
    xx, yy, zz = x * x, y * y, z * z
    c1 = 0.4886025119029199
    columns = [
        0.28209479177387814 + 0 * x,
        -c1 * y,
        c1 * z,
        -c1 * x,
        C2[0] * x * y,
        C2[1] * y * z,
        C2[2] * (2 * zz - xx - yy),
        C2[1] * x * z,
        C2[0] / 2 * (xx - yy),
        C3[0] * y * (3 * xx - yy),
        C3[1] * x * y * z,
        C3[2] * y * (4 * zz - xx - yy),
        C3[3] * z * (2 * zz - 3 * xx - 3 * yy),
        C3[2] * x * (4 * zz - xx - yy),
        C3[1] / 2 * z * (xx - yy),
        C3[0] * x * (xx - 3 * yy),
        C4[0] * x * y * (xx - yy),
        C4[1] * y * z * (3 * xx - yy),
        C4[2] * x * y * (7 * zz - 1),
        C4[3] * y * z * (7 * zz - 3),
        C4[4] * (zz * (35 * zz - 30) + 3),
        C4[3] * x * z * (7 * zz - 3),
        C4[2] / 2 * (xx - yy) * (7 * zz - 1),
        C4[1] * x * z * (xx - 3 * yy),
        C4[0] / 4 * (xx * (xx - 3 * yy) - yy * (3 * xx - yy)),
    ]
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("degree", range(5))
def test_the_basis_is_the_published_one_with_its_signs(degree: int) -> None:
    """Oracle: the polynomials above, typed from the papers."""
    d = directions(1, 200)
    found = sh.basis(d, degree)
    assert found.shape == (200, (degree + 1) ** 2)
    np.testing.assert_allclose(found, published(d)[:, : found.shape[1]], rtol=0, atol=1e-13)


def test_the_basis_is_orthonormal_over_the_sphere() -> None:
    """Oracle: Gauss-Legendre in z times 16 even angles integrates degree 8 exactly."""
    z, weights = leggauss(8)
    angle = np.arange(16) * 2 * np.pi / 16
    radius = np.sqrt(1 - z**2)[:, None]
    d = np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), np.broadcast_to(z[:, None], (8, 16))], -1
    ).reshape(-1, 3)
    values = sh.basis(d, 4)
    gram = values.T @ (values * np.repeat(weights * 2 * np.pi / 16, 16)[:, None])
    np.testing.assert_allclose(gram, np.eye(25), atol=1e-13)


def test_colour_is_a_half_plus_the_sum_and_never_negative() -> None:
    """Oracle: one splat by hand: red pulled below zero, green grey, blue 0.5 + 2 C1 towards z."""
    coefficients = np.zeros((1, 4, 3), np.float32)
    coefficients[0, 0, 0] = -10
    coefficients[0, 2, 2] = 2
    towards_z = np.float32([[0, 0, 1]])
    found = sh.evaluate(coefficients, towards_z)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, [[0, 0.5, 0.5 + 2 * sh.C1]], rtol=1e-6)
    np.testing.assert_allclose(sh.evaluate(coefficients, -towards_z)[0, 2], 0, atol=1e-6)


@pytest.mark.parametrize("degree", range(5))
def test_each_splat_has_its_own_direction(degree: int) -> None:
    """Oracle: the published polynomials, summed splat by splat."""
    d = directions(3, 7)
    c = np.random.default_rng(4).normal(size=(7, (degree + 1) ** 2, 3))
    expected = [np.maximum(0, 0.5 + row[: len(k)] @ k) for row, k in zip(published(d), c, strict=1)]
    np.testing.assert_allclose(sh.evaluate(c, d), expected, atol=1e-12)


def test_degree_zero_and_colour_convert_both_ways() -> None:
    """Oracle: 0.5 is no coefficient, and white is 0.5 / C0; any shape, dtype kept."""
    np.testing.assert_allclose(sh.rgb_to_dc(np.array([0.5, 1.0])), [0, np.sqrt(np.pi)], rtol=1e-15)
    rgb = np.float32([[0.1, 0.9, -1.5]])
    assert sh.dc_to_rgb(sh.rgb_to_dc(rgb)).dtype == np.float32
    np.testing.assert_allclose(sh.dc_to_rgb(sh.rgb_to_dc(rgb)), rgb, rtol=1e-6)


def test_degrees_and_counts_that_do_not_exist_are_refused() -> None:
    """Oracle: (l + 1)^2 for l = 0 to 4."""
    assert [sh.coefficient_count(degree) for degree in range(5)] == [1, 4, 9, 16, 25]
    for degree in (-1, 5):
        with pytest.raises(ValueError, match="expected 0 to 4"):
            sh.basis(directions(1, 2), degree)
    for count in (2, 15):
        with pytest.raises(ValueError, match=f"found {count} coefficients"):
            sh.evaluate(np.zeros((2, count, 3)), directions(1, 2))
