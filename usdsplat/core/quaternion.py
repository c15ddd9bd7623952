"""Algebra of rotations as unit quaternions (w, x, y, z), in rows; functions keep the dtype."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating[Any]]


def normalize(quaternions: Floats) -> Floats:
    """Normalise quaternions, shape (n, 4); zero becomes the identity, NaN stays NaN."""
    # Divide by the largest component first: squares of extreme values would leave float32.
    w, x, y, z = np.abs(quaternions).T
    largest = np.maximum(np.maximum(w, x), np.maximum(y, z))[:, None]
    is_zero = largest == 0
    with np.errstate(invalid="ignore"):  # infinities have no direction and become NaN
        out = quaternions / np.where(is_zero, quaternions.dtype.type(1), largest)
        out[is_zero[:, 0], 0] = 1
        out /= np.sqrt(np.einsum("ni,ni->n", out, out))[:, None]
    return out


def multiply(a: Floats, b: Floats) -> Floats:
    """Return the Hamilton product: rotate by `b`, then by `a`. Shapes (n, 4) or (4,), broadcast."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def to_matrix(quaternions: Floats) -> Floats:
    """Return rotation matrices of unit quaternions (n, 4), column vectors, shape (n, 3, 3)."""
    w, x, y, z = quaternions.T
    out = np.empty((len(quaternions), 3, 3), quaternions.dtype)
    out[:, 0, 0] = 1 - 2 * (y * y + z * z)
    out[:, 0, 1] = 2 * (x * y - w * z)
    out[:, 0, 2] = 2 * (x * z + w * y)
    out[:, 1, 0] = 2 * (x * y + w * z)
    out[:, 1, 1] = 1 - 2 * (x * x + z * z)
    out[:, 1, 2] = 2 * (y * z - w * x)
    out[:, 2, 0] = 2 * (x * z - w * y)
    out[:, 2, 1] = 2 * (y * z + w * x)
    out[:, 2, 2] = 1 - 2 * (x * x + y * y)
    return out


def from_matrix(matrices: Floats) -> Floats:
    """Return unit quaternions of rotation matrices (n, 3, 3), w >= 0, shape (n, 4).

    Of the four formulas, each row uses the one with the largest divisor, so no angle is
    ill-conditioned.

    Source: Shepperd 1978, "Quaternion from Rotation Matrix".
    """
    m = matrices
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    wx, wy, wz = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    xy, xz, yz = m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1]
    # Row i of this symmetric table is 4 q_i (w, x, y, z): any row is the result up to length.
    table = np.stack(
        [
            np.stack([1 + xx + yy + zz, wx, wy, wz], axis=1),
            np.stack([wx, 1 + xx - yy - zz, xy, xz], axis=1),
            np.stack([wy, xy, 1 - xx + yy - zz, yz], axis=1),
            np.stack([wz, xz, yz, 1 - xx - yy + zz], axis=1),
        ],
        axis=1,
    )
    best = np.argmax(np.einsum("nii->ni", table), axis=1)
    out = normalize(table[np.arange(len(m)), best])
    return np.where(out[:, :1] < 0, -out, out)


def slerp(a: Floats, b: Floats, t: Any) -> Floats:
    """Interpolate at constant speed along the shorter arc.

    Args:
        a: Unit quaternions at t = 0, shape (n, 4).
        b: Unit quaternions at t = 1, shape (n, 4); b and -b are the same rotation.
        t: Parameter [0..1], a number or shape (n,).

    Source: Shoemake 1985, "Animating Rotation with Quaternion Curves".
    """
    cosine = np.einsum("ni,ni->n", a, b)
    sign = np.where(cosine < 0, -1, 1).astype(a.dtype)
    # atan2 of chords is exact for nearly equal quaternions; acos is not.
    near = b * sign[:, None]
    half = np.arctan2(np.linalg.norm(near - a, axis=1), np.linalg.norm(near + a, axis=1))
    angle = 2 * half
    t = np.broadcast_to(np.asarray(t, a.dtype), cosine.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        is_arc = angle > 1e-6
        start = np.where(is_arc, np.sin((1 - t) * angle) / np.sin(angle), 1 - t)
        end = np.where(is_arc, np.sin(t * angle) / np.sin(angle), t)
    return normalize(start[:, None] * a + end[:, None] * near).astype(a.dtype)
