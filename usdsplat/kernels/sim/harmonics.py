"""Rotation of each splat's spherical harmonics by its own rotation.

Harmonics of one degree mix only with each other. The rotated function has in direction e the value
that the original has in R^T e. Its coefficients are its values in 2l + 1 fixed directions,
multiplied by the inverse of the matrix of harmonics in these directions. `core.sh_rotation` does
this for one rotation of all splats.

Eight directions are processed at a time, for vector units. Directions that a degree does not need
repeat its first one.

Source of the idea: Nowrouzezahrai, Simari & Fiume 2012, "Sparse zonal harmonic factorization".
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core import sh as basis_of
from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import BlockArray, block_kernel, kernel, reduction

from .matrix import ONE, ZERO, is_identity, matrix_quat, polar, quat_matrix

LANES = 16

_DIRECTIONS = (
    ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    ((1, 0, 0), (1, -3, 0), (1, 2, 1), (3, 3, -2), (3, -2, -3)),
    ((2, -3, -3), (2, 0, -1), (1, 0, -2), (1, 3, 1), (1, 2, 3), (3, 3, -2), (3, 2, 1)),
    (
        (3, -2, -1), (1, -1, 2), (2, 1, 1), (1, 3, 3), (1, 1, -3), (2, -2, 1), (1, -2, 0),
        (1, 0, -1), (1, 1, -1),
    ),
)  # fmt: skip
"""Directions for degrees 1 to 4.

Of the directions with integer components up to 3 these give the lowest condition numbers, 1, 1.62,
1.90 and 2.45.
"""


def _directions(degree):
    """Return the unit vectors by component, 3 rows of LANES, flat."""
    rows = np.array(_DIRECTIONS[degree - 1], np.float64)
    rows = np.vstack([rows, np.repeat(rows[:1], LANES - len(rows), axis=0)])
    return np.float32((rows / np.linalg.norm(rows, axis=1, keepdims=True)).T.ravel())


def _solver(degree):
    """Return the matrix from values in the directions to coefficients, 2 l + 1 rows of LANES,
    flat."""
    rows = np.array(_DIRECTIONS[degree - 1], np.float64)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    harmonics = basis_of.basis(rows, degree)[:, degree * degree :]
    out = np.zeros((len(rows), LANES), np.float32)
    out[:, : len(rows)] = np.linalg.inv(harmonics).T
    return out.ravel()


_D2, _D3, _D4 = _directions(2), _directions(3), _directions(4)
_S2, _S3, _S4 = _solver(2), _solver(3), _solver(4)


def _norm(number, under_pi):
    """Return a factor times the square root of a rational number over pi, as float32."""
    return np.float32(number * math.sqrt(under_pi / math.pi))


_N20, _N21, _N22 = _norm(1 / 4, 5), _norm(-1 / 2, 15), _norm(1 / 4, 15)
_N30, _N31, _N32, _N33 = (
    _norm(1 / 4, 7), _norm(-1 / 4, 21 / 2), _norm(1 / 4, 105), _norm(-1 / 4, 35 / 2),
)  # fmt: skip
_N40, _N41, _N42, _N43, _N44 = (
    _norm(3 / 16, 1), _norm(-3 / 4, 5 / 2), _norm(3 / 8, 5), _norm(-3 / 4, 35 / 2),
    _norm(3 / 16, 35),
)  # fmt: skip
_2, _3, _5, _7, _30, _35 = (np.float32(v) for v in (2, 3, 5, 7, 30, 35))


# --- 1. mathematics: one direction -----------------------------------------------------


@scalar
def degree2(x, y, z):
    """Return the five harmonics of degree 2 in a direction, with signs and order of `core.sh`."""
    a = _N21 * z
    return _N22 * _2 * x * y, a * y, _N20 * (_3 * z * z - ONE), a * x, _N22 * (x * x - y * y)


@scalar
def degree3(x, y, z):
    """Return the seven harmonics of degree 3 in a direction."""
    zz, cc, ss = z * z, x * x - y * y, _2 * x * y
    a, b = _N31 * (_5 * zz - ONE), _N32 * z
    return (
        _N33 * (x * ss + y * cc), b * ss, a * y, _N30 * z * (_5 * zz - _3), a * x, b * cc,
        _N33 * (x * cc - y * ss),
    )  # fmt: skip


@scalar
def degree4(x, y, z):
    """Return the nine harmonics of degree 4 in a direction."""
    zz, cc, ss = z * z, x * x - y * y, _2 * x * y
    ccc, sss = x * cc - y * ss, x * ss + y * cc
    a, b, c = _N41 * z * (_7 * zz - _3), _N42 * (_7 * zz - ONE), _N43 * z
    return (
        _N44 * (x * sss + y * ccc), c * sss, b * ss, a * y, _N40 * ((_35 * zz - _30) * zz + _3),
        a * x, b * cc, c * ccc, _N44 * (x * ccc - y * sss),
    )  # fmt: skip


@scalar
def dot5(a, b):
    """Return the scalar product of five numbers each."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4]


@scalar
def dot7(a, b):
    """Return the scalar product of seven numbers each."""
    return (
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
        + (a[4] * b[4] + a[5] * b[5] + a[6] * b[6])
    )  # fmt: skip


@scalar
def dot9(a, b):
    """Return the scalar product of nine numbers each."""
    return (
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
        + (a[4] * b[4] + a[5] * b[5] + a[6] * b[6] + a[7] * b[7] + a[8] * b[8])
    )  # fmt: skip


@scalar
def unturned(r, d, m):
    """Return R^T e for the m-th of a degree's directions."""
    x, y, z = d[m], d[LANES + m], d[2 * LANES + m]
    return (
        r[0] * x + r[3] * y + r[6] * z,
        r[1] * x + r[4] * y + r[7] * z,
        r[2] * x + r[5] * y + r[8] * z,
    )


@scalar
def _coefficients5(sh, i, k, c):
    """Return five coefficients of a channel."""
    return sh[i, k, c], sh[i, k + 1, c], sh[i, k + 2, c], sh[i, k + 3, c], sh[i, k + 4, c]


@scalar
def _coefficients7(sh, i, k, c):
    """Return seven coefficients of a channel."""
    return (
        sh[i, k, c], sh[i, k + 1, c], sh[i, k + 2, c], sh[i, k + 3, c], sh[i, k + 4, c],
        sh[i, k + 5, c], sh[i, k + 6, c],
    )  # fmt: skip


@scalar
def _coefficients9(sh, i, k, c):
    """Return nine coefficients of a channel."""
    return (
        sh[i, k, c], sh[i, k + 1, c], sh[i, k + 2, c], sh[i, k + 3, c], sh[i, k + 4, c],
        sh[i, k + 5, c], sh[i, k + 6, c], sh[i, k + 7, c], sh[i, k + 8, c],
    )  # fmt: skip


@scalar
def _row5(a, i):
    """Return 5 numbers from the i-th on."""
    return a[i], a[i + 1], a[i + 2], a[i + 3], a[i + 4]


@scalar
def _column5(a, i):
    """Return the i-th number of each of 5 rows."""
    return a[i], a[LANES + i], a[2 * LANES + i], a[3 * LANES + i], a[4 * LANES + i]


@scalar
def _row7(a, i):
    """Return 7 numbers from the i-th on."""
    return a[i], a[i + 1], a[i + 2], a[i + 3], a[i + 4], a[i + 5], a[i + 6]


@scalar
def _column7(a, i):
    """Return the i-th number of each of 7 rows."""
    return (
        a[i],
        a[LANES + i],
        a[2 * LANES + i],
        a[3 * LANES + i],
        a[4 * LANES + i],
        a[5 * LANES + i],
        a[6 * LANES + i],
    )


@scalar
def _row9(a, i):
    """Return 9 numbers from the i-th on."""
    return a[i], a[i + 1], a[i + 2], a[i + 3], a[i + 4], a[i + 5], a[i + 6], a[i + 7], a[i + 8]


@scalar
def _column9(a, i):
    """Return the i-th number of each of 9 rows."""
    return (
        a[i],
        a[LANES + i],
        a[2 * LANES + i],
        a[3 * LANES + i],
        a[4 * LANES + i],
        a[5 * LANES + i],
        a[6 * LANES + i],
        a[7 * LANES + i],
        a[8 * LANES + i],
    )


@scalar
def _turn2(r, rest, values, out, i):
    """Rotate the 5 coefficients of degree 2 of one splat."""
    red, green, blue = (
        _coefficients5(rest, i, 4, 0), _coefficients5(rest, i, 4, 1),
        _coefficients5(rest, i, 4, 2),
    )  # fmt: skip
    for m in range(8):
        x, y, z = unturned(r, _D2, m)
        y_m = degree2(x, y, z)
        values[m], values[LANES + m], values[2 * LANES + m] = (
            dot5(y_m, red), dot5(y_m, green), dot5(y_m, blue),
        )  # fmt: skip
    red, green, blue = (
        _row5(values, 0), _row5(values, LANES), _row5(values, 2 * LANES),
    )  # fmt: skip
    for k in range(8):
        s = _column5(_S2, k)
        values[k], values[LANES + k], values[2 * LANES + k] = (
            dot5(s, red), dot5(s, green), dot5(s, blue),
        )  # fmt: skip
    for k in range(5):
        for c in range(3):
            out[i, 4 + k, c] = values[c * LANES + k]


@scalar
def _turn3(r, rest, values, out, i):
    """Rotate the 7 coefficients of degree 3 of one splat."""
    red, green, blue = (
        _coefficients7(rest, i, 9, 0), _coefficients7(rest, i, 9, 1),
        _coefficients7(rest, i, 9, 2),
    )  # fmt: skip
    for m in range(8):
        x, y, z = unturned(r, _D3, m)
        y_m = degree3(x, y, z)
        values[m], values[LANES + m], values[2 * LANES + m] = (
            dot7(y_m, red), dot7(y_m, green), dot7(y_m, blue),
        )  # fmt: skip
    red, green, blue = (
        _row7(values, 0), _row7(values, LANES), _row7(values, 2 * LANES),
    )  # fmt: skip
    for k in range(8):
        s = _column7(_S3, k)
        values[k], values[LANES + k], values[2 * LANES + k] = (
            dot7(s, red), dot7(s, green), dot7(s, blue),
        )  # fmt: skip
    for k in range(7):
        for c in range(3):
            out[i, 9 + k, c] = values[c * LANES + k]


@scalar
def _turn4(r, rest, values, out, i):
    """Rotate the 9 coefficients of degree 4 of one splat."""
    red, green, blue = (
        _coefficients9(rest, i, 16, 0), _coefficients9(rest, i, 16, 1),
        _coefficients9(rest, i, 16, 2),
    )  # fmt: skip
    for m in range(9):
        x, y, z = unturned(r, _D4, m)
        y_m = degree4(x, y, z)
        values[m], values[LANES + m], values[2 * LANES + m] = (
            dot9(y_m, red), dot9(y_m, green), dot9(y_m, blue),
        )  # fmt: skip
    red, green, blue = (
        _row9(values, 0), _row9(values, LANES), _row9(values, 2 * LANES),
    )  # fmt: skip
    for k in range(9):
        s = _column9(_S4, k)
        values[k], values[LANES + k], values[2 * LANES + k] = (
            dot9(s, red), dot9(s, green), dot9(s, blue),
        )  # fmt: skip
    for k in range(9):
        for c in range(3):
            out[i, 16 + k, c] = values[c * LANES + k]


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="gradient", writes=("out",))
def turns(i, gradient, cosine, out):
    """Compute the rotation of each splat, R of F = R U.

    Args:
        gradient: Shape (n, 3, 3).
        cosine: Cosine of half the angle from which splats count as rotated, f32.
        out: Receives unit quaternions with w >= 0, shape (n, 4); (1, 0, 0, 0) for smaller angles.
    """
    f = (
        gradient[i, 0, 0], gradient[i, 0, 1], gradient[i, 0, 2],
        gradient[i, 1, 0], gradient[i, 1, 1], gradient[i, 1, 2],
        gradient[i, 2, 0], gradient[i, 2, 1], gradient[i, 2, 2],
    )  # fmt: skip
    w, x, y, z = ONE, ZERO, ZERO, ZERO
    total = f[0] + f[1] + f[2] + f[3] + f[4] + f[5] + f[6] + f[7] + f[8]
    if not is_identity(f) and math.isfinite(total):
        w, x, y, z = matrix_quat(polar(f))
        if w < ZERO:
            w, x, y, z = -w, -x, -y, -z
        if not w < cosine:
            w, x, y, z = ONE, ZERO, ZERO, ZERO
    out[i, 0], out[i, 1], out[i, 2], out[i, 3] = w, x, y, z


@reduction(over="rotations", by="sum")
def count_turned(i, rotations):
    """Return the number of splats that are rotated.

    Args:
        rotations: Results of `turns`, shape (n, 4).
    """
    return np.float64(1) if rotations[i, 0] < ONE else np.float64(0)


@block_kernel(
    over="rest",
    writes=("out", "turned"),
    block=256,
    scratch=(BlockArray(shape=3 * LANES, dtype=np.float32),),
)
def rotate(first, last, values, rotations, rest, out, turned):
    """Compute the rotated coefficients of all splats from those at rest.

    Args:
        rotations: Results of `turns`, shape (n, 4).
        rest: Shape (n, k, 3), k = 4, 9, 16 or 25.
        out: Receives coefficients, shape (n, k, 3).
        turned: Receives 1 where `out` may differ from rest, else 0, shape (n,) u8.
    """
    count = rest.shape[1]
    for i in range(first, last):
        w, x, y, z = rotations[i, 0], rotations[i, 1], rotations[i, 2], rotations[i, 3]
        turns_now = (x != ZERO) | (y != ZERO) | (z != ZERO)
        if not turns_now:
            turned[i] = 0
            for k in range(count):
                for c in range(3):
                    out[i, k, c] = rest[i, k, c]
            continue
        turned[i] = 1
        r = quat_matrix(w, x, y, z)
        for c in range(3):
            # Degree 1 is (-y, z, -x) of a vector, which rotates as vectors do.
            vx, vy, vz = -rest[i, 3, c], -rest[i, 1, c], rest[i, 2, c]
            out[i, 0, c] = rest[i, 0, c]
            out[i, 1, c] = -(r[3] * vx + r[4] * vy + r[5] * vz)
            out[i, 2, c] = r[6] * vx + r[7] * vy + r[8] * vz
            out[i, 3, c] = -(r[0] * vx + r[1] * vy + r[2] * vz)
        if count > 4:
            _turn2(r, rest, values, out, i)
        if count > 9:
            _turn3(r, rest, values, out, i)
        if count > 16:
            _turn4(r, rest, values, out, i)
