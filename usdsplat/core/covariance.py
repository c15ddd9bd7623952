"""Convert between scales with rotations and covariance matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core import quaternion
from usdsplat.core.cloud import F64

Floats = npt.NDArray[np.floating[Any]]

_SWEEPS = 6  # convergence is quadratic: four already reach float64 precision
_TINY = np.finfo(np.float64).tiny


def from_scale_rotation(scales: Floats, rotations: Floats) -> Floats:
    """Return covariances R diag(s^2) R^T.

    Args:
        scales: Standard deviations along the local axes [scene unit], shape (n, 3).
        rotations: Unit quaternions (w, x, y, z), shape (n, 4).

    Returns:
        Symmetric matrices [scene unit^2], shape (n, 3, 3), dtype of the arguments.
    """
    root = quaternion.to_matrix(rotations) * scales[:, None, :]
    return root @ root.transpose(0, 2, 1)


def to_scale_rotation(covariances: Floats) -> tuple[Floats, Floats]:
    """Split symmetric positive semi-definite matrices into scales and rotations.

    Uses Jacobi rotations on all matrices at once. They give the eigenvectors as a quaternion, which
    is always a proper rotation, and take a quarter of the time of a batched LAPACK call.

    Args:
        covariances: Matrices [scene unit^2], shape (n, 3, 3).

    Returns:
        Scales [scene unit], in no particular order, shape (n, 3), and unit quaternions
        (w, x, y, z), shape (n, 4), both of the argument's dtype. Solved in float64: a scale below
        1e-8 of the largest one is lost in its rounding.

    Source:
        Golub & Van Loan 2013, "Matrix Computations", 8.5.
    """
    exact = covariances.astype(np.float64, copy=False)
    variances = [exact[:, i, i] for i in range(3)]
    # Indexed by the axis that does not occur.
    mixed = [exact[:, 1, 2], exact[:, 2, 0], exact[:, 0, 1]]
    turn = [np.ones(len(exact)), *np.zeros((3, len(exact)))]
    for _ in range(_SWEEPS):
        for axis in range(3):
            _diagonalize(axis, variances, mixed, turn)
    scales = np.sqrt(np.maximum(np.stack(variances, axis=1), 0.0))
    rotations = quaternion.normalize(np.stack(turn, axis=1))
    return scales.astype(covariances.dtype), rotations.astype(covariances.dtype)


def transform(covariances: Floats, linear: F64) -> Floats:
    """Transform covariances (n, 3, 3) by a linear map (3, 3): A S A^T, in their dtype."""
    a = linear.astype(covariances.dtype, copy=False)
    return a @ covariances @ a.T


def _diagonalize(k: int, variances: list[F64], mixed: list[F64], turn: list[F64]) -> None:
    """Rotate every matrix about its axis k so that the entry of the other two axes vanishes."""
    i, j = (k + 1) % 3, (k + 2) % 3
    difference, twice = variances[j] - variances[i], 2.0 * mixed[k]
    longest = np.hypot(difference, twice)
    # Take the smaller angle. `_TINY` makes 0 / 0 defined and is otherwise lost in rounding.
    tangent = twice / np.copysign(np.abs(difference) + longest + _TINY, difference)
    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
    sine = tangent * cosine
    change = tangent * mixed[k]
    variances[i], variances[j] = variances[i] - change, variances[j] + change
    mixed[j], mixed[i] = cosine * mixed[j] - sine * mixed[i], sine * mixed[j] + cosine * mixed[i]
    mixed[k] = np.zeros_like(change)
    half_cosine = np.sqrt(0.5 + 0.5 * cosine)
    half_sine = -0.5 * sine / half_cosine
    w, a, b, c = turn[0], turn[1 + i], turn[1 + j], turn[1 + k]
    turn[0], turn[1 + k] = w * half_cosine - c * half_sine, w * half_sine + c * half_cosine
    turn[1 + i], turn[1 + j] = a * half_cosine + b * half_sine, b * half_cosine - a * half_sine
