"""Rotate and mirror spherical harmonics.

Harmonics of one degree only mix among themselves, so an orthogonal 3x3 matrix acts as one small
matrix per degree. The matrix follows from equal values: coefficients c' of the rotated function
satisfy Y(e) c' = Y(Q^T e) c for every direction e. A fixed, well-spread set of directions makes
this a least squares problem. Its solution is exact, because both sides are harmonics of that
degree.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from usdsplat.core import sh as harmonics
from usdsplat.core.cloud import F32, F64


def band_matrices(orthogonal: F64, degree: int) -> list[F64]:
    """Return the matrices that rotate the coefficients of each degree, 0 up to `degree`.

    Args:
        orthogonal: Rotation or reflection (determinant +1 or -1), column vectors, shape (3, 3).
        degree: 0 to 4.

    Returns:
        Orthogonal matrices of shape (2l + 1, 2l + 1), one for each l.

    Raises:
        ValueError: If the matrix is not orthogonal to 1e-4, or the degree is not 0 to 4.
    """
    q = np.asarray(orthogonal, np.float64)
    if q.shape != (3, 3) or not np.allclose(q @ q.T, np.eye(3), rtol=0, atol=1e-4):
        raise ValueError("orthogonal: found a matrix that is not, expected rotation or reflection")
    seen = harmonics.basis(_directions() @ q, degree)
    return [_solver(band) @ seen[:, _columns(band)] for band in range(degree + 1)]


def rotate(sh: F32, orthogonal: F64) -> F32:
    """Return the coefficients after rotating the splats by `orthogonal`.

    `evaluate(rotate(sh, q), q @ d)` equals `evaluate(sh, d)` for every direction d.

    Args:
        sh: Coefficients, shape (n, k, 3) with k = 1, 4, 9, 16 or 25.
        orthogonal: Rotation or reflection, shape (3, 3).

    Returns:
        A new array of the same shape and dtype.

    Raises:
        ValueError: As for `band_matrices`.
    """
    count = sh.shape[1]
    whole = np.zeros((count, count), sh.dtype)
    for band, matrix in enumerate(band_matrices(orthogonal, math.isqrt(count) - 1)):
        whole[_columns(band), _columns(band)] = matrix
    # One product with a matrix for all three channels is faster than many small products.
    wide = np.kron(whole, np.eye(3, dtype=sh.dtype))
    flat = sh.reshape(len(sh), 3 * count)
    return np.matmul(flat, wide.T).reshape(sh.shape)


@functools.cache
def _directions() -> F64:
    """Return unit vectors spread evenly by the golden angle, shape (64, 3)."""
    i = np.arange(64)
    z = 1.0 - (2.0 * i + 1.0) / len(i)
    angle = i * math.pi * (3.0 - math.sqrt(5.0))
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


@functools.cache
def _solver(band: int) -> F64:
    """Return the least-squares inverse of the harmonics of one degree at the fixed directions."""
    values = harmonics.basis(_directions(), band)[:, _columns(band)]
    return np.linalg.pinv(values).astype(np.float64)


def _columns(band: int) -> slice:
    """Return the columns of the coefficients of one degree."""
    return slice(band * band, (band + 1) ** 2)
