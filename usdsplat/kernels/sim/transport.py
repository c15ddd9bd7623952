"""Deformation of a splat's ellipsoid by the space around it: Sigma' = F Sigma F^T, by its axes.

F is the deformation gradient at the splat. The columns of F R(q) diag(scales) span the new
ellipsoid; orthogonalized, they are its axes. Sigma' itself is never computed, as the rounding of
its largest eigenvalue would hide its smallest.

Source: Xie et al. 2024, "PhysGaussian" for Sigma'; for the rest see `matrix`.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .matrix import (
    ONE,
    ZERO,
    by_columns,
    cross,
    decompose,
    determinant,
    is_identity,
    is_mild,
    jacobi,
    matrix_quat,
    polar,
    product,
    quat_matrix,
    squares,
    transposed,
)

FULL, RIGID, VOLUME = range(3)
"""Policies: a splat follows the whole deformation, only its rotation, or all except the change of
volume."""

_THIRD = np.float32(-1 / 3)
_THIN = np.float32(1e-6)
"""Fraction of the longest axis to which shorter axes are raised for the deformation."""
_TINY = np.float32(1e-30)


@scalar
def guarded(f, limit):
    """Return F with its principal stretches clamped to [1 / limit, limit]; the nearest rotation if
    F mirrors or is singular."""
    u, (x, y, z), v = decompose(f)
    if determinant(f) > ZERO:
        least = ONE / limit
        x, y, z = min(max(x, least), limit), min(max(y, least), limit), min(max(z, least), limit)
    else:
        x, y, z = ONE, ONE, ONE
    return product(by_columns(u, x, y, z), transposed(v))


@scalar
def face(a, sx, sy, sz):
    """Return the area spanned by the two longest axes; `a` has the axes as columns, of lengths sx,
    sy, sz."""
    if (sz <= sx) & (sz <= sy):
        x, y, z = cross(a[0], a[3], a[6], a[1], a[4], a[7])
    elif sy <= sx:
        x, y, z = cross(a[2], a[5], a[8], a[0], a[3], a[6])
    else:
        x, y, z = cross(a[1], a[4], a[7], a[2], a[5], a[8])
    return math.sqrt(x * x + y * y + z * z)


@scalar
def carried(f, w, x, y, z, sx, sy, sz):
    """Return unit quaternion and scales of an ellipsoid deformed by F, and the growth of its
    face."""
    longest = max(sx, max(sy, max(sz, _TINY)))
    px, py, pz = sx / longest, sy / longest, sz / longest
    ux, uy, uz = max(px, _THIN), max(py, _THIN), max(pz, _THIN)
    turned = product(f, quat_matrix(w, x, y, z))
    area = face(turned, sx, sy, sz)
    axes, _ = jacobi(by_columns(turned, ux, uy, uz), turned)
    xx, yy, zz = squares(axes)
    lx, ly, lz = math.sqrt(xx), math.sqrt(yy), math.sqrt(zz)
    w, x, y, z = matrix_quat(by_columns(axes, ONE / lx, ONE / ly, ONE / lz))
    return w, x, y, z, lx * longest * px / ux, ly * longest * py / uy, lz * longest * pz / uz, area


@kernel(over="gradient", writes=("rotations", "scales", "areas"))
def transport(i, gradient, rest_rotations, rest_scales, policy, limits, rotations, scales, areas):
    """Compute the ellipsoid of each splat from the ellipsoid at rest.

    Args:
        gradient: Shape (n, 3, 3). Rows that are exactly the identity, or not finite, give the rest
            ellipsoid.
        rest_rotations: Shape (n, 4).
        rest_scales: Shape (n, 3).
        policy: FULL, RIGID or VOLUME.
        limits: Largest principal stretch of each splat, at least 1, shape (n,) f32, or of all,
            (1,).
        rotations: Those of the time before, replaced by the nearer one of q and -q, shape (n, 4).
        scales: Receives scales, shape (n, 3).
        areas: Receives the growth factor of each ellipsoid's face, shape (n,), or (0,) if not
            needed.
    """
    f = (
        gradient[i, 0, 0], gradient[i, 0, 1], gradient[i, 0, 2],
        gradient[i, 1, 0], gradient[i, 1, 1], gradient[i, 1, 2],
        gradient[i, 2, 0], gradient[i, 2, 1], gradient[i, 2, 2],
    )  # fmt: skip
    w, x, y, z = (
        rest_rotations[i, 0], rest_rotations[i, 1],
        rest_rotations[i, 2], rest_rotations[i, 3],
    )  # fmt: skip
    sx, sy, sz = rest_scales[i, 0], rest_scales[i, 1], rest_scales[i, 2]
    area = ONE
    limit = limits[i] if len(limits) > 1 else limits[0]
    total = f[0] + f[1] + f[2] + f[3] + f[4] + f[5] + f[6] + f[7] + f[8]
    if not is_identity(f) and math.isfinite(total):
        if policy == RIGID:
            w, x, y, z = matrix_quat(product(polar(f), quat_matrix(w, x, y, z)))
        else:
            if not is_mild(f, limit):
                f = guarded(f, limit)
            if policy == VOLUME:
                k = determinant(f) ** _THIRD
                f = by_columns(f, k, k, k)
            w, x, y, z, sx, sy, sz, area = carried(f, w, x, y, z, sx, sy, sz)
    dot = (
        w * rotations[i, 0] + x * rotations[i, 1]
        + y * rotations[i, 2] + z * rotations[i, 3]
    )  # fmt: skip
    if dot < ZERO:
        w, x, y, z = -w, -x, -y, -z
    rotations[i, 0], rotations[i, 1], rotations[i, 2], rotations[i, 3] = w, x, y, z
    scales[i, 0], scales[i, 1], scales[i, 2] = sx, sy, sz
    if len(areas) > 0:
        areas[i] = area


@kernel(over="opacities", writes=("out",))
def thin(i, opacities, areas, out):
    """Compute opacities that keep the amount of matter on a face that has grown: 1 - (1 - a)^(1 /
    area).

    Args:
        opacities: Opacities at rest, shape (n,).
        areas: Results of `transport`, shape (n,).
        out: Receives opacities, shape (n,).
    """
    a = opacities[i]
    if areas[i] != ONE:
        a = ONE - (ONE - a) ** (ONE / areas[i])
    out[i] = a
