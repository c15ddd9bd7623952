"""Spherical harmonics of 3D Gaussian splatting: real, with Condon-Shortley signs.

Coefficient k of a channel has degree l and order m, with k = l (l + 1) + m. Degree 1 is (-y, z,
-x). Trained files depend on these signs, so the whole package uses them.

Source: Sloan 2008, "Stupid Spherical Harmonics Tricks", appendix A2; signs and the offset of 0.5 by
Kerbl et al. 2023, "3D Gaussian Splatting".
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating[Any]]

MAX_DEGREE = 4


def _norm(degree: int, order: int) -> float:
    """Return the normalisation of a real harmonic, including the Condon-Shortley sign."""
    ratio = math.factorial(degree - order) / math.factorial(degree + order)
    root = math.sqrt((2 * degree + 1) / (4 * math.pi) * ratio)
    return (-1) ** order * root * (math.sqrt(2.0) if order else 1.0)


C0 = _norm(0, 0)
"""The constant harmonic, 1 / (2 sqrt(pi))."""
C1 = _norm(1, 0)
_C2 = tuple(_norm(2, m) for m in range(3))
_C3 = tuple(_norm(3, m) for m in range(4))
_C4 = tuple(_norm(4, m) for m in range(5))


def coefficient_count(degree: int) -> int:
    """Return the number of coefficients per channel of all degrees up to `degree`."""
    return (degree + 1) ** 2


def basis(directions: Floats, degree: int) -> Floats:
    """Evaluate every harmonic up to `degree`.

    Args:
        directions: Unit vectors, shape (n, 3).
        degree: 0 to 4.

    Returns:
        Values, shape (n, (degree + 1)**2), dtype of `directions`.

    Raises:
        ValueError: If `degree` is not 0 to 4.
    """
    if not 0 <= degree <= MAX_DEGREE:
        raise ValueError(f"degree: found {degree}, expected 0 to {MAX_DEGREE}")
    out = np.empty((len(directions), coefficient_count(degree)), directions.dtype)
    x, y, z = directions.T
    out[:, 0] = C0
    if degree >= 1:
        _fill(out, 1, (C1, -C1), (z, 1.0), ((1.0, 0.0), (x, y)))
    if degree >= 2:
        zz, square = z * z, (x * x - y * y, 2.0 * x * y)
        legendre2 = (1.5 * zz - 0.5, 3.0 * z, 3.0)
        _fill(out, 2, _C2, legendre2, ((1.0, 0.0), (x, y), square))
    if degree >= 3:
        cube = (x * square[0] - y * square[1], x * square[1] + y * square[0])
        legendre3 = ((2.5 * zz - 1.5) * z, 7.5 * zz - 1.5, 15.0 * z, 15.0)
        _fill(out, 3, _C3, legendre3, ((1.0, 0.0), (x, y), square, cube))
    if degree >= 4:
        fourth = (x * cube[0] - y * cube[1], x * cube[1] + y * cube[0])
        legendre4 = (
            (4.375 * zz - 3.75) * zz + 0.375,
            (17.5 * zz - 7.5) * z,
            52.5 * zz - 7.5,
            105.0 * z,
            105.0,
        )
        _fill(out, 4, _C4, legendre4, ((1.0, 0.0), (x, y), square, cube, fourth))
    return out


def evaluate(sh: Floats, directions: Floats) -> Floats:
    """Evaluate view-dependent colour.

    Args:
        sh: Coefficients, shape (n, k, 3) with k = 1, 4, 9, 16 or 25.
        directions: Unit vectors from the eye to each splat in the cloud's own space, shape (n, 3).

    Returns:
        RGB in the capture's own colour space, shape (n, 3); at least 0, not bounded above.

    Raises:
        ValueError: If k has another value.
    """
    k = sh.shape[1]
    degree = math.isqrt(k) - 1
    if coefficient_count(degree) != k:
        raise ValueError(f"sh: found {k} coefficients per channel, expected 1, 4, 9, 16 or 25")
    rgb = np.einsum("nk,nkc->nc", basis(directions, degree), sh)
    rgb += rgb.dtype.type(0.5)
    return np.maximum(rgb, 0.0, out=rgb)


def rgb_to_dc(rgb: Floats) -> Floats:
    """Return degree-0 coefficients of a constant colour `rgb`; any shape."""
    return (rgb - 0.5) / C0


def dc_to_rgb(dc: Floats) -> Floats:
    """Return the colour of degree-0 coefficients, not clamped; any shape."""
    return dc * C0 + 0.5


def _fill(
    out: Floats, degree: int, norms: tuple[float, ...], legendre: tuple[Any, ...], turns: tuple
) -> None:
    """Write one degree: norm x derivative of the Legendre polynomial in z x (cos, sin) in x, y."""
    middle = degree * (degree + 1)
    out[:, middle] = norms[0] * legendre[0]
    for m in range(1, degree + 1):
        height = norms[m] * legendre[m]
        out[:, middle + m] = height * turns[m][0]
        out[:, middle - m] = height * turns[m][1]
