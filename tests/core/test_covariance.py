"""Tests of covariances and their factors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.core.strategies import SEEDS, quaternions
from usdsplat.core import covariance, quaternion


def test_an_unrotated_splat_has_its_variances_on_the_diagonal() -> None:
    """Oracle: the definition of a standard deviation."""
    found = covariance.from_scale_rotation(np.array([[1.0, 2, 3]]), np.array([[1.0, 0, 0, 0]]))
    np.testing.assert_array_equal(found, [np.diag([1, 4, 9])])


def test_a_long_splat_turned_into_y_varies_along_y() -> None:
    """Oracle: a quarter turn about z, written down by hand."""
    turn = np.array([[np.sqrt(0.5), 0, 0, np.sqrt(0.5)]])
    found = covariance.from_scale_rotation(np.array([[5.0, 1, 1]]), turn)
    np.testing.assert_allclose(found, [np.diag([1, 25, 1])], atol=1e-14)


@settings(max_examples=50, deadline=None)
@given(SEEDS, st.floats(0, 9))
def test_factors_multiply_back_and_the_scales_are_the_eigenvalues(seed: int, spread: float) -> None:
    """Oracle: LAPACK's eigvalsh, and the matrix that was factored; scales span 10**spread."""
    scales = 10 ** np.random.default_rng(seed).uniform(-spread, 0, (8, 3))
    given_matrices = covariance.from_scale_rotation(scales, quaternions(seed, 8))
    found, rotations = covariance.to_scale_rotation(given_matrices)
    size = np.abs(given_matrices).max()
    back = covariance.from_scale_rotation(found, rotations)
    np.testing.assert_allclose(back, given_matrices, rtol=0, atol=1e-13 * size)
    np.testing.assert_allclose(
        np.sort(found**2), np.linalg.eigvalsh(given_matrices), rtol=0, atol=1e-13 * size
    )
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=1), 1, atol=1e-14)


@pytest.mark.parametrize(
    "scales",
    [(1, 1, 1), (1, 1, 1e-12), (2, 1, 0), (1, 0, 0), (0, 0, 0), (1e-30, 1e-33, 1e-30), (1e6, 1, 1)],
)
def test_round_flat_thin_and_vanished_splats_come_back(scales: tuple[float, ...]) -> None:
    """Oracle: the covariance that was factored, without warnings or NaN on the way."""
    given_matrices = covariance.from_scale_rotation(
        np.tile(np.array(scales, float), (64, 1)), quaternions(5, 64)
    )
    with np.errstate(all="raise", under="ignore"):
        found, rotations = covariance.to_scale_rotation(given_matrices)
    back = covariance.from_scale_rotation(found, rotations)
    atol = 1e-14 * max(scales) ** 2
    np.testing.assert_allclose(back, given_matrices, rtol=0, atol=atol)
    np.testing.assert_allclose(
        np.sort(found), np.tile(np.sort(scales), (64, 1)), rtol=1e-12, atol=2e-8 * max(scales)
    )


def test_dtypes_are_kept() -> None:
    """Oracle: float32 in, float32 out, as the clouds hold it."""
    matrices = covariance.from_scale_rotation(
        np.float32([[1, 2, 3]]), quaternions(1, 1).astype(np.float32)
    )
    parts = covariance.to_scale_rotation(matrices)
    assert {matrices.dtype, *(part.dtype for part in parts)} == {np.dtype(np.float32)}
    assert covariance.transform(matrices, np.eye(3)).dtype == np.float32


def test_transformed_covariances_are_those_of_transformed_samples() -> None:
    """Oracle: the sample covariance of a point set is carried by the map exactly."""
    rng = np.random.default_rng(2)
    points, linear = rng.normal(size=(50, 3)), rng.normal(size=(3, 3))
    before, after = np.cov(points.T)[None], np.cov((points @ linear.T).T)[None]
    np.testing.assert_allclose(covariance.transform(before, linear), after, rtol=1e-12)


def test_sampled_splats_have_the_covariance() -> None:
    """Oracle: 200,000 random points placed by scale, then rotation, then counted."""
    scales, rotation = np.array([[0.5, 1.0, 2.0]]), quaternions(9, 1)
    local = np.random.default_rng(4).normal(size=(200_000, 3)) * scales
    points = local @ quaternion.to_matrix(rotation)[0].T
    found = covariance.from_scale_rotation(scales, rotation)[0]
    np.testing.assert_allclose(np.cov(points.T), found, atol=0.03)
