"""Gradient of a deformation that is known only by where neighbours went: moving least squares.

The gradient that fits best how the neighbours at rest, X_j - X_i, moved is linear in their
displacements u_j: F = I + sum_j (u_j - u_i) g_ij^T with g_ij = w_ij A^-1 (X_j - X_i) and A the
weighted sum of squares of X_j - X_i. So all that depends on the state of rest is done once. What
nothing has moved has F = I to the bit.

Sheets say nothing about their thickness. There the normal is one more neighbour, which goes where
the normal of the deformed sheet is: it turns, and no more.

A gradient is worth what it explains. Where neighbours went apart, as where something tears, the
displacements are nothing like (F - I) (X_j - X_i), and F is noise that would stretch splats into
rays. So their difference, over the distances at rest, says how much of F is taken: first only the
rotation is left of it, then nothing. And a splat that is larger than its neighbourhood follows it
only in part. What is linear is taken as it is.

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
"""Part of the largest moment below which neighbours are in a plane or on a line."""
_RIDGE = np.float32(1e-2)
_REACH = np.float32(1.25)
"""Reach of the weight, in distances of the farthest neighbour."""

STRETCH_FROM, STRETCH_TO = np.float32(0.1), np.float32(0.4)
"""Root mean square of what F does not explain, in distances at rest: from where less of the stretch
is taken, and from where none."""
TURN_FROM, TURN_TO = np.float32(0.3), np.float32(0.9)
"""Likewise of the rotation."""

# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def inverse(xx, xy, xz, yy, yz, zz):
    """Of a symmetric matrix of size about 1, six numbers; each is 0 where it has none."""
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
    """(1 - q^2)^3 for q^2 = square / reach."""
    q = ONE - square / reach
    return q * q * q


@scalar
def sheet_normal(f, gx, gy, gz, nx, ny, nz):
    """F with the normal's part added: n_now g^T, where n_now is across the deformed sheet.

    f: gradient without it; g: the normal's weight vector; n: normal at rest.
    """
    mx, my, mz = nx, ny, nz
    for _ in range(2):
        a = (
            f[0] + mx * gx, f[1] + mx * gy, f[2] + mx * gz,
            f[3] + my * gx, f[4] + my * gy, f[5] + my * gz,
            f[6] + mz * gx, f[7] + mz * gy, f[8] + mz * gz,
        )  # fmt: skip
        # cofactors: two tangents' images have this cross product
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
    """1 up to start, 0 from end on, smooth between."""
    s = min(max((x - start) / (end - start), ZERO), ONE)
    return ONE - s * s * (np.float32(3) - TWO * s)


@scalar
def partly(f, stretch, turn):
    """R^turn (I + stretch (U - I)) of F = R U; F itself if both are 1, else I where F mirrors."""
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
    """What each neighbour's displacement counts for.

    Args:
        rest: Shape (n, 3).
        neighbours: Rows of `rest`, or -1, shape (n, k) i32.
        normals: Across the sheet at each splat, of length 1, or 0 where there is none, shape
            (n, 3); or (0, 3).
        weights: Receives g_ij, shape (n, k, 3).
        sheets: Receives the normal and its own g, shape (n, 2, 3); 0 where there is no sheet.
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
        # A line, or nobody: what is not known stays as it was.
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
    """Gradients of the deformation, as far as they explain where neighbours went.

    Args:
        rest: Shape (n, 3).
        displacements: From rest to now, shape (n, 3).
        neighbours: As `prepare` had them, shape (n, k) i32.
        weights: As `prepare` made them, shape (n, k, 3).
        sheets: As `prepare` made them, shape (n, 2, 3).
        sizes: How far splats reach, shape (n,); or (0,) where they are points.
        rows: 1 for the splats that are asked for, shape (n,) u8; or (0,) for all.
        out: Receives F, shape (n, 3, 3); other rows are left alone.
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
