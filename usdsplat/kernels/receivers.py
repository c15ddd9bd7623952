"""Place receivers of light, splats and points of surfaces, and apply the light that they receive.

`lighting` computes the light in between.
"""

from __future__ import annotations

import math

import numpy as np

from .color import decode, encode
from .launch import kernel, reduction
from .position import apply, unproject
from .shade import DRAWN, NOTHING

MOST_GAIN = np.float32(32)
"""Largest factor of new to captured light: where a capture was nearly dark, its noise is not
enlarged further."""

# --- 1. before: receivers in the world --------------------------------------------------


@kernel(over="rows", writes=("points", "normals", "shapes"))
def place_splats(
    i,
    rows,
    transform,
    turn,
    positions,
    rotations,
    scales,
    local_normals,
    facts,
    points,
    normals,
    shapes,
):
    """Write splat `rows[i]` of a field as receiver `i`.

    Args:
        rows: Rows of the field, shape (n,) i32.
        transform: Local to world, shape (3, 4) f64; turn: cofactors of its 3x3, of any length.
        positions, rotations, scales: The field's arrays.
        local_normals, facts: Normals and (confidence, occlusion), see `feature.features`; empty for
            none.
        points: Receives the centre in the world, shape (n, 3) f64.
        normals: Receives unit normal and confidence, shape (n, 4) f32.
        shapes: Receives the covariance in the world, xx xy xz yy yz zz, shape (n, 6) f32.
    """
    k = rows[i]
    px, py, pz = (
        np.float64(positions[k, 0]),
        np.float64(positions[k, 1]),
        np.float64(positions[k, 2]),
    )
    points[i, 0], points[i, 1], points[i, 2] = apply(transform, px, py, pz)
    for c in range(4):
        normals[i, c] = np.float32(0)
    if local_normals.shape[0] > 0:
        x, y = np.float64(local_normals[k, 0]), np.float64(local_normals[k, 1])
        z = np.float64(local_normals[k, 2])
        nx = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z
        ny = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z
        nz = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
        square = nx * nx + ny * ny + nz * nz
        if 0.0 < square < np.inf:
            scale = 1.0 / math.sqrt(square)
            normals[i, 0], normals[i, 1] = np.float32(nx * scale), np.float32(ny * scale)
            normals[i, 2], normals[i, 3] = np.float32(nz * scale), facts[k, 0]
    w, a, b, c = (
        np.float64(rotations[k, 0]),
        np.float64(rotations[k, 1]),
        np.float64(rotations[k, 2]),
        np.float64(rotations[k, 3]),
    )
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for axis in range(3):
        if axis == 0:
            x, y, z = 1.0 - 2.0 * (b * b + c * c), 2.0 * (a * b + w * c), 2.0 * (a * c - w * b)
        elif axis == 1:
            x, y, z = 2.0 * (a * b - w * c), 1.0 - 2.0 * (a * a + c * c), 2.0 * (b * c + w * a)
        else:
            x, y, z = 2.0 * (a * c + w * b), 2.0 * (b * c - w * a), 1.0 - 2.0 * (a * a + b * b)
        size = np.float64(scales[k, axis])
        ex = (transform[0, 0] * x + transform[0, 1] * y + transform[0, 2] * z) * size
        ey = (transform[1, 0] * x + transform[1, 1] * y + transform[1, 2] * z) * size
        ez = (transform[2, 0] * x + transform[2, 1] * y + transform[2, 2] * z) * size
        xx, xy, xz = xx + ex * ex, xy + ex * ey, xz + ex * ez
        yy, yz, zz = yy + ey * ey, yz + ey * ez, zz + ez * ez
    shapes[i, 0], shapes[i, 1], shapes[i, 2] = np.float32(xx), np.float32(xy), np.float32(xz)
    shapes[i, 3], shapes[i, 4], shapes[i, 5] = np.float32(yy), np.float32(yz), np.float32(zz)


@kernel(over="depth", writes=("points", "normals", "prims"), axes=2)
def place_pixels(
    y, x, view, camera_to_world, depth, normal, covered, ids, x0, y0, points, normals, prims
):
    """Write the surface of a pixel as a receiver.

    Args:
        view, camera_to_world: See `position.positions`.
        depth, normal, covered, ids: See `SurfaceBand`.
        x0, y0: Pixel of the first column and row.
        points, normals: See `place_splats`, row y * width + x.
        prims: Receives the number of the prim, −1 for none, shape (h * w,) i32.
    """
    i = y * depth.shape[1] + x
    prims[i] = -1
    if covered[y, x] == NOTHING:
        return
    prims[i] = ids[0, y, x]
    px, py, pz = unproject(view[0], np.float64(x0 + x), np.float64(y0 + y), np.float64(depth[y, x]))
    points[i, 0], points[i, 1], points[i, 2] = apply(camera_to_world, px, py, pz)
    # normals are in USD's camera space: y up, z towards the viewer
    nx, ny, nz = (
        np.float64(normal[y, x, 0]),
        -np.float64(normal[y, x, 1]),
        -np.float64(normal[y, x, 2]),
    )
    m = camera_to_world
    for c in range(3):
        normals[i, c] = np.float32(m[c, 0] * nx + m[c, 1] * ny + m[c, 2] * nz)
    normals[i, 3] = np.float32(1)


# --- 2. after: ratios, colours, AOVs ---------------------------------------------------


@reduction(over="sums", by="sum")
def total(i, sums, channel):
    """Return the sum of one channel over all receivers; those that are not finite count 0."""
    value = np.float64(sums[i, channel])
    return value if value < np.inf else 0.0


@kernel(over="sums", writes=("out",))
def ratios(i, sums, ambient, share, rows, out):
    """Write the ratio of the light that arrives at a receiver to that without shadows, 0..1.

    Args:
        sums: Result of `lighting.illuminate`.
        ambient: Light that no light of the stage explains, r g b, shape (3,) f32.
        share: The same as a share of the receiver's own irradiance.
        rows: Row of the field of each receiver of an instance, shape (k,) i32; empty if receivers
            are in order.
        out: Receives r g b in the order of rows, shape (n, 3) f32.
    """
    at = np.int64(i)
    if rows.shape[0] > 0:
        at = i - i % rows.shape[0] + rows[i % rows.shape[0]]
    for c in range(3):
        more = ambient[c] + share * sums[i, 3 + c]
        full = sums[i, 3 + c] + more
        ratio = (sums[i, c] + more) / full if full > np.float32(0) else np.float32(1)
        out[at, c] = ratio if np.float32(0) <= ratio <= np.float32(1) else np.float32(1)


@kernel(over="sums", writes=("out",))
def relight(i, sums, captured, ambient, captured_ambient, rows, out):
    """Write the ratio of the light that arrives at a receiver to that in which it was photographed,
    0 to MOST_GAIN.

    Args:
        sums, captured: Results of `lighting.illuminate` for both lights.
        ambient, captured_ambient: Light that no light explains, r g b, shape (3,) f32.
        rows, out: See `ratios`.
    """
    at = np.int64(i)
    if rows.shape[0] > 0:
        at = i - i % rows.shape[0] + rows[i % rows.shape[0]]
    for c in range(3):
        new, old = sums[i, c] + ambient[c], captured[i, c] + captured_ambient[c]
        gain = np.float32(1)
        if old > np.float32(0):
            gain = new / old
        elif new > np.float32(0):
            gain = MOST_GAIN
        out[at, c] = min(gain, MOST_GAIN) if gain >= np.float32(0) else np.float32(1)


@kernel(over="found", writes=("paints",), team=True)
def dim(
    item, lane, lanes, gains, count, drawn, rows, curve, turns, block, base, sources, found, paints,
    column,
):  # fmt: skip
    """Multiply the linear colours of the visible splats of all instances of one field.

    Args:
        gains: Factors r g b of each instance and splat, shape (instances * count, 3) f32.
        count: Splats of the field.
        drawn: Drawn splats of the field.
        rows: Row in the field of each source; empty if sources are rows of the field.
        curve: Gamma and linear bias of the blend space, see `color`, shape (2,) f32.
        turns: Matrices from the blend space's primaries to those of the gains and back, shape
            (2, 3, 3) f32; empty if they are the same.
        block, base, sources, found: See `radiance.radiance`.
        paints, column: Holds the colour in three columns of each used slot, f32.
    """
    blocks = (drawn + block - 1) // block
    first = np.int64(item // blocks) * count
    slot = base + item * block
    for at in range(slot + lane, slot + found[item], lanes):
        i = np.int64(sources[at])
        if rows.shape[0] > 0:
            i = np.int64(rows[i])
        if turns.shape[0] > 0:
            r = decode(paints[at, column], curve[0], curve[1])
            g = decode(paints[at, column + 1], curve[0], curve[1])
            b = decode(paints[at, column + 2], curve[0], curve[1])
            x = turns[0, 0, 0] * r + turns[0, 0, 1] * g + turns[0, 0, 2] * b
            y = turns[0, 1, 0] * r + turns[0, 1, 1] * g + turns[0, 1, 2] * b
            z = turns[0, 2, 0] * r + turns[0, 2, 1] * g + turns[0, 2, 2] * b
            x, y = x * gains[first + i, 0], y * gains[first + i, 1]
            z = z * gains[first + i, 2]
            for c in range(3):
                linear = turns[1, c, 0] * x + turns[1, c, 1] * y + turns[1, c, 2] * z
                paints[at, column + c] = encode(linear, curve[0], curve[1])
            continue
        for c in range(3):
            linear = decode(paints[at, column + c], curve[0], curve[1])
            paints[at, column + c] = encode(linear * gains[first + i, c], curve[0], curve[1])


@kernel(over="found", writes=("paints",), team=True)
def spread_gains(
    item, lane, lanes, gains, otherwise, count, drawn, block, base, sources, found, paints, column
):
    """Copy r g b of the visible splats of one field to three columns; see `dim`. Empty `gains`
    stand for `otherwise`."""
    blocks = (drawn + block - 1) // block
    first = np.int64(item // blocks) * count
    slot = base + item * block
    for at in range(slot + lane, slot + found[item], lanes):
        i = np.int64(sources[at])
        for c in range(3):
            paints[at, column + c] = gains[first + i, c] if gains.shape[0] > 0 else otherwise


@kernel(over="color", writes=("color",), axes=2)
def light_surfaces(y, x, sums, ratios, albedo, covered, color):
    """Write the colours of lit surfaces.

    Args:
        sums: Result of `lighting.illuminate`, row y * width + x.
        ratios: Ratio of this light with and without shadows, shape (h * w, 3) f32; empty for 1.
        albedo, covered, color: See `SurfaceBand`; `color` is replaced where a surface is drawn.
    """
    if covered[y, x] == DRAWN:
        i = y * color.shape[1] + x
        for c in range(3):
            part = ratios[i, c] if ratios.shape[0] > 0 else np.float32(1)
            color[y, x, c] = albedo[y, x, c] * (sums[i, 3 + c] * part)


@kernel(over="out", writes=("out",), axes=2)
def no_shadow(y, x, out):
    """Write 1 to r g b of every pixel, shape (h, w, 3) f32."""
    for c in range(3):
        out[y, x, c] = np.float32(1)


@kernel(over="out", writes=("out",), axes=2)
def shadow(y, x, splats, left, ratio, prims, catches, only, out):
    """Write the mean ratio of the receivers that a pixel shows; 1 where there are none.

    Args:
        splats: Sums of ratios of splats times their contributions, and of these, (h, w, 4) f32.
        left: Transmittance of the splats to the surfaces, shape (h, w) f32; empty without surfaces.
        ratio, prims: Ratio and prim of each pixel's surface, row y * width + x.
        catches: Whether each prim is a shadow catcher, shape (prims,) u8.
        only: Whether only catchers count. A surface that catches then counts fully, as beauty is
            composited over what it stands for.
        out: Receives r g b, shape (h, w, 3) f32.
    """
    weight = splats[y, x, 3]
    red, green, blue = splats[y, x, 0], splats[y, x, 1], splats[y, x, 2]
    if prims.shape[0] > 0:
        i = y * out.shape[1] + x
        part = np.float32(0)
        if prims[i] >= 0:
            if only:
                part = np.float32(1) - weight if catches[prims[i]] else np.float32(0)
            else:
                part = left[y, x]
        if part > np.float32(0):
            red, green = red + part * ratio[i, 0], green + part * ratio[i, 1]
            blue, weight = blue + part * ratio[i, 2], weight + part
    scale = np.float32(1) / weight if weight > np.float32(0) else np.float32(0)
    one = np.float32(1)
    is_lit = not weight > np.float32(0)
    out[y, x, 0] = one if is_lit else min(one, red * scale)
    out[y, x, 1] = one if is_lit else min(one, green * scale)
    out[y, x, 2] = one if is_lit else min(one, blue * scale)
