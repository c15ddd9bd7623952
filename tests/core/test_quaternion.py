"""Tests of quaternion algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from tests.core.strategies import SEEDS, orthogonal, quaternions
from usdsplat.core import quaternion


def about(axis: list[float], degrees: float) -> np.ndarray:
    """Quaternion of a turn about a unit axis, shape (1, 4): cos, sin of half the angle."""
    half = np.radians(degrees) / 2
    return np.array([[np.cos(half), *(np.sin(half) * np.array(axis))]])


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    """Oracle: the right-hand rule."""
    turn = about([0, 0, 1], 90)
    np.testing.assert_allclose(quaternion.to_matrix(turn)[0] @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_matrices_follow_rodrigues_formula() -> None:
    """Oracle: R = I + sin a K + (1 - cos a) K^2, another road to the same rotation."""
    for axis, degrees in (([0.6, 0, 0.8], 37.0), ([0, 1, 0], 179.9), ([-0.48, 0.6, 0.64], 250.0)):
        x, y, z = axis
        k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        a = np.radians(degrees)
        expected = np.eye(3) + np.sin(a) * k + (1 - np.cos(a)) * k @ k
        np.testing.assert_allclose(
            quaternion.to_matrix(about(axis, degrees))[0], expected, atol=1e-14
        )


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_products_rotate_like_products_of_matrices(seed: int) -> None:
    """Oracle: matrix products."""
    a, b = quaternions(seed, 6), quaternions(seed + 1, 6)
    ma, mb = quaternion.to_matrix(a), quaternion.to_matrix(b)
    product = quaternion.multiply(a, b)
    np.testing.assert_allclose(quaternion.to_matrix(product), ma @ mb, atol=1e-13)
    np.testing.assert_allclose(quaternion.multiply(a[0], b), quaternion.multiply(a[:1], b))


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_matrices_come_back(seed: int) -> None:
    """Oracle: a random rotation from a QR decomposition, and w >= 0."""
    matrices = np.stack([orthogonal(seed), orthogonal(seed + 1), np.eye(3)])
    found = quaternion.from_matrix(matrices)
    np.testing.assert_allclose(quaternion.to_matrix(found), matrices, atol=1e-13)
    assert (found[:, 0] >= 0).all()


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0, 0.8], [0, 0.6, -0.8]])
@pytest.mark.parametrize("degrees", [180.0, 179.999999, 1e-6, 90.0])
def test_half_turns_and_tiny_turns_keep_their_axis(axis: list[float], degrees: float) -> None:
    """Oracle: the quaternion the matrix was made of, up to sign; a trace formula loses it here."""
    q = about(axis, degrees)
    found = quaternion.from_matrix(quaternion.to_matrix(q))
    assert abs(np.sum(q * found)) == pytest.approx(1, abs=1e-14)
    np.testing.assert_allclose(np.abs(found), np.abs(q), atol=1e-12)


@pytest.mark.parametrize("size", [1e-30, 1e-3, 1.0, 1e30])
def test_normalization_survives_sizes_whose_squares_leave_float32(size: float) -> None:
    """Oracle: (1, 2, 2, 4) / 5."""
    found = quaternion.normalize(np.float32([[1, -2, 2, 4]]) * np.float32(size))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, [[0.2, -0.4, 0.4, 0.8]], rtol=1e-6)


def test_zero_becomes_the_identity_and_nan_stays() -> None:
    """Oracle: the documented convention."""
    raw = np.array([[0.0, 0, 0, 0], [np.nan, 0, 0, 1], [0, 0, 0, 3]])
    found = quaternion.normalize(raw)
    assert found[[0, 2]].tolist() == [[1, 0, 0, 0], [0, 0, 0, 1]]
    assert np.isnan(found[1]).any()
    assert raw[0].tolist() == [0, 0, 0, 0]


@pytest.mark.parametrize("total", [0.0, 1e-9, 1e-3, 90.0, 170.0])
@pytest.mark.parametrize("flip", [1, -1])
def test_slerp_turns_at_constant_speed(total: float, flip: int) -> None:
    """Oracle: turns about one axis: a share t of the angle, whichever sign the ends have."""
    axis = [0.36, 0.48, 0.8]
    t = np.array([0.0, 0.25, 0.5, 1.0])
    a, b = np.repeat(about(axis, 10), 4, 0), flip * np.repeat(about(axis, 10 + total), 4, 0)
    expected = np.concatenate([about(axis, 10 + share * total) for share in t])
    found = quaternion.slerp(a, b, t)
    np.testing.assert_allclose(np.abs(np.sum(found * expected, axis=1)), 1, atol=1e-14)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(quaternion.slerp(a, b, 0.25)[0], expected[1], atol=1e-12)
