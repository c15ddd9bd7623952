"""Skinning by joints or triangles: x' = A x + t, and A multiplied from the left onto the gradient.

Weights are those at bind time. They do not depend on x, so A is the derivative.

Sources: Magnenat-Thalmann, Laperrière & Thalmann 1988 (linear blend skinning); Kavan et al. 2008,
"Geometric Skinning with Approximate Dual Quaternion Blending"; Sumner & Popović 2004, "Deformation
Transfer for Triangle Meshes" (frame of a triangle); Guédon & Lepetit 2024, "SuGaR", and Waczyńska
et al. 2024, "GaMeS", for splats on triangles.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import exact, scalar
from ..launch import BlockArray, block_kernel, kernel

DUAL = 17
"""Columns of a joint for dual quaternions: rotation, dual part, stretch in row order."""


# --- 1. mathematics: one splat, one triangle --------------------------------------------


@scalar
def carry(m, points, gradient, i):
    """Transform splat i: m is (A | t) in row order, 12 numbers."""
    x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
    for a in range(3):
        points[i, a] = m[4 * a] * x + m[4 * a + 1] * y + m[4 * a + 2] * z + m[4 * a + 3]
    if gradient.shape[0] > 0:
        for b in range(3):
            x, y, z = gradient[i, 0, b], gradient[i, 1, b], gradient[i, 2, b]
            for a in range(3):
                gradient[i, a, b] = m[4 * a] * x + m[4 * a + 1] * y + m[4 * a + 2] * z


@exact
def cross(ax, ay, az, bx, by, bz):
    """Return a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@exact
def upright(ux, uy, uz, vx, vy, vz):
    """Return the third edge of a triangle's frame: its normal, scaled like its edges."""
    x, y, z = cross(ux, uy, uz, vx, vy, vz)
    length = math.sqrt(math.sqrt(x * x + y * y + z * z))
    return (x / length, y / length, z / length) if length > 0.0 else (0.0, 0.0, 0.0)


@scalar
def corner(points, triangles, weights, face, i, a):
    """Return coordinate `a` of the position of splat i on a face."""
    return (
        np.float64(weights[i, 0]) * points[triangles[face, 0], a]
        + np.float64(weights[i, 1]) * points[triangles[face, 1], a]
        + np.float64(weights[i, 2]) * points[triangles[face, 2], a]
    )


@scalar
def edge(points, triangles, face, end):
    """Return the vector from a face's first corner to another."""
    a, b = triangles[face, 0], triangles[face, end]
    return (
        np.float64(points[b, 0]) - points[a, 0],
        np.float64(points[b, 1]) - points[a, 1],
        np.float64(points[b, 2]) - points[a, 2],
    )


# --- 2. CPU ----------------------------------------------------------------------------


@block_kernel(
    over="points",
    writes=("points", "gradient"),
    scratch=(BlockArray(shape=12, dtype=np.float64),),
)
def blend_linear(first, last, m, points, gradient, indices, weights, amounts, joints):
    """Move splats by the weighted mean of their joints' transformations.

    Args:
        points: Changed in place, shape (n, 3) f32.
        gradient: Deformation gradients, changed in place, shape (n, 3, 3) f32, or empty.
        indices, weights: Joints of each splat, shape (n, k) i32, f32. If the weights sum to less
            than 1, the rest has the weight of the identity.
        amounts: Strength, 0 to 1, of each splat, shape (n,) f64, or of all, (1,).
        joints: (A | t) in row order, shape (j, 12) f64.
    """
    for i in range(first, last):
        amount = amounts[i] if len(amounts) > 1 else amounts[0]
        m[:] = 0.0
        stays = 1.0
        for k in range(indices.shape[1]):
            weight = amount * np.float64(weights[i, k])
            if weight != 0.0:
                stays -= weight
                for a in range(12):
                    m[a] += weight * joints[indices[i, k], a]
        m[0] += stays
        m[5] += stays
        m[10] += stays
        carry(m, points, gradient, i)


@block_kernel(
    over="points",
    writes=("points", "gradient"),
    scratch=(BlockArray(shape=29, dtype=np.float64),),
)
def blend_dual(first, last, own, points, gradient, indices, weights, amounts, joints):
    """Move splats by blended rigid motions of their joints; the stretch is blended linearly and
    applied first.

    Args:
        points, gradient, indices, weights, amounts: See `blend_linear`.
        joints: Shape (j, DUAL) f64.
    """
    m, s, q = own[:12], own[12:21], own[21:]
    for i in range(first, last):
        amount = amounts[i] if len(amounts) > 1 else amounts[0]
        pivot, most = np.int32(-1), np.float32(0)
        for k in range(indices.shape[1]):
            if weights[i, k] > most:
                pivot, most = indices[i, k], weights[i, k]
        if pivot >= 0 and amount > 0.0:
            q[:] = 0.0
            s[:] = 0.0
            stays = 1.0
            for k in range(indices.shape[1]):
                weight, j = amount * np.float64(weights[i, k]), indices[i, k]
                if weight != 0.0:
                    stays -= weight
                    cosine = 0.0
                    for a in range(4):
                        cosine += joints[j, a] * joints[pivot, a]
                    signed = -weight if cosine < 0.0 else weight
                    for a in range(8):
                        q[a] += signed * joints[j, a]
                    for a in range(9):
                        s[a] += weight * joints[j, 8 + a]
            q[0] += -stays if joints[pivot, 0] < 0.0 else stays
            for a in range(0, 9, 4):
                s[a] += stays
            square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
            if not square > 1e-12:  # opposite motions have no mean
                for a in range(8):
                    q[a] = joints[pivot, a]
                square = 1.0
            w, x, y, z = q[0], q[1], q[2], q[3]
            f = 2.0 / square
            m[0], m[1], m[2] = (
                1.0 - f * (y * y + z * z),
                f * (x * y - w * z),
                f * (x * z + w * y),
            )
            m[4], m[5], m[6] = (
                f * (x * y + w * z),
                1.0 - f * (x * x + z * z),
                f * (y * z - w * x),
            )
            m[8], m[9], m[10] = (
                f * (x * z - w * y),
                f * (y * z + w * x),
                1.0 - f * (x * x + y * y),
            )
            m[3] = f * (w * q[5] - x * q[4] - z * q[6] + y * q[7])
            m[7] = f * (w * q[6] - y * q[4] - x * q[7] + z * q[5])
            m[11] = f * (w * q[7] - z * q[4] - y * q[5] + x * q[6])
            for a in range(0, 12, 4):
                x, y, z = m[a], m[a + 1], m[a + 2]
                for b in range(3):
                    m[a + b] = x * s[b] + y * s[3 + b] + z * s[6 + b]
            carry(m, points, gradient, i)


@block_kernel(
    over="points",
    writes=("points", "gradient"),
    scratch=(BlockArray(shape=21, dtype=np.float64),),
)
def follow_triangles(
    first, last, own, points, gradient, faces, weights, amounts, triangles, before, after, bind
):
    """Move splats with the triangles that they are bound to.

    Args:
        points, gradient, amounts: See `blend_linear`.
        faces: Triangle of each splat, shape (n,) i32.
        weights: Barycentric weights on it, shape (n, 3) f32.
        triangles: Rows of points, shape (t, 3) i32.
        before, after: The mesh at bind time and now, shape (p, 3) f32.
        bind: Transformation of splats to the space in which they were bound, (A | t) in row order,
            shape (12,) f64.
    """
    m, f = own[:12], own[12:]
    for i in range(first, last):
        amount = amounts[i] if len(amounts) > 1 else amounts[0]
        face = faces[i]
        ux, uy, uz = edge(before, triangles, face, 1)
        vx, vy, vz = edge(before, triangles, face, 2)
        nx, ny, nz = upright(ux, uy, uz, vx, vy, vz)
        rux, ruy, ruz = cross(vx, vy, vz, nx, ny, nz)
        rvx, rvy, rvz = cross(nx, ny, nz, ux, uy, uz)
        rnx, rny, rnz = cross(ux, uy, uz, vx, vy, vz)
        volume = ux * rux + uy * ruy + uz * ruz
        u = edge(after, triangles, face, 1)
        v = edge(after, triangles, face, 2)
        w = upright(u[0], u[1], u[2], v[0], v[1], v[2])
        for a in range(3):
            f[3 * a] = (u[a] * rux + v[a] * rvx + w[a] * rnx) / volume
            f[3 * a + 1] = (u[a] * ruy + v[a] * rvy + w[a] * rny) / volume
            f[3 * a + 2] = (u[a] * ruz + v[a] * rvz + w[a] * rnz) / volume
        if not volume > 0.0:  # a triangle without area only translates its splats
            f[:] = 0.0
            f[0] = f[4] = f[8] = 1.0
        for a in range(3):
            shift = corner(after, triangles, weights, face, i, a)
            for b in range(4):
                total = 0.0
                for c in range(3):
                    total += f[3 * a + c] * bind[4 * c + b]
                m[4 * a + b] = amount * total
            for c in range(3):
                shift -= f[3 * a + c] * corner(before, triangles, weights, face, i, c)
            m[4 * a + 3] += amount * shift
            m[5 * a] += 1.0 - amount
        carry(m, points, gradient, i)


@kernel(over="faces", writes=("out_joints", "out_weights"))
def gather_weights(i, faces, places, triangles, joints, weights, out_joints, out_weights):
    """Transfer joints from a bound mesh: those of the triangle's points, with barycentric weights.

    The strongest are kept, of equal ones those with the lowest index, and normalized to a sum of 1.

    Args:
        faces, places: Triangle of each splat and barycentric weights, shape (n,) i32, (n, 3) f32.
        triangles: Rows of points, shape (t, 3) i32.
        joints, weights: Of the points, shape (p, k) i32, f32.
        out_joints, out_weights: Receive joints and weights, the strongest first, shape (n, m) i32,
            f32; zeros if there are fewer.
    """
    k, kept = joints.shape[1], out_joints.shape[1]
    face = faces[i]
    for m in range(kept):
        out_joints[i, m], out_weights[i, m] = np.int32(0), np.float32(0)
    for one in range(3 * k):
        joint = joints[triangles[face, one // k], one % k]
        total, is_new = np.float32(0), True
        for other in range(3 * k):
            row = triangles[face, other // k]
            if joints[row, other % k] == joint:
                is_new = is_new and other >= one
                total += places[i, other // k] * weights[row, other % k]
        at = kept
        while (
            is_new
            and at > 0
            and (
                total > out_weights[i, at - 1]
                or (total == out_weights[i, at - 1] and joint < out_joints[i, at - 1])
            )
        ):
            at -= 1
        if is_new and total > np.float32(0) and at < kept:
            for m in range(kept - 1, at, -1):
                out_joints[i, m] = out_joints[i, m - 1]
                out_weights[i, m] = out_weights[i, m - 1]
            out_joints[i, at], out_weights[i, at] = joint, total
    total = np.float32(0)
    for m in range(kept):
        total += out_weights[i, m]
    for m in range(kept):
        out_weights[i, m] = out_weights[i, m] / total if total > 0 else np.float32(0)
