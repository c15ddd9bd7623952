"""Compute ray hits: the depth of a Gaussian's maximum along each pixel's ray.

In a space in which the Gaussian is a ball, the maximum is the point of the ray nearest to the
centre. Let e be the transformed ray to the centre, and g and h the changes of the ray to the next
pixel to the right and down. In axes in which e lies on the first one and g in the plane of the
first two, five numbers remain:

    e = (1, 0, 0)   g = (GX, GY, 0)   h = (HX, HY, HZ)      d = e + dx g + dy h

The ray hit lies at z d·e / d·d, or z (1 − dx GX − dy HX) if rays are parallel. No nearly equal
numbers are subtracted, so thin discs seen edge-on are as accurate as balls.

A ray that misses the ellipsoid of the cutoff contributes only through the low-pass filter, and may
have its maximum anywhere. Depths are therefore clamped to those of the ellipsoid.

Source: Keselman & Hebert 2022, "Approximate differentiable rendering with algebraic surfaces";
Radl et al. 2024, "StopThePop", for sorting by it.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F64

from .jit import exact, scalar
from .lanes import fetch
from .launch import kernel
from .project import LOG_CUTOFF, LOG_OPACITY, ORTHOGRAPHIC

RAY_HIT = 8
"""Floats of a ray hit: the five numbers, depth of the centre, maximum distance of a ray hit from
it, and standard deviation along the view."""
GX, GY, HX, HY, HZ, CENTER, REACH, SPREAD = range(RAY_HIT)
AHEAD = 16
"""Splats between prefetching one and reading it: rows of a field are not in the order of slots."""

ROUNDING = np.float32(4e-6)
"""Rounding error of the least depth of a ray hit, relative to the terms it is computed from."""
THIN = 1e-6
"""Minimum ratio of a splat's thinnest to its thickest axis; it keeps flat splats invertible."""


def inverses(matrices: F64) -> F64:
    """Return the inverses of the 3x3 parts of local-to-camera matrices, shape (m, 3, 4); flat ones
    get a small thickness."""
    linear = matrices[:, :, :3]
    try:
        found = np.linalg.inv(linear)
    except np.linalg.LinAlgError:
        u, s, vt = np.linalg.svd(linear)
        s = np.maximum(s, THIN * s[:, :1])
        s[s == 0] = 1.0
        found = (vt.transpose(0, 2, 1) / s[:, None]) @ u.transpose(0, 2, 1)
    return np.ascontiguousarray(found)


# --- 1. mathematics: one splat ---------------------------------------------------------


@scalar
def ray_hit_one(cam, m, inverse, position, q, s, log_opacity, ray_hit):
    """Fill `ray_hit` for one splat.

    Args:
        cam: A CAMERA record.
        m: Local to camera, (3, 4) f64; inverse: of its 3x3, (3, 3) f64.
        position, q, s: Centre, quaternion and standard deviations.
        log_opacity: See `project.RECORD`.
        ray_hit: Receives RAY_HIT floats.
    """
    px, py, pz = np.float64(position[0]), np.float64(position[1]), np.float64(position[2])
    x = m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3]
    y = m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3]
    z = m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3]
    w, i, j, k = np.float64(q[0]), np.float64(q[1]), np.float64(q[2]), np.float64(q[3])
    most = np.float64(max(s[0], max(s[1], s[2])))
    variance = 0.0
    ex, ey, ez = 0.0, 0.0, 0.0
    gx, gy, gz = 0.0, 0.0, 0.0
    hx, hy, hz = 0.0, 0.0, 0.0
    for axis in range(3):
        if axis == 0:
            ax, ay, az = 1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j + w * k), 2.0 * (i * k - w * j)
        elif axis == 1:
            ax, ay, az = 2.0 * (i * j - w * k), 1.0 - 2.0 * (i * i + k * k), 2.0 * (j * k + w * i)
        else:
            ax, ay, az = 2.0 * (i * k + w * j), 2.0 * (j * k - w * i), 1.0 - 2.0 * (i * i + j * j)
        size = np.float64(s[axis])
        along = (m[2, 0] * ax + m[2, 1] * ay + m[2, 2] * az) * size
        variance += along * along
        # a row of S⁻¹ Rᵀ M⁻¹, in units of the thickest axis
        shrink = most / max(size, THIN * most) if most > 0.0 else 0.0
        wx = (ax * inverse[0, 0] + ay * inverse[1, 0] + az * inverse[2, 0]) * shrink
        wy = (ax * inverse[0, 1] + ay * inverse[1, 1] + az * inverse[2, 1]) * shrink
        wz = (ax * inverse[0, 2] + ay * inverse[1, 2] + az * inverse[2, 2]) * shrink
        e = wz if cam.projection == ORTHOGRAPHIC else wx * (x / z) + wy * (y / z) + wz
        g, h = wx / cam.fx, wy / cam.fy
        if axis == 0:
            ex, gx, hx = e, g, h
        elif axis == 1:
            ey, gy, hy = e, g, h
        else:
            ez, gz, hz = e, g, h
    spread = math.sqrt(variance)
    reach = math.sqrt(max(2.0 * (log_opacity - LOG_CUTOFF), 0.0)) * spread
    length = math.sqrt(ex * ex + ey * ey + ez * ez)
    ray_hit[CENTER], ray_hit[REACH] = np.float32(z), np.float32(reach)
    ray_hit[SPREAD] = np.float32(spread)
    if not (0.0 < length < np.inf and reach < np.inf):
        ray_hit[GX], ray_hit[GY] = np.float32(0), np.float32(0)
        ray_hit[HX], ray_hit[HY], ray_hit[HZ] = np.float32(0), np.float32(0), np.float32(0)
        return
    scale = 1.0 / length
    ex, ey, ez = ex * scale, ey * scale, ez * scale
    gx, gy, gz = gx * scale, gy * scale, gz * scale
    hx, hy, hz = hx * scale, hy * scale, hz * scale
    first = ex * gx + ey * gy + ez * gz
    gx, gy, gz = gx - first * ex, gy - first * ey, gz - first * ez
    second = math.sqrt(gx * gx + gy * gy + gz * gz)
    turn = 1.0 / second if second > 0.0 else 0.0
    third = ex * hx + ey * hy + ez * hz
    fourth = (gx * hx + gy * hy + gz * hz) * turn
    hx = hx - third * ex - fourth * gx * turn
    hy = hy - third * ey - fourth * gy * turn
    hz = hz - third * ez - fourth * gz * turn
    ray_hit[GX], ray_hit[GY] = np.float32(first), np.float32(second)
    ray_hit[HX], ray_hit[HY] = np.float32(third), np.float32(fourth)
    ray_hit[HZ] = np.float32(math.sqrt(hx * hx + hy * hy + hz * hz))


@exact
def row_at(hx, hy, hz, dy):
    """Return d of a row at dx = 0."""
    return np.float32(1) + hx * dy, hy * dy, hz * dy


@exact
def ray_hit_at(dx, gx, gy, first, second, third, center, reach, is_parallel):
    """Return the depth of the ray hit at dx along a row; (first, second, third) is d at dx = 0."""
    one = np.float32(1)
    a, b = first + gx * dx, second + gy * dx
    along = a * a + b * b + third * third
    apart = one - a if is_parallel else center * (a / along - one)
    apart = apart if abs(apart) < reach else (reach if apart > np.float32(0) else -reach)
    return center + apart


@scalar
def least_hit(u, v, most, gx, gy, hx, hy, hz, center, reach, is_parallel):
    """Return a depth in front of which no ray of a square of pixels hits a splat.

    Args:
        u, v: The splat's position relative to the first pixel of the square [pixel].
        most: Last column and row of the square.
        gx, gy, hx, hy, hz, center, reach: The splat's ray hit.
    """
    zero = np.float32(0)
    base = center - reach
    x0, y0 = -u, -v
    x1, y1 = most + x0, most + y0
    ax0, ax1 = gx * x0, gx * x1
    ay0, ay1 = hx * y0, hx * y1
    bx0, bx1 = gy * x0, gy * x1
    by0, by1 = hy * y0, hy * y1
    # d = (a, b, c) is linear in the pixel's position: its extremes are at corners of the square
    low = np.float32(1) + min(ax0, ax1) + min(ay0, ay1)
    high = np.float32(1) + max(ax0, ax1) + max(ay0, ay1)
    b = max(abs(min(bx0, bx1) + min(by0, by1)), abs(max(bx0, bx1) + max(by0, by1)))
    c = hz * max(abs(y0), abs(y1))
    slack = np.float32(1) + max(abs(ax0), abs(ax1)) + max(abs(ay0), abs(ay1))
    slack = ROUNDING * slack * (abs(center) + reach)
    found = base
    if is_parallel:
        found = center + (np.float32(1) - high) - slack
    elif low > zero:
        rest = b * b + c * c  # a / (a² + rest) falls with rest; in a it rises, then falls
        found = center * min(low / (low * low + rest), high / (high * high + rest)) - slack
    found = min(found, center + reach)  # depths of ray hits are clamped to this
    return found if found > base else base


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="found", writes=("out",), team=True)
def ray_hits(
    item, lane, lanes, camera, matrices, inverses, positions, rotations, scales, block, base,
    records, sources, found, out,
):  # fmt: skip
    """Find the ray hits of the visible splats of all instances of one field.

    Args:
        camera, matrices, positions, rotations, scales, block, base, found: See `project.project`.
        inverses: Inverses of the matrices' 3x3 parts, shape (m, 3, 3) f64.
        records, sources: Results of `project.project`.
        out: Receives a ray hit for each used slot, shape (slots, RAY_HIT) f32.
    """
    blocks = (positions.shape[0] + block - 1) // block
    m, inverse = matrices[item // blocks], inverses[item // blocks]
    slot = base + item * block
    for at in range(slot + lane, slot + found[item], lanes):
        if at + AHEAD < slot + found[item]:
            later = np.uint64(sources[at + AHEAD])
            fetch(positions, later * np.uint64(3))
            fetch(rotations, later * np.uint64(4))
            fetch(scales, later * np.uint64(3))
        i = sources[at]
        ray_hit_one(
            camera[0], m, inverse, positions[i], rotations[i], scales[i],
            records[at, LOG_OPACITY], out[at],
        )  # fmt: skip
