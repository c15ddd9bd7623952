"""Deformation gradients from the displacements of neighbours, by moving least squares.

The gradient that best fits how the rest offsets to neighbours, X_j - X_i, have changed is linear in
the displacements u_j: F = I + sum_j (u_j - u_i) g_ij^T with g_ij = w_ij A^-1 (X_j - X_i), where A
is the weighted sum of the outer products of X_j - X_i. Everything that depends only on the rest
state is computed once. Without displacements, F = I exactly.

The points of a sheet do not determine its change of thickness. There the normal is used as one more
neighbour, which moves to the normal of the deformed sheet, without a change of length.

F is used only as far as it explains the displacements. Where neighbours move apart, for instance at
a tear, the displacements differ much from (F - I) (X_j - X_i), and F is noise that would stretch
splats into rays. The difference relative to the rest distances controls how much of F is used:
first the stretch is reduced, then the rotation. Splats larger than their neighbourhood follow it
only in part. Linear deformations are kept exactly.

Source: Müller et al. 2004, "Point based animation of elastic, plastic and melting objects".
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .matrix import (
    ONE,
    TWO,
    ZERO,
    cross,
    decompose,
    determinant,
    matrix_quat,
    polar,
    product,
    quat_matrix,
    transposed,
)

LEAST = np.float32(1e-4)
"""Fraction of the largest moment below which neighbours are in a plane or on a line."""
_RIDGE = np.float32(1e-2)
_REACH = np.float32(1.25)
"""Radius of the weight function, relative to the distance of the farthest neighbour."""

STRETCH_FROM, STRETCH_TO = np.float32(0.1), np.float32(0.4)
"""Root mean square of the unexplained displacement, relative to rest distances, between which the
stretch is reduced to none."""
TURN_FROM, TURN_TO = np.float32(0.3), np.float32(0.9)
"""The same for the rotation."""

# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def inverse(xx, xy, xz, yy, yz, zz):
    """Return the inverse of a symmetric matrix of size about 1, six numbers; 0s if it has none."""
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    d = xx * a + xy * b + xz * c
    k = ONE / d if d > ZERO else ZERO
    return (
        a * k,
        b * k,
        c * k,
        (xx * zz - xz * xz) * k,
        (xy * xz - xx * yz) * k,
        (xx * yy - xy * xy) * k,
    )


@scalar
def weight(square, reach):
    """Return (1 - q^2)^3 for q^2 = square / reach."""
    q = ONE - square / reach
    return q * q * q


@scalar
def sheet_normal(f, gx, gy, gz, nx, ny, nz):
    """Return F with the contribution of the normal, n_now g^T, where n_now is normal to the
    deformed sheet.

    f: gradient without this contribution; g: weight vector of the normal; n: normal at rest.
    """
    mx, my, mz = nx, ny, nz
    for _ in range(2):
        a = (
            f[0] + mx * gx, f[1] + mx * gy, f[2] + mx * gz,
            f[3] + my * gx, f[4] + my * gy, f[5] + my * gz,
            f[6] + mz * gx, f[7] + mz * gy, f[8] + mz * gz,
        )  # fmt: skip
        # Cofactors: the cross product of the images of two tangents
        ax, ay, az = cross(a[1], a[4], a[7], a[2], a[5], a[8])
        bx, by, bz = cross(a[2], a[5], a[8], a[0], a[3], a[6])
        cx, cy, cz = cross(a[0], a[3], a[6], a[1], a[4], a[7])
        x, y, z = (
            ax * nx + bx * ny + cx * nz,
            ay * nx + by * ny + cy * nz,
            az * nx + bz * ny + cz * nz,
        )
        length = math.sqrt(x * x + y * y + z * z)
        if not length > np.float32(1e-12):
            break
        mx, my, mz = x / length, y / length, z / length
    return (
        f[0] + mx * gx, f[1] + mx * gy, f[2] + mx * gz,
        f[3] + my * gx, f[4] + my * gy, f[5] + my * gz,
        f[6] + mz * gx, f[7] + mz * gy, f[8] + mz * gz,
    )  # fmt: skip


@scalar
def faded(x, start, end):
    """Return 1 up to start, 0 from end on, and a smooth transition between."""
    s = min(max((x - start) / (end - start), ZERO), ONE)
    return ONE - s * s * (np.float32(3) - TWO * s)


@scalar
def partly(f, stretch, turn):
    """Return R^turn (I + stretch (U - I)) of F = R U.

    If both factors are 1 it is F, else I if F mirrors.
    """
    if (stretch == ONE) & (turn == ONE):
        return f
    if ((stretch == ZERO) & (turn == ZERO)) | (not determinant(f) > ZERO):
        return ONE, ZERO, ZERO, ZERO, ONE, ZERO, ZERO, ZERO, ONE
    r = polar(f)
    u = product(transposed(r), f)
    w, x, y, z = matrix_quat(r)
    if w < ZERO:
        w, x, y, z = -w, -x, -y, -z
    rest = ONE - stretch
    return product(
        quat_matrix(ONE + turn * (w - ONE), turn * x, turn * y, turn * z),
        (
            stretch * u[0] + rest, stretch * u[1], stretch * u[2],
            stretch * u[3], stretch * u[4] + rest, stretch * u[5],
            stretch * u[6], stretch * u[7], stretch * u[8] + rest,
        ),
    )  # fmt: skip


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="neighbours", writes=("weights", "sheets"))
def prepare(i, rest, neighbours, normals, weights, sheets):
    """Compute the weight vectors of the neighbours' displacements.

    Args:
        rest: Rest positions, shape (n, 3).
        neighbours: Rows of `rest`, or -1, shape (n, k) i32.
        normals: Normal of the sheet at each splat, unit length, or 0 if there is none, shape (n,
            3); or (0, 3).
        weights: Receives g_ij, shape (n, k, 3).
        sheets: Receives the normal and its own g, shape (n, 2, 3); 0 if there is no sheet.
    """
    k = neighbours.shape[1]
    px, py, pz = rest[i, 0], rest[i, 1], rest[i, 2]
    farthest = ZERO
    for m in range(k):
        j = neighbours[i, m]
        if j >= 0:
            x, y, z = rest[j, 0] - px, rest[j, 1] - py, rest[j, 2] - pz
            farthest = max(farthest, x * x + y * y + z * z)
    scale = ONE / math.sqrt(farthest) if farthest > np.float32(1e-30) else ZERO
    xx, xy, xz, yy, yz, zz = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    for m in range(k):
        j = neighbours[i, m]
        if j >= 0:
            x, y, z = rest[j, 0] - px, rest[j, 1] - py, rest[j, 2] - pz
            x, y, z = x * scale, y * scale, z * scale
            w = weight(x * x + y * y + z * z, _REACH * _REACH)
            xx, xy, xz = xx + w * x * x, xy + w * x * y, xz + w * x * z
            yy, yz, zz = yy + w * y * y, yz + w * y * z, zz + w * z * z
    nx, ny, nz = ZERO, ZERO, ZERO
    if len(normals) > 0:
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    u, (a, c, d), _ = decompose((xx, xy, xz, xy, yy, yz, xz, yz, zz))
    most, middle = max(a, c), min(a, c)
    if (nx == ZERO) & (ny == ZERO) & (nz == ZERO) & (d <= LEAST * most):
        nx, ny, nz = u[2], u[5], u[8]
    if middle <= LEAST * most:
        # Neighbours on a line, or none: keep the identity in undetermined directions.
        ridge = _RIDGE * most if most > ZERO else ONE
        xx, yy, zz = xx + ridge, yy + ridge, zz + ridge
        nx, ny, nz = ZERO, ZERO, ZERO
    p = (a + c) / np.float32(2)
    xx, xy, xz = xx + p * nx * nx, xy + p * nx * ny, xz + p * nx * nz
    yy, yz, zz = yy + p * ny * ny, yz + p * ny * nz, zz + p * nz * nz
    ixx, ixy, ixz, iyy, iyz, izz = inverse(xx, xy, xz, yy, yz, zz)
    for m in range(k):
        j = neighbours[i, m]
        gx, gy, gz = ZERO, ZERO, ZERO
        if j >= 0:
            x, y, z = rest[j, 0] - px, rest[j, 1] - py, rest[j, 2] - pz
            x, y, z = x * scale, y * scale, z * scale
            w = weight(x * x + y * y + z * z, _REACH * _REACH) * scale
            gx = w * (ixx * x + ixy * y + ixz * z)
            gy = w * (ixy * x + iyy * y + iyz * z)
            gz = w * (ixz * x + iyz * y + izz * z)
        weights[i, m, 0], weights[i, m, 1], weights[i, m, 2] = gx, gy, gz
    sheets[i, 0, 0], sheets[i, 0, 1], sheets[i, 0, 2] = nx, ny, nz
    sheets[i, 1, 0] = p * (ixx * nx + ixy * ny + ixz * nz)
    sheets[i, 1, 1] = p * (ixy * nx + iyy * ny + iyz * nz)
    sheets[i, 1, 2] = p * (ixz * nx + iyz * ny + izz * nz)


@kernel(over="neighbours", writes=("out",))
def gradients(i, rest, displacements, neighbours, weights, sheets, sizes, rows, out):
    """Compute deformation gradients, as far as they explain the displacements of neighbours.

    Args:
        rest: Rest positions, shape (n, 3).
        displacements: Displacements from rest, shape (n, 3).
        neighbours: See `prepare`, shape (n, k) i32.
        weights: From `prepare`, shape (n, k, 3).
        sheets: From `prepare`, shape (n, 2, 3).
        sizes: Radii of splats, shape (n,), or (0,) for points.
        rows: 1 for the splats to compute, shape (n,) u8, or (0,) for all.
        out: Receives F, shape (n, 3, 3); other rows are not changed.
    """
    k = neighbours.shape[1]
    if len(rows) > 0 and rows[i] == 0:
        return
    px, py, pz = displacements[i, 0], displacements[i, 1], displacements[i, 2]
    f0, f1, f2, f3, f4, f5, f6, f7, f8 = ONE, ZERO, ZERO, ZERO, ONE, ZERO, ZERO, ZERO, ONE
    moved = False
    for m in range(k):
        j = neighbours[i, m]
        if j >= 0:
            x = displacements[j, 0] - px
            y = displacements[j, 1] - py
            z = displacements[j, 2] - pz
            gx, gy, gz = weights[i, m, 0], weights[i, m, 1], weights[i, m, 2]
            f0, f1, f2 = f0 + x * gx, f1 + x * gy, f2 + x * gz
            f3, f4, f5 = f3 + y * gx, f4 + y * gy, f5 + y * gz
            f6, f7, f8 = f6 + z * gx, f7 + z * gy, f8 + z * gz
            moved |= (x != ZERO) | (y != ZERO) | (z != ZERO)
    nx, ny, nz = sheets[i, 0, 0], sheets[i, 0, 1], sheets[i, 0, 2]
    if moved & ((nx != ZERO) | (ny != ZERO) | (nz != ZERO)):
        gx, gy, gz = sheets[i, 1, 0], sheets[i, 1, 1], sheets[i, 1, 2]
        f0, f1, f2 = f0 - nx * gx, f1 - nx * gy, f2 - nx * gz
        f3, f4, f5 = f3 - ny * gx, f4 - ny * gy, f5 - ny * gz
        f6, f7, f8 = f6 - nz * gx, f7 - nz * gy, f8 - nz * gz
        f0, f1, f2, f3, f4, f5, f6, f7, f8 = sheet_normal(
            (f0, f1, f2, f3, f4, f5, f6, f7, f8), gx, gy, gz, nx, ny, nz
        )
    if moved:
        unexplained, square, farthest = ZERO, ZERO, ZERO
        for m in range(k):
            j = neighbours[i, m]
            if j >= 0:
                x = rest[j, 0] - rest[i, 0]
                y = rest[j, 1] - rest[i, 1]
                z = rest[j, 2] - rest[i, 2]
                ex = displacements[j, 0] - px - ((f0 - ONE) * x + f1 * y + f2 * z)
                ey = displacements[j, 1] - py - (f3 * x + (f4 - ONE) * y + f5 * z)
                ez = displacements[j, 2] - pz - (f6 * x + f7 * y + (f8 - ONE) * z)
                unexplained += ex * ex + ey * ey + ez * ez
                square += x * x + y * y + z * z
                farthest = max(farthest, x * x + y * y + z * z)
        error = math.sqrt(unexplained / square) if square > ZERO else ZERO
        known = ONE
        if len(sizes) > 0 and sizes[i] * sizes[i] > farthest:
            known = math.sqrt(farthest) / sizes[i]
        f0, f1, f2, f3, f4, f5, f6, f7, f8 = partly(
            (f0, f1, f2, f3, f4, f5, f6, f7, f8),
            known * faded(error, STRETCH_FROM, STRETCH_TO),
            known * faded(error, TURN_FROM, TURN_TO),
        )
    out[i, 0, 0], out[i, 0, 1], out[i, 0, 2] = f0, f1, f2
    out[i, 1, 0], out[i, 1, 1], out[i, 1, 2] = f3, f4, f5
    out[i, 2, 0], out[i, 2, 1], out[i, 2, 2] = f6, f7, f8
