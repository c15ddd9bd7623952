"""Tests of polar and singular value decomposition."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.kernels.jit import serial
from usdsplat.kernels.sim.matrix import decompose, matrix_quat, polar, quat_matrix


@serial
def polars(matrices, out):
    """`polar` for many."""
    for i in range(len(matrices)):
        m = matrices[i]
        r = polar((m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]))
        for k in range(9):
            out[i, k] = r[k]


@serial
def decomposed(m, u, s, v):
    """`decompose` for one."""
    left, sizes, right = decompose((m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]))
    for k in range(9):
        u[k], v[k] = left[k], right[k]
    s[0], s[1], s[2] = sizes


@serial
def round_trip(quaternions, out):
    """Quaternion to matrix and back, for many."""
    for i in range(len(quaternions)):
        q = quaternions[i]
        w, x, y, z = matrix_quat(quat_matrix(q[0], q[1], q[2], q[3]))
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = w, x, y, z


def polar_of(matrices):
    """Rotations of matrices of any shape (n, 3, 3)."""
    out = np.empty((len(matrices), 9), np.float32)
    polars(np.float32(matrices).reshape(-1, 9), out)
    return out.reshape(-1, 3, 3)


def nearest_rotation(matrices):
    """NumPy's: U diag(1, 1, |U V|) V, float64."""
    u, _, v = np.linalg.svd(np.float32(matrices).astype(np.float64))
    u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    return u @ v


def test_polar_is_the_nearest_rotation() -> None:
    """Oracle: NumPy's singular value decomposition in float64, mirrors included."""
    matrices = np.random.default_rng(1).normal(size=(3000, 3, 3))
    sizes = np.linalg.svd(matrices, compute_uv=False)
    mirrored = np.linalg.det(matrices) < 0
    gap = (sizes[:, 1] + np.where(mirrored, -1, 1) * sizes[:, 2]) / sizes[:, 0]
    matrices, gap = matrices[gap > 0.05], gap[gap > 0.05]
    error = np.abs(polar_of(matrices) - nearest_rotation(matrices)).max(axis=(1, 2))
    assert len(matrices) > 2000
    assert (error * gap).max() < 1e-6  # the factor's own condition is 1 / gap


def test_polar_of_little_rotation_is_exact() -> None:
    """Oracle: as above, near the identity, where deformations mostly are."""
    rng = np.random.default_rng(2)
    matrices = np.eye(3) + rng.normal(size=(2000, 3, 3)) * 10.0 ** rng.uniform(-6, -1, (2000, 1, 1))
    assert np.abs(polar_of(matrices) - nearest_rotation(matrices)).max() < 1e-6


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.ones((3, 3)), np.diag([1.0, 1.0, 0.0]), np.diag([1.0, 2.0, -3.0])],
    ids=["nothing", "a line", "a plane", "a mirror"],
)
def test_polar_is_a_rotation_whatever_it_is_asked(matrix) -> None:
    """Oracle: the definition of a rotation."""
    r = polar_of(matrix[None])[0].astype(np.float64)
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(r) == pytest.approx(1, abs=1e-6)


def test_small_singular_values_keep_their_digits() -> None:
    """Oracle: NumPy in float64; columns of lengths 1 to 1e-5, as a splat's axes are."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        m = np.float32(rng.normal(size=(3, 3)) @ np.diag([1, 1e-2, 1e-5]))
        if np.linalg.cond(m / np.linalg.norm(m, axis=0)) > 10:
            continue
        u, s, v = (np.empty(k, np.float32) for k in (9, 3, 9))
        decomposed(m.reshape(-1), u, s, v)
        expected = np.linalg.svd(m.astype(np.float64), compute_uv=False)
        np.testing.assert_allclose(np.sort(s)[::-1], expected, rtol=3e-6)
        assert s[2] == s.min()
        back = u.reshape(3, 3) * s @ v.reshape(3, 3).T
        mirror = np.linalg.det(m) < 0
        if not mirror:
            np.testing.assert_allclose(back, m, atol=3e-6)


def test_quaternions_survive_the_matrix() -> None:
    """Oracle: the identity, up to sign; half turns about each axis take each way through."""
    q = np.random.default_rng(4).normal(size=(500, 4))
    q = np.float32(np.vstack([q / np.linalg.norm(q, axis=1, keepdims=True), np.eye(4)]))
    back = np.empty_like(q)
    round_trip(q, back)
    assert (1 - np.abs((q * back).sum(axis=1))).max() < 5e-7
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), 1, atol=2e-7)
