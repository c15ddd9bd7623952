"""Project splats: a Gaussian in its prim's space becomes an ellipse on the screen.

Camera space here is x right, y down, z forward. Pixel (0, 0) is centred on (0, 0), so a pixel's
index is its coordinate. The loop runs over blocks of a fixed number of splats of one field,
independent of the thread count. Each block packs its visible splats to the front of its own slots
of the output.

Source: Zwicker et al. 2002, "EWA Splatting", local affine approximation; Kerbl et al. 2023 for the
low-pass and the cutoffs; Yu et al. 2024, "Mip-Splatting", for the antialiased opacity.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from .crop import is_left
from .fading import faded
from .jit import parallel, scalar

BLOCK = 1024
"""Number of splats of one block. It is constant, so results do not depend on the thread count."""

RECORD = 12
"""Floats of a projected splat: u v | a b c | ln(opacity) | half width, half height | r g b | depth.

The exponent of the Gaussian at a pixel is `a dx² + b dx dy + c dy²`: a, b, c hold −½ Σ'⁻¹.
"""
U, V, A, B, C, LOG_OPACITY, HALF_WIDTH, HALF_HEIGHT, RED, GREEN, BLUE, DEPTH = range(RECORD)

LOW_PASS = np.float32(0.3)
"""Variance added to the screen covariance [pixel²]; a splat covers at least about one pixel."""
LOG_CUTOFF = np.float32(math.log(1.0 / 255.0))
"""Logarithm of the cutoff."""

PERSPECTIVE, TANGENTIAL, ORTHOGRAPHIC = 0, 1, 2
SORT_Z, SORT_DISTANCE = 0, 1

CAMERA = np.dtype(
    [
        ("fx", "f4"), ("fy", "f4"), ("cx", "f4"), ("cy", "f4"),
        ("near", "f4"), ("far", "f4"),
        ("low_u", "f4"), ("high_u", "f4"), ("low_v", "f4"), ("high_v", "f4"),
        ("left", "f4"), ("top", "f4"), ("right", "f4"), ("bottom", "f4"),
        ("low_pass", "f4"), ("projection", "i4"), ("sorting", "i4"), ("trained", "f4"),
    ],
    align=True,  # otherwise a GPU reads it byte by byte
)  # fmt: skip
"""A view: focal lengths and principal point [pixel], clipping depths, the limits of x/z and y/z for
the affine approximation, the data window in pixel indices (inclusive), the low-pass [pixel²], the
modes, and the low-pass that the splats were trained with, at a distance of one unit [pixel² unit²]:
infinity if it is the picture's at every distance, 0 if there was none."""


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def screen_rows(cam, x, y, z, m, q, s):
    """Return the rows of J·M·R·S, where J is the Jacobian of the projection.

    Their products are the screen covariance, before the low-pass. The result is p0 p1 p2 g0 g1 g2
    [pixel].

    (x, y, z) is the centre in camera space, m the 3x4 local-to-camera matrix, q the quaternion, s
    the standard deviations.
    """
    one = np.float32(1)
    two = np.float32(2)
    zero = np.float32(0)
    m00, m01, m02 = np.float32(m[0, 0]), np.float32(m[0, 1]), np.float32(m[0, 2])
    m10, m11, m12 = np.float32(m[1, 0]), np.float32(m[1, 1]), np.float32(m[1, 2])
    m20, m21, m22 = np.float32(m[2, 0]), np.float32(m[2, 1]), np.float32(m[2, 2])
    if cam.projection == PERSPECTIVE:
        iz = one / z
        tx = min(cam.high_u, max(cam.low_u, x * iz))
        ty = min(cam.high_v, max(cam.low_v, y * iz))
        jx, jxy, jxz = cam.fx * iz, zero, -cam.fx * tx * iz
        jy, jyx, jyz = cam.fy * iz, zero, -cam.fy * ty * iz
    elif cam.projection == TANGENTIAL:
        # the shortest rotation from the viewing ray to the axis, then f / distance
        ir = one / math.sqrt(x * x + y * y + z * z)
        dx, dy, dz = x * ir, y * ir, z * ir
        k = one / (one + dz)
        fx, fy = cam.fx * ir, cam.fy * ir
        jx, jxy, jxz = fx * (one - dx * dx * k), -fx * dx * dy * k, -fx * dx
        jyx, jy, jyz = -fy * dx * dy * k, fy * (one - dy * dy * k), -fy * dy
    else:
        jx, jxy, jxz = cam.fx, zero, zero
        jyx, jy, jyz = zero, cam.fy, zero
    a0 = jx * m00 + jxy * m10 + jxz * m20
    a1 = jx * m01 + jxy * m11 + jxz * m21
    a2 = jx * m02 + jxy * m12 + jxz * m22
    b0 = jyx * m00 + jy * m10 + jyz * m20
    b1 = jyx * m01 + jy * m11 + jyz * m21
    b2 = jyx * m02 + jy * m12 + jyz * m22
    w, i, j, k = q[0], q[1], q[2], q[3]
    r00, r01, r02 = one - two * (j * j + k * k), two * (i * j - w * k), two * (i * k + w * j)
    r10, r11, r12 = two * (i * j + w * k), one - two * (i * i + k * k), two * (j * k - w * i)
    r20, r21, r22 = two * (i * k - w * j), two * (j * k + w * i), one - two * (i * i + j * j)
    return (
        (a0 * r00 + a1 * r10 + a2 * r20) * s[0],
        (a0 * r01 + a1 * r11 + a2 * r21) * s[1],
        (a0 * r02 + a1 * r12 + a2 * r22) * s[2],
        (b0 * r00 + b1 * r10 + b2 * r20) * s[0],
        (b0 * r01 + b1 * r11 + b2 * r21) * s[1],
        (b0 * r02 + b1 * r12 + b2 * r22) * s[2],
    )


@scalar
def trained_low_pass(cam, m, x, y, z):
    """Return the part of the low-pass [pixel²] that a splat at (x, y, z) was trained with.

    The pixels of the photographs have a fixed size at the splat, so their low-pass shrinks with the
    distance. An instance enlarges it by the mean square of its scales across the view.
    """
    one = np.float32(1)
    if cam.projection == PERSPECTIVE:
        nearness = one / (z * z)
    elif cam.projection == TANGENTIAL:
        nearness = one / (x * x + y * y + z * z)
    else:
        nearness = one
    across = (
        m[0, 0] * m[0, 0] + m[0, 1] * m[0, 1] + m[0, 2] * m[0, 2]
        + m[1, 0] * m[1, 0] + m[1, 1] * m[1, 1] + m[1, 2] * m[1, 2]
    )  # fmt: skip
    return min(cam.low_pass, np.float32(0.5 * across * cam.trained * nearness))


@scalar
def project_one(cam, m, position, q, s, opacity, weight, record):
    """Fill columns U..HALF_HEIGHT and DEPTH of `record`. Return whether the splat may touch the
    data window. `weight` in ]0, 1] fades it, see `fading`.

    The centre is transformed in float64, so that a capture far from the origin loses no precision.
    Everything after that is relative to the camera and float32.
    """
    px, py, pz = np.float64(position[0]), np.float64(position[1]), np.float64(position[2])
    z = np.float32(m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3])
    if not (cam.near <= z <= cam.far):
        return False
    x = np.float32(m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3])
    y = np.float32(m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3])
    p0, p1, p2, g0, g1, g2 = screen_rows(cam, x, y, z, m, q, s)
    pp = p0 * p0 + p1 * p1 + p2 * p2
    gg = g0 * g0 + g1 * g1 + g2 * g2
    pg = p0 * g0 + p1 * g1 + p2 * g2
    # det(rows · rowsᵀ) = |p × g|² (Lagrange): a sum of squares, where pp·gg − pg² would cancel
    n0 = np.float64(p1) * g2 - np.float64(p2) * g1  # in float64: squares of squares may overflow
    n1 = np.float64(p2) * g0 - np.float64(p0) * g2
    n2 = np.float64(p0) * g1 - np.float64(p1) * g0
    area = n0 * n0 + n1 * n1 + n2 * n2
    low = cam.low_pass
    uu, vv = pp + low, gg + low
    det = area + low * (np.float64(pp) + gg) + low * low
    if cam.trained < np.inf:
        kept = trained_low_pass(cam, m, x, y, z)
        before = area + kept * (np.float64(pp) + gg) + kept * kept
        opacity = np.float32(opacity * math.sqrt(before / det))
    if weight < np.float32(1):
        opacity = np.float32(faded(opacity, weight))
    if not (opacity > np.float32(0)):
        return False
    log_opacity = np.float32(math.log(opacity))
    reach = np.float32(2) * (log_opacity - LOG_CUTOFF)
    if not (reach >= np.float32(0) and det < np.inf):
        return False
    if cam.projection == ORTHOGRAPHIC:
        u, v = cam.fx * x + cam.cx, cam.fy * y + cam.cy
    else:
        u, v = cam.fx * (x / z) + cam.cx, cam.fy * (y / z) + cam.cy
    half_width = np.float32(math.sqrt(reach * uu))
    half_height = np.float32(math.sqrt(reach * vv))
    if (
        u + half_width < cam.left
        or u - half_width > cam.right
        or v + half_height < cam.top
        or v - half_height > cam.bottom
    ):
        return False
    scale = -0.5 / det
    record[U], record[V] = u, v
    record[A], record[B], record[C] = vv * scale, -2.0 * pg * scale, uu * scale
    record[LOG_OPACITY] = log_opacity
    record[HALF_WIDTH], record[HALF_HEIGHT] = half_width, half_height
    record[DEPTH] = z
    return True


@scalar
def squared_distance(m, position):
    """Return the squared distance from the eye, computed in float64."""
    px, py, pz = np.float64(position[0]), np.float64(position[1]), np.float64(position[2])
    x = m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3]
    y = m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3]
    z = m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3]
    return np.float32(x * x + y * y + z * z)


# --- 2. CPU ----------------------------------------------------------------------------


@parallel(writes=("out", "found"), gpu="project.project")
def project(
    camera, matrices, weights, volumes, crops, rows, positions, rotations, scales, opacities,
    closed, block, base, out, found,
):  # fmt: skip
    """Project all instances of one field.

    Args:
        camera: One CAMERA record, shape (1,).
        matrices: Local to camera, float64, shape (m, 3, 4), one per instance.
        weights: Weight in ]0, 1] that fades each instance, see `fading`, shape (m,) f32; empty if
            all are 1.
        volumes: CROP records that keep or remove splats, shape (k,).
        crops: From the field's space to each volume's, shape (m, k, 3, 4) f64.
        rows: Row of each splat in its field, shape (n,) i32; empty if rows are in order.
        positions, rotations, scales, opacities: See SplatCloud, n rows.
        closed: 1 for a culled block, shape (m * blocks,) u8; empty if no block is culled.
        block: Slots per block, min(n, BLOCK).
        base: First slot of this field; block b of instance i owns `block` slots from
            base + (i * blocks + b) * block.
        out: (records (slots, RECORD) f32, keys (slots,) f32, sources (slots,) i32). A source is the
            row of the splat in its field.
        found: Visible splats of each block, from this field's first block on, shape (m * blocks,)
            i32.
    """
    records, keys, sources = out
    n = positions.shape[0]
    blocks = (n + block - 1) // block
    for item in prange(matrices.shape[0] * blocks):
        cam = camera[0]
        m = matrices[item // blocks]
        weight = np.float32(1)
        if weights.shape[0] > 0:
            weight = weights[item // blocks]
        slot = base + item * block
        first = (item % blocks) * block
        count = 0
        end = min(first + block, n)
        if closed.shape[0] > 0 and closed[item]:
            end = first
        for row in range(first, end):
            i, at = np.uint64(row), np.uint64(slot + count)
            if volumes.shape[0] > 0 and not is_left(volumes, crops[item // blocks], positions[i]):
                continue
            if project_one(
                cam, m, positions[i], rotations[i], scales[i], opacities[i], weight, records[at]
            ):
                if cam.sorting == SORT_DISTANCE and cam.projection != ORTHOGRAPHIC:
                    keys[at] = squared_distance(m, positions[i])
                else:
                    keys[at] = records[at, DEPTH]
                sources[at] = rows[i] if rows.shape[0] > 0 else row
                count += 1
        found[item] = count
