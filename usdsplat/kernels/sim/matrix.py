"""3x3 matrices and quaternions as tuples of numbers: products, polar and singular value
decomposition.

A matrix is nine float32 in row order, a quaternion four with the real part first. Decompositions
use one-sided Jacobi rotations: columns of a matrix are rotated in pairs until they are orthogonal.
This keeps the relative accuracy of small singular values, which forming A A^T would lose.

Source: Hestenes 1958, "Inversion of matrices by biorthogonalization"; Demmel & Veselić 1992,
"Jacobi's method is more accurate than QR"; Higham 1986 for the polar factors.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar

SWEEPS = 4
"""Sweeps over the three pairs of columns; convergence is quadratic."""

ZERO, ONE, TWO, HALF = np.float32(0), np.float32(1), np.float32(2), np.float32(0.5)
_ORTHOGONAL = np.float32((3 * 2.0**-24) ** 2)
"""Square of the cosine below which two columns count as orthogonal.

Smaller values are rounding, and rotating by them would change the orientation of round splats in
each frame.
"""
_FLAT = np.float32(1e-6)
"""Singular values below this fraction of the largest count as zero."""
_TINY = np.float32(1e-30)


@scalar
def product(a, b):
    """Return A B."""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )


@scalar
def transposed(a):
    """Return A^T."""
    return a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]


@scalar
def by_columns(a, x, y, z):
    """Return A diag(x, y, z)."""
    return a[0] * x, a[1] * y, a[2] * z, a[3] * x, a[4] * y, a[5] * z, a[6] * x, a[7] * y, a[8] * z


@scalar
def cross(ax, ay, az, bx, by, bz):
    """Return a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@scalar
def determinant(a):
    """Return |A|."""
    x, y, z = cross(a[0], a[3], a[6], a[1], a[4], a[7])
    return x * a[2] + y * a[5] + z * a[8]


@scalar
def is_identity(a):
    """Return whether A is exactly the identity."""
    return (
        (a[0] == ONE) & (a[4] == ONE) & (a[8] == ONE)
        & (a[1] == ZERO) & (a[2] == ZERO) & (a[3] == ZERO)
        & (a[5] == ZERO) & (a[6] == ZERO) & (a[7] == ZERO)
    )  # fmt: skip


@scalar
def squares(a):
    """Return the squared length of each column."""
    return (
        a[0] * a[0] + a[3] * a[3] + a[6] * a[6],
        a[1] * a[1] + a[4] * a[4] + a[7] * a[7],
        a[2] * a[2] + a[5] * a[5] + a[8] * a[8],
    )


@scalar
def quat_matrix(w, x, y, z):
    """Return the rotation matrix of a quaternion of any length but 0."""
    s = TWO / (w * w + x * x + y * y + z * z)
    wx, wy, wz = s * w * x, s * w * y, s * w * z
    xx, yy, zz = s * x * x, s * y * y, s * z * z
    xy, yz, zx = s * x * y, s * y * z, s * z * x
    return (
        ONE - (yy + zz), xy - wz, zx + wy,
        xy + wz, ONE - (xx + zz), yz - wx,
        zx - wy, yz + wx, ONE - (xx + yy),
    )  # fmt: skip


@scalar
def matrix_quat(a):
    """Return the unit quaternion of a rotation, with the sign that makes its largest component
    positive.

    Source: Shepperd 1978, "Quaternion from rotation matrix".
    """
    if a[0] + a[4] + a[8] > ZERO:
        w, x, y, z = ONE + a[0] + a[4] + a[8], a[7] - a[5], a[2] - a[6], a[3] - a[1]
    elif (a[0] >= a[4]) & (a[0] >= a[8]):
        w, x, y, z = a[7] - a[5], ONE + a[0] - a[4] - a[8], a[3] + a[1], a[2] + a[6]
    elif a[4] >= a[8]:
        w, x, y, z = a[2] - a[6], a[3] + a[1], ONE + a[4] - a[0] - a[8], a[7] + a[5]
    else:
        w, x, y, z = a[3] - a[1], a[2] + a[6], a[7] + a[5], ONE + a[8] - a[0] - a[4]
    s = ONE / math.sqrt(w * w + x * x + y * y + z * z)
    return w * s, x * s, y * s, z * s


@scalar
def angle_between(a, b, c):
    """Return cosine and sine of the rotation that makes two columns orthogonal.

    The angle is at most 45 degrees, so that each column stays closest to its old direction.

    a, b: squared lengths of the columns; c: their scalar product.
    """
    d, e = b - a, TWO * c
    r = ONE / math.sqrt(d * d + e * e)
    cosine = math.sqrt(HALF + HALF * abs(d) * r)
    sine = math.copysign(c * r / cosine, c * d)
    if c * c <= _ORTHOGONAL * a * b:
        return ONE, ZERO
    return cosine, sine


@scalar
def jacobi(a, v):
    """Return (A Q, V Q) for the rotation Q that makes the columns of A Q orthogonal."""
    a0, a1, a2, a3, a4, a5, a6, a7, a8 = a
    v0, v1, v2, v3, v4, v5, v6, v7, v8 = v
    for _ in range(SWEEPS):
        aa, bb, cc = squares((a0, a1, a2, a3, a4, a5, a6, a7, a8))
        c, s = angle_between(aa, bb, a0 * a1 + a3 * a4 + a6 * a7)
        a0, a1, a3, a4 = c * a0 - s * a1, s * a0 + c * a1, c * a3 - s * a4, s * a3 + c * a4
        a6, a7 = c * a6 - s * a7, s * a6 + c * a7
        v0, v1, v3, v4 = c * v0 - s * v1, s * v0 + c * v1, c * v3 - s * v4, s * v3 + c * v4
        v6, v7 = c * v6 - s * v7, s * v6 + c * v7
        aa, bb, cc = squares((a0, a1, a2, a3, a4, a5, a6, a7, a8))
        c, s = angle_between(aa, cc, a0 * a2 + a3 * a5 + a6 * a8)
        a0, a2, a3, a5 = c * a0 - s * a2, s * a0 + c * a2, c * a3 - s * a5, s * a3 + c * a5
        a6, a8 = c * a6 - s * a8, s * a6 + c * a8
        v0, v2, v3, v5 = c * v0 - s * v2, s * v0 + c * v2, c * v3 - s * v5, s * v3 + c * v5
        v6, v8 = c * v6 - s * v8, s * v6 + c * v8
        aa, bb, cc = squares((a0, a1, a2, a3, a4, a5, a6, a7, a8))
        c, s = angle_between(bb, cc, a1 * a2 + a4 * a5 + a7 * a8)
        a1, a2, a4, a5 = c * a1 - s * a2, s * a1 + c * a2, c * a4 - s * a5, s * a4 + c * a5
        a7, a8 = c * a7 - s * a8, s * a7 + c * a8
        v1, v2, v4, v5 = c * v1 - s * v2, s * v1 + c * v2, c * v4 - s * v5, s * v4 + c * v5
        v7, v8 = c * v7 - s * v8, s * v7 + c * v8
    return (a0, a1, a2, a3, a4, a5, a6, a7, a8), (v0, v1, v2, v3, v4, v5, v6, v7, v8)


@scalar
def _smallest_last(a, x, y, z):
    """Return the columns in cyclic order, with the column of the smallest of x, y, z last."""
    if (z <= x) & (z <= y):
        return a
    if y <= x:
        return a[2], a[0], a[1], a[5], a[3], a[4], a[8], a[6], a[7]
    return a[1], a[2], a[0], a[4], a[5], a[3], a[7], a[8], a[6]


@scalar
def decompose(f):
    """Decompose F = U diag(s) V^T with rotations U and V: (U, (s0, s1, s2), V), smallest s last.

    If F mirrors, the decomposition is that of the nearest matrix that does not: U is computed as if
    the smallest s were not negative. If the rank of F is less than 2, U and V are the identity.
    """
    a, v = jacobi(f, (ONE, ZERO, ZERO, ZERO, ONE, ZERO, ZERO, ZERO, ONE))
    xx, yy, zz = squares(a)
    a, v = _smallest_last(a, xx, yy, zz), _smallest_last(v, xx, yy, zz)
    xx, yy, zz = squares(a)
    x, y, z = math.sqrt(xx), math.sqrt(yy), math.sqrt(zz)
    if not min(x, y) > max(max(x, y) * _FLAT, _TINY):
        one = (ONE, ZERO, ZERO, ZERO, ONE, ZERO, ZERO, ZERO, ONE)
        return one, (x, y, z), one
    ux, uy, uz = a[0] / x, a[3] / x, a[6] / x
    wx, wy, wz = a[1] / y, a[4] / y, a[7] / y
    nx, ny, nz = cross(ux, uy, uz, wx, wy, wz)
    return (ux, wx, nx, uy, wy, ny, uz, wz, nz), (x, y, z), v


@scalar
def is_mild(f, limit):
    """Return whether F does not mirror and all its principal stretches are within [1 / limit,
    limit].

    The test uses the norm of F^T F - I. It may return False although the stretches are within.
    """
    xx, yy, zz = squares(f)
    xy = f[0] * f[1] + f[3] * f[4] + f[6] * f[7]
    yz = f[1] * f[2] + f[4] * f[5] + f[7] * f[8]
    zx = f[2] * f[0] + f[5] * f[3] + f[8] * f[6]
    xx, yy, zz = xx - ONE, yy - ONE, zz - ONE
    most = ONE - ONE / (limit * limit)
    size = xx * xx + yy * yy + zz * zz + (xy * xy + yz * yz + zx * zx) * TWO
    return (size <= most * most) & (determinant(f) > ZERO)


@scalar
def polar(f):
    """Return the rotation nearest to F: R of F = R U, for an F that does not mirror.

    Uses Newton's iteration if it is certain to converge in four steps, else singular values.
    """
    if not is_mild(f, TWO):
        u, _, v = decompose(f)
        return product(u, transposed(v))
    for _ in range(4):
        ax, ay, az = cross(f[1], f[4], f[7], f[2], f[5], f[8])
        bx, by, bz = cross(f[2], f[5], f[8], f[0], f[3], f[6])
        cx, cy, cz = cross(f[0], f[3], f[6], f[1], f[4], f[7])
        k = HALF / (cx * f[2] + cy * f[5] + cz * f[8])
        f = (
            HALF * f[0] + k * ax, HALF * f[1] + k * bx, HALF * f[2] + k * cx,
            HALF * f[3] + k * ay, HALF * f[4] + k * by, HALF * f[5] + k * cy,
            HALF * f[6] + k * az, HALF * f[7] + k * bz, HALF * f[8] + k * cz,
        )  # fmt: skip
    return f
