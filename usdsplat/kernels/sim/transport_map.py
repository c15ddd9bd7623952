"""Maps from an even set of points on one surface to another: smooth them, and fit their gradients.

Each point k of a sheet has a place P_k, a unit normal N_k, and an image Q_k with a unit normal U_k.
Neighbours whose images are elsewhere belong to another piece of a torn map and lose their weight.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

ZERO, ONE, HALF = np.float32(0), np.float32(1), np.float32(0.5)
RIDGE = np.float32(0.05)
"""Weight of a rotation with the mean stretch in a fit, relative to squared spacings."""
OTHER_SIDE = np.float32(0.02)
"""Factor on the weight of a neighbour whose normal points the other way."""
_TINY = np.float32(1e-30)


# --- 1. mathematics ---------------------------------------------------------------------


@scalar
def distance(points, i, j):
    """Return the distance of two rows of `points`."""
    x = points[i, 0] - points[j, 0]
    y = points[i, 1] - points[j, 1]
    z = points[i, 2] - points[j, 2]
    return np.float32(math.sqrt(x * x + y * y + z * z))


@scalar
def robust(apart):
    """Return the weight of a neighbour whose image is `apart` away, in units of the tolerance."""
    s = ONE + apart * apart
    return ONE / (s * s)


@scalar
def plane(nx, ny, nz):
    """Return two unit vectors that are perpendicular to a unit vector and to each other.

    Source: Duff et al. 2017, "Building an orthonormal basis, revisited".
    """
    sign = ONE if nz >= ZERO else -ONE
    a = -ONE / (sign + nz)
    b = nx * ny * a
    return ONE + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@scalar
def banded(a, b, c, d, least, most, mirrors):
    """Return [[a, b], [c, d]] with its singular values clamped to [least, most].

    If it mirrors, the result does so too if `mirrors`; otherwise it is the nearest one that does
    not.

    Source: Blinn 1996, "Consider the lowly 2x2 matrix".
    """
    e, f, g, h = HALF * (a + d), HALF * (a - d), HALF * (c + b), HALF * (c - b)
    turning = np.float32(math.sqrt(e * e + h * h))
    mirroring = np.float32(math.sqrt(f * f + g * g))
    first, second = turning + mirroring, turning - mirroring
    first = min(max(first, least), most)
    flipped = mirrors and second < ZERO
    second = min(max(abs(second) if flipped else second, least), most)
    if flipped:
        second = -second
    p, q = HALF * (first + second), HALF * (first - second)
    ec, hc = (e / turning, h / turning) if turning > _TINY else (ONE, ZERO)
    fc, gc = (f / mirroring, g / mirroring) if mirroring > _TINY else (ONE, ZERO)
    return p * ec + q * fc, q * gc - p * hc, q * gc + p * hc, p * ec - q * fc


# --- 2. loops ---------------------------------------------------------------------------


@kernel(over="near", writes=("out",))
def smooth(i, near, weights, images, tolerance, out):
    """Compute the weighted mean of the images of a point's neighbours and of its own.

    Args:
        near, weights: Neighbours and weights, the point itself first; -1 for none, shape (c, k).
        images: Shape (c, 3) f32.
        tolerance: Distance of images at which a neighbour's weight is a quarter [unit], f32.
        out: Receives means, shape (c, 3) f32.
    """
    x, y, z, total = ZERO, ZERO, ZERO, ZERO
    for e in range(near.shape[1]):
        k = near[i, e]
        if k < 0:
            continue
        w = weights[i, e] * robust(distance(images, k, i) / tolerance)
        total += w
        x, y, z = x + w * images[k, 0], y + w * images[k, 1], z + w * images[k, 2]
    out[i, 0], out[i, 1], out[i, 2] = x / total, y / total, z / total


@kernel(over="near", writes=("images", "support"))
def spread(i, near, weights, values, tolerance, images, support):
    """Interpolate images of a coarser sheet: the weighted mean around the best supported one.

    Args:
        near, weights: Points of the coarser sheet, -1 for none, shape (n, k), and their weights.
        values: Their images, shape (c, 3) f32.
        tolerance: As for `smooth`.
        images: Receives means, shape (n, 3) f32.
        support: Receives the neighbour that is best supported, as an index 0..k-1, shape (n,) i32.
    """
    best, most = 0, -ONE
    for e in range(near.shape[1]):
        k = near[i, e]
        if k < 0:
            continue
        held = ZERO
        for o in range(near.shape[1]):
            j = near[i, o]
            if j >= 0:
                held += weights[i, o] * robust(distance(values, j, k) / tolerance)
        held *= weights[i, e]
        if held > most:
            best, most = e, held
    support[i] = best
    x, y, z, total = ZERO, ZERO, ZERO, ZERO
    for e in range(near.shape[1]):
        k = near[i, e]
        if k < 0:
            continue
        w = weights[i, e] * robust(distance(values, k, near[i, best]) / tolerance)
        total += w
        x, y, z = x + w * values[k, 0], y + w * values[k, 1], z + w * values[k, 2]
    if total > ZERO:
        images[i, 0], images[i, 1], images[i, 2] = x / total, y / total, z / total
    else:
        for a in range(3):
            images[i, a] = values[near[i, best], a]


@kernel(over="near", writes=("maps",))
def fit(i, near, weights, places, normals, images, ups, how, mirrors, maps):
    """Fit the gradient of the map at a point, from the images of its neighbours.

    Along the surface it is the best fit in the planes of both normals, with its singular values in
    a band; across, it takes one normal to the other with a factor.

    Args:
        near, weights: As for `smooth`.
        places, normals: P and N, shape (c, 3) f32.
        images, ups: Q and U, shape (c, 3) f32.
        how: (spacing at P, spacing at Q [unit], least and most singular value, factor across), f32;
            the last three relative to the ratio of the spacings.
        mirrors: Whether the gradient may mirror along the surface.
        maps: Receives gradients, shape (c, 3, 3) f32.
    """
    spacing, other, least, most, across = how
    ratio = other / spacing
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    ux, uy, uz = ups[i, 0], ups[i, 1], ups[i, 2]
    ax, ay, az, bx, by, bz = plane(nx, ny, nz)
    cx, cy, cz, dx, dy, dz = plane(ux, uy, uz)
    xx, xy, yy, px, py, qx, qy, total = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    for e in range(near.shape[1]):
        k = near[i, e]
        if k < 0 or k == i:
            continue
        w = weights[i, e] * robust(distance(images, k, i) / (np.float32(4) * other))
        if normals[k, 0] * nx + normals[k, 1] * ny + normals[k, 2] * nz <= ZERO:
            w *= OTHER_SIDE
        x, y, z = (
            places[k, 0] - places[i, 0],
            places[k, 1] - places[i, 1],
            places[k, 2] - places[i, 2],
        )
        s, t = ax * x + ay * y + az * z, bx * x + by * y + bz * z
        x, y, z = (
            images[k, 0] - images[i, 0],
            images[k, 1] - images[i, 1],
            images[k, 2] - images[i, 2],
        )
        u, v = cx * x + cy * y + cz * z, dx * x + dy * y + dz * z
        total += w
        xx, xy, yy = xx + w * s * s, xy + w * s * t, yy + w * t * t
        px, py, qx, qy = px + w * u * s, py + w * u * t, qx + w * v * s, qy + w * v * t
    scale = ONE / (total * spacing * spacing) if total > ZERO else ZERO
    xx, xy, yy = xx * scale, xy * scale, yy * scale
    px, py, qx, qy = px * scale, py * scale, qx * scale, qy * scale
    # towards the nearest rotation, with the mean stretch
    ra, rb, rc, rd = banded(px, py, qx, qy, ratio, ratio, mirrors)
    xx, yy = xx + RIDGE, yy + RIDGE
    px, py, qx, qy = px + RIDGE * ra, py + RIDGE * rb, qx + RIDGE * rc, qy + RIDGE * rd
    k = ONE / (xx * yy - xy * xy)
    a, b = k * (px * yy - py * xy), k * (py * xx - px * xy)
    c, d = k * (qx * yy - qy * xy), k * (qy * xx - qx * xy)
    a, b, c, d = banded(a, b, c, d, least * ratio, most * ratio, mirrors)
    # images of the two vectors in the plane
    sx, sy, sz = a * cx + c * dx, a * cy + c * dy, a * cz + c * dz
    tx, ty, tz = b * cx + d * dx, b * cy + d * dy, b * cz + d * dz
    thin = across * ratio
    maps[i, 0, 0] = sx * ax + tx * bx + thin * ux * nx
    maps[i, 0, 1] = sx * ay + tx * by + thin * ux * ny
    maps[i, 0, 2] = sx * az + tx * bz + thin * ux * nz
    maps[i, 1, 0] = sy * ax + ty * bx + thin * uy * nx
    maps[i, 1, 1] = sy * ay + ty * by + thin * uy * ny
    maps[i, 1, 2] = sy * az + ty * bz + thin * uy * nz
    maps[i, 2, 0] = sz * ax + tz * bx + thin * uz * nx
    maps[i, 2, 1] = sz * ay + tz * by + thin * uz * ny
    maps[i, 2, 2] = sz * az + tz * bz + thin * uz * nz


@kernel(over="near", writes=("points", "normals"))
def project(i, near, weights, places, sheet_normals, reach, points, normals):
    """Move a point onto the plane through the points of a sheet around it, and near to them.

    Args:
        near, weights: Points of the sheet, -1 for none, shape (n, k), and weights, which sum to 1.
        places, sheet_normals: P and N, shape (c, 3) f32.
        reach: Largest distance from the weighted mean of the places [unit], f32.
        points: Changed in place, shape (n, 3) f32.
        normals: Receives unit normals, shape (n, 3) f32.
    """
    cx, cy, cz, nx, ny, nz = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    first = near[i, 0]
    for e in range(near.shape[1]):
        k = near[i, e]
        if k < 0:
            continue
        w = weights[i, e]
        cx, cy, cz = cx + w * places[k, 0], cy + w * places[k, 1], cz + w * places[k, 2]
        ox, oy, oz = sheet_normals[k, 0], sheet_normals[k, 1], sheet_normals[k, 2]
        same = ox * sheet_normals[first, 0] + oy * sheet_normals[first, 1]
        same += oz * sheet_normals[first, 2]
        if same > ZERO:
            nx, ny, nz = nx + w * ox, ny + w * oy, nz + w * oz
    length = np.float32(math.sqrt(nx * nx + ny * ny + nz * nz))
    if length > _TINY:
        nx, ny, nz = nx / length, ny / length, nz / length
    else:
        nx, ny, nz = sheet_normals[first, 0], sheet_normals[first, 1], sheet_normals[first, 2]
    x, y, z = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
    up = x * nx + y * ny + z * nz
    x, y, z = x - up * nx, y - up * ny, z - up * nz
    away = np.float32(math.sqrt(x * x + y * y + z * z))
    part = min(ONE, reach / away) if away > ZERO else ZERO
    points[i, 0], points[i, 1], points[i, 2] = cx + part * x, cy + part * y, cz + part * z
    normals[i, 0], normals[i, 1], normals[i, 2] = nx, ny, nz
