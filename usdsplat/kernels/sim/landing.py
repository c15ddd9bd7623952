"""Splats that are carried onto a surface by a map of points: where they start, how they land, and
how they travel.

A splat starts from its foot on the capture's surface, and lands on a triangle with a rotation and a
stretch, relative to the triangle. F = R S with the rotation R and the symmetric stretch S is the
gradient of the deformation from rest.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .conform import multiply, on_face, place
from .facets import unit
from .matrix import (
    ONE,
    ZERO,
    by_columns,
    jacobi,
    matrix_quat,
    polar,
    product,
    quat_matrix,
    squares,
    transposed,
)
from .transport import guarded
from .transport_map import banded, plane

ABOVE, BELOW = np.float32(1), np.float32(-3)
"""Largest and least height over the capture's surface, in spacings."""
ASIDE = np.float32(1.5)
"""Largest distance along the surface from the mean of a splat's points, in spacings."""
_TINY = np.float32(1e-30)


# --- 1. mathematics ---------------------------------------------------------------------


@scalar
def read(g, i):
    """Return row i of matrices, shape (n, 3, 3), as a tuple."""
    return (
        g[i, 0, 0], g[i, 0, 1], g[i, 0, 2],
        g[i, 1, 0], g[i, 1, 1], g[i, 1, 2],
        g[i, 2, 0], g[i, 2, 1], g[i, 2, 2],
    )  # fmt: skip


@scalar
def slerp(aw, ax, ay, az, bw, bx, by, bz, part):
    """Return the rotation on the shortest arc between two unit quaternions."""
    cosine = aw * bw + ax * bx + ay * by + az * bz
    if cosine < 0.0:
        bw, bx, by, bz, cosine = -bw, -bx, -by, -bz, -cosine
    first, second = 1.0 - part, part
    if cosine < 0.9995:
        angle = math.acos(cosine)
        sine = math.sin(angle)
        first, second = math.sin(first * angle) / sine, math.sin(second * angle) / sine
    w, x, y, z = (
        first * aw + second * bw, first * ax + second * bx,
        first * ay + second * by, first * az + second * bz,
    )  # fmt: skip
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return w / length, x / length, y / length, z / length


# --- 2. loops ---------------------------------------------------------------------------


@kernel(over="points", writes=("feet", "normals", "heights"))
def anchor(i, points, near, weights, places, sheet_normals, spacing, feet, normals, heights):
    """Find the foot of a splat on the surface through the points of a sheet.

    Args:
        points: Rest positions of the splats, shape (n, 3) f32.
        near, weights: Points of the sheet, the nearest first, and weights, which sum to 1, shape
            (n, k).
        places, sheet_normals: P and N, shape (c, 3) f32.
        spacing: Spacing of the sheet [unit], f32.
        feet: Receives positions, not farther along the surface than the sheet reaches, (n, 3) f32.
        normals: Receives unit normals, shape (n, 3) f32.
        heights: Receives heights over the surface [unit], limited, shape (n,) f32.
    """
    cx, cy, cz, nx, ny, nz = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    first = near[i, 0]
    fx, fy, fz = sheet_normals[first, 0], sheet_normals[first, 1], sheet_normals[first, 2]
    for e in range(near.shape[1]):
        k, w = near[i, e], weights[i, e]
        if k < 0:
            continue
        cx, cy, cz = cx + w * places[k, 0], cy + w * places[k, 1], cz + w * places[k, 2]
        ox, oy, oz = sheet_normals[k, 0], sheet_normals[k, 1], sheet_normals[k, 2]
        if ox * fx + oy * fy + oz * fz > ZERO:
            nx, ny, nz = nx + w * ox, ny + w * oy, nz + w * oz
    length = np.float32(math.sqrt(nx * nx + ny * ny + nz * nz))
    if length > _TINY:
        nx, ny, nz = nx / length, ny / length, nz / length
    else:
        nx, ny, nz = fx, fy, fz
    x, y, z = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
    up = x * nx + y * ny + z * nz
    x, y, z = x - up * nx, y - up * ny, z - up * nz
    away = np.float32(math.sqrt(x * x + y * y + z * z))
    part = min(ONE, ASIDE * spacing / away) if away > ZERO else ZERO
    feet[i, 0], feet[i, 1], feet[i, 2] = cx + part * x, cy + part * y, cz + part * z
    normals[i, 0], normals[i, 1], normals[i, 2] = nx, ny, nz
    heights[i] = min(max(up, BELOW * spacing), ABOVE * spacing)


@kernel(over="gradient", writes=("turns", "stretches", "lengths"))
def land(
    i, gradient, normals, ups, rotations, scales, sizes, how, triangles, turns, stretches, lengths
):
    """Compute the rotation and the stretch of a splat that lies on a surface.

    Args:
        gradient: Gradient of the map around the splat, shape (n, 3, 3) f32.
        normals: Unit normals of the capture's surface, shape (n, 3) f32.
        ups: Unit normals of the target, shape (n, 3) f32.
        rotations, scales: Of the splat at rest, shapes (n, 4) and (n, 3) f32.
        sizes: (factor on the size of each splat, its largest standard deviation [unit]), both (n,)
            f32.
        how: (least and most singular value along the surface, factor across it), f32.
        triangles: (triangle of each splat, shape (n,) i32; frames of all, shape (t, 4) f32).
        turns: Receives R in the triangle's frame, shape (n, 4) f32.
        stretches: Receives S: xx, xy, xz, yy, yz, zz, shape (n, 6) f32.
        lengths: Receives the two largest standard deviations [unit], shape (n, 2) f32.
    """
    least, most, across = how
    growth, limits = sizes
    faces, frames = triangles
    largest = limits[i]
    f = read(gradient, i)
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    ux, uy, uz = ups[i, 0], ups[i, 1], ups[i, 2]
    ax, ay, az, bx, by, bz = plane(nx, ny, nz)
    cx, cy, cz, dx, dy, dz = plane(ux, uy, uz)
    sx = f[0] * ax + f[1] * ay + f[2] * az
    sy = f[3] * ax + f[4] * ay + f[5] * az
    sz = f[6] * ax + f[7] * ay + f[8] * az
    tx = f[0] * bx + f[1] * by + f[2] * bz
    ty = f[3] * bx + f[4] * by + f[5] * bz
    tz = f[6] * bx + f[7] * by + f[8] * bz
    a, b, c, d = banded(
        cx * sx + cy * sy + cz * sz, cx * tx + cy * ty + cz * tz,
        dx * sx + dy * sy + dz * sz, dx * tx + dy * ty + dz * tz, least, most, False,
    )  # fmt: skip
    grown = growth[i]
    a, b, c, d = grown * a, grown * b, grown * c, grown * d
    sx, sy, sz = a * cx + c * dx, a * cy + c * dy, a * cz + c * dz
    tx, ty, tz = b * cx + d * dx, b * cy + d * dy, b * cz + d * dz
    px, py, pz = across * ux, across * uy, across * uz
    f = (
        sx * ax + tx * bx + px * nx, sx * ay + tx * by + px * ny, sx * az + tx * bz + px * nz,
        sy * ax + ty * bx + py * nx, sy * ay + ty * by + py * ny, sy * az + ty * bz + py * nz,
        sz * ax + tz * bx + pz * nx, sz * ay + tz * by + pz * ny, sz * az + tz * bz + pz * nz,
    )  # fmt: skip
    turned = product(
        f, quat_matrix(rotations[i, 0], rotations[i, 1], rotations[i, 2], rotations[i, 3])
    )
    axes = by_columns(turned, scales[i, 0], scales[i, 1], scales[i, 2])
    axes, _ = jacobi(axes, turned)
    xx, yy, zz = squares(axes)
    x, y, z = np.float32(math.sqrt(xx)), np.float32(math.sqrt(yy)), np.float32(math.sqrt(zz))
    longest = max(x, max(y, z))
    if longest > largest:
        # shorten the axes that are too long: D = I - sum (1 - s'/s) e eT
        p = (ONE - min(ONE, largest / x)) / xx if x > _TINY else ZERO
        q = (ONE - min(ONE, largest / y)) / yy if y > _TINY else ZERO
        r = (ONE - min(ONE, largest / z)) / zz if z > _TINY else ZERO
        shrink = product(by_columns(axes, p, q, r), transposed(axes))
        f = product(
            (
                ONE - shrink[0], -shrink[1], -shrink[2],
                -shrink[3], ONE - shrink[4], -shrink[5],
                -shrink[6], -shrink[7], ONE - shrink[8],
            ),
            f,
        )  # fmt: skip
        x, y, z = min(x, largest), min(y, largest), min(z, largest)
    longest = max(x, max(y, z))
    lengths[i, 0], lengths[i, 1] = longest, max(min(x, y), min(longest, max(min(x, z), min(y, z))))
    rotation = polar(f)
    s = product(transposed(rotation), f)
    half = np.float32(0.5)
    stretches[i, 0], stretches[i, 3], stretches[i, 5] = s[0], s[4], s[8]
    stretches[i, 1] = half * (s[1] + s[3])
    stretches[i, 2] = half * (s[2] + s[6])
    stretches[i, 4] = half * (s[5] + s[7])
    w, x, y, z = matrix_quat(rotation)
    r = frames[faces[i]]
    w, x, y, z = multiply(r[0], -r[1], -r[2], -r[3], w, x, y, z)
    turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3] = w, x, y, z


@kernel(over="points", writes=("points", "gradient"))
def travel(i, points, gradient, way, bound, bows, mesh, how):
    """Move, rotate and stretch a splat by its progress towards its place on a surface.

    Args:
        points: Changed in place, shape (n, 3) f32.
        gradient: Gradients of the deformation so far; replaced, shape (n, 3, 3) f32, or (0, 3, 3).
        way: Progress 0 to 1, shape (n,) f32; a splat at 0 is not changed.
        bound: (triangles (n,) i32, barycentric weights (n, 3), heights (n,), depths below the
            surface (n,), turns (n, 4), stretches (n, 6), sizes (n,) of the triangles when splats
            were bound; f32).
        bows: Largest distance of the path from a straight line [unit], shape (n, 3) f32.
        mesh: Mesh now: (points, triangles, normals (t, 3, 3), frames (t, 4), sizes (t,) f32).
        how: (orient, keep_thickness, arc, largest stretch of the deformation so far).
    """
    faces, places, heights, depths, turns, stretches, sizes = bound
    mesh_points, triangles, normals, frames, mesh_sizes = mesh
    orient, keep, arc, limit = how
    c, face = np.float64(way[i]), faces[i]
    if c == 0.0 or face < 0:
        return
    corner = normals[face]
    nx, ny, nz = unit(
        on_face(corner, places, i, 0), on_face(corner, places, i, 1), on_face(corner, places, i, 2)
    )
    size = 1.0
    if sizes[i] > 0:
        size = np.float64(mesh_sizes[face]) / sizes[i]
    height = size * (keep * np.float64(heights[i]) - depths[i])
    bow = 4.0 * arc * c * (1.0 - c)
    gx = place(mesh_points, triangles, face, places, i, 0) + nx * height
    gy = place(mesh_points, triangles, face, places, i, 1) + ny * height
    gz = place(mesh_points, triangles, face, places, i, 2) + nz * height
    x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
    points[i, 0] = (1.0 - c) * x + c * gx + bow * bows[i, 0]
    points[i, 1] = (1.0 - c) * y + c * gy + bow * bows[i, 1]
    points[i, 2] = (1.0 - c) * z + c * gz + bow * bows[i, 2]
    if gradient.shape[0] == 0:
        return
    f = guarded(read(gradient, i), limit)
    rotation = polar(f)
    before = product(transposed(rotation), f)
    q = matrix_quat(rotation)
    r, t = frames[face], turns[i]
    w, x, y, z = multiply(r[0], r[1], r[2], r[3], t[0], t[1], t[2], t[3])
    w, x, y, z = slerp(q[0], q[1], q[2], q[3], w, x, y, z, c * orient)
    p, s = np.float32(1.0 - c), np.float32(c * size)
    xy, xz, yz = s * stretches[i, 1], s * stretches[i, 2], s * stretches[i, 4]
    now = (
        p * before[0] + s * stretches[i, 0], p * before[1] + xy, p * before[2] + xz,
        p * before[3] + xy, p * before[4] + s * stretches[i, 3], p * before[5] + yz,
        p * before[6] + xz, p * before[7] + yz, p * before[8] + s * stretches[i, 5],
    )  # fmt: skip
    f = product(quat_matrix(np.float32(w), np.float32(x), np.float32(y), np.float32(z)), now)
    for row in range(3):
        for column in range(3):
            gradient[i, row, column] = f[3 * row + column]
