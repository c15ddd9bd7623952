"""Compute irradiance and visibility of lights at receivers: splats and points of surfaces.

A sample of a light, a direction or a point, is a camera. The splats that it sees are listed by tile
as for a picture. Transmittance to a receiver is evaluated exactly at its place on the screen:

    V = product over casters k of 1 - alpha_k ramp((gap_k - s) / 2 s)      s = s_k + s_receiver

where gap_k is the distance from the caster's ray hit to the receiver along the view, and s_k the
standard deviation of the caster along it. The ramp, from 0 to 1 between s and 3 s, spreads each
caster over its extent. Transmittance is a decreasing function of depth without steps, so that
splats of one layer do not shadow each other. Surfaces are read from a depth picture, as a step.

Source: Lokovic & Veach 2000, "Deep Shadow Maps"; Reeves et al. 1987, "Rendering Antialiased Shadows
with Depth Maps", for the filter of surfaces; UsdLux's documentation for shaping and shadows.
"""

from __future__ import annotations

import math

import numpy as np

from .batch import SHRINK
from .bins import TILE
from .blend import exponential
from .casters import HIT, LABEL, NEAREST
from .jit import scalar
from .launch import kernel
from .position import apply, unproject
from .project import LOG_CUTOFF, LOG_OPACITY, A, B, C, U, V
from .ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, SPREAD, ray_hit_at, row_at

SUMS = 6
"""Floats of the sums of a receiver: irradiance times visibility, then irradiance; r g b each."""
MEAN_COSINE = np.float32(0.25)
"""Mean of max(0, cosine) over all directions."""
OPAQUE = np.float32(5e-4)
"""Transmittance under which a receiver is in full shadow."""
STEEPEST = 64.0
"""Largest slope of a plane against the light that is followed between pixels."""
MOST_ALPHA = np.float32(0.999)
ALL_FACES = -1
NO_SHAPES = np.empty((0, 6), np.float32)
NO_PRIMS, ONE_PRIM = np.empty(0, np.int32), np.ones(1, np.uint8)
"""Prims of receivers that are all of one prim, and whether the light is linked to it."""

DISTANT, EVERY_WAY, ONE_SIDE = range(3)
"""Kinds of samples: a direction; a point that radiates into all directions; a point of a surface
that radiates by the cosine on one side."""

LIGHT = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("z", "f8"),
        ("nx", "f4"), ("ny", "f4"), ("nz", "f4"),
        ("red", "f4"), ("green", "f4"), ("blue", "f4"),
        ("ax", "f4"), ("ay", "f4"), ("az", "f4"),
        ("focus", "f4"), ("tint_red", "f4"), ("tint_green", "f4"), ("tint_blue", "f4"),
        ("cone_start", "f4"), ("cone_end", "f4"),
        ("shadow_red", "f4"), ("shadow_green", "f4"), ("shadow_blue", "f4"),
        ("distance", "f4"), ("falloff", "f4"), ("gamma", "f4"),
        ("kind", "i4"), ("casts", "i4"), ("face", "i4"),
    ],
    align=True,
)  # fmt: skip
"""A sample of a light: unit direction towards it, or its position; normal of its surface; the light
that a white surface reflects which faces it at distance 1; axis, focus, tint and cone [rad] of its
shaping; colour, maximum distance (negative: none), falloff and gamma of its shadow; kind; whether
it casts shadows; the face of the cube around the light that the screen shows, or ALL_FACES."""


# --- 1. mathematics: one receiver ------------------------------------------------------


@scalar
def face_of(x, y, z):
    """Return the face of a cube, 0..5, that a direction points at: +x −x +y −y +z −z."""
    if abs(x) >= abs(y) and abs(x) >= abs(z):
        return 0 if x > 0.0 else 1
    if abs(y) >= abs(z):
        return 2 if y > 0.0 else 3
    return 4 if z > 0.0 else 5


@scalar
def smooth(x, low, high):
    """Return the smooth step of x from 0 at `low` to 1 at `high`; a step if they are equal."""
    if not (x > low):
        return np.float32(0)
    if x >= high:
        return np.float32(1)
    t = (x - low) / (high - low)
    return t * t * (np.float32(3) - np.float32(2) * t)


@scalar
def shaped(light, x, y, z):
    """Return the factors on the emission in unit direction (x, y, z): (r, g, b)."""
    one, zero = np.float32(1), np.float32(0)
    cosine = np.float32(x * light.ax + y * light.ay + z * light.az)
    red, green, blue = one, one, one
    if light.focus > zero:
        part = np.float32(math.pow(max(cosine, zero), light.focus))
        red = part + (one - part) * light.tint_red
        green = part + (one - part) * light.tint_green
        blue = part + (one - part) * light.tint_blue
    if light.cone_end < np.float32(math.pi):
        angle = np.float32(math.acos(min(max(cosine, -one), one)))
        part = one - smooth(angle, light.cone_start, light.cone_end)
        red, green, blue = red * part, green * part, blue * part
    return red, green, blue


@scalar
def arriving(light, px, py, pz, normal):
    """Return the irradiance of a sample at a receiver, without what is in between: (r, g, b).

    Args:
        normal: Unit normal and confidence, 4 floats. Light of a receiver without confidence is the
            mean over all normals.
    """
    zero = np.float32(0)
    x, y, z, scale = light.x, light.y, light.z, 1.0
    if light.kind != DISTANT:
        x, y, z = light.x - px, light.y - py, light.z - pz
        square = x * x + y * y + z * z
        if not (square > 0.0):
            return zero, zero, zero
        scale = 1.0 / math.sqrt(square)
        x, y, z = x * scale, y * scale, z * scale
        scale = 1.0 / square
        if light.kind == ONE_SIDE:
            scale *= max(0.0, -(x * light.nx + y * light.ny + z * light.nz))
    facing = np.float32(max(0.0, normal[0] * x + normal[1] * y + normal[2] * z))
    lit = normal[3] * facing + (np.float32(1) - normal[3]) * MEAN_COSINE
    lit *= np.float32(scale)
    if not (lit > zero):
        return zero, zero, zero
    red, green, blue = shaped(light, -x, -y, -z)
    return lit * light.red * red, lit * light.green * green, lit * light.blue * blue


@scalar
def fading(light, gap):
    """Return the part of a shadow that is left at a distance from its caster, where shadows of the
    light have a maximum distance."""
    if gap >= light.distance:
        return np.float32(0)
    left = light.distance - gap
    if left < light.falloff:
        return np.float32(math.pow(left / light.falloff, light.gamma))
    return np.float32(1)


@scalar
def spread_along(m, shape):
    """Return the standard deviation of a receiver along the view.

    Args:
        m: World to the camera space of the light, shape (3, 4) f64.
        shape: Covariance in the world, xx xy xz yy yz zz.
    """
    a, b, c = m[2, 0], m[2, 1], m[2, 2]
    square = (
        a * a * shape[0] + b * b * shape[3] + c * c * shape[5]
        + 2.0 * (a * b * shape[1] + a * c * shape[2] + b * c * shape[4])
    )  # fmt: skip
    return np.float32(math.sqrt(max(square, 0.0)))


@scalar
def through_splats(light, u, v, z, sigma, own, is_parallel, splats, tiles):
    """Return the transmittance of the splats in front of a receiver.

    Args:
        u, v, z: Place on the screen [pixel] and planar depth.
        sigma: Standard deviation of the receiver along the view.
        own: Appearance that casts no shadow; −1 for none.
        splats, tiles: See `illuminate`.
    """
    casters, casts = splats
    starts, lists, grid = tiles
    g, one, zero = grid[0], np.float32(1), np.float32(0)
    seen = one
    column = math.floor(u + 0.5) - g.left
    row = math.floor(v + 0.5) - g.top
    if not (column >= 0 and row >= 0 and column < g.columns * TILE and row < g.rows * TILE):
        return seen
    tile = np.int64(row) // TILE * g.columns + np.int64(column) // TILE
    depth = np.float32(z)
    front = depth - sigma
    x, y = np.float32(u), np.float32(v)
    for i in range(starts[tile], starts[tile + 1]):
        k = np.uint64(lists[np.uint64(i)])  # unsigned indices need no test for negative ones
        if not (casters[k, NEAREST] < front):
            break
        dx, dy = x - casters[k, U], y - casters[k, V]
        power = casters[k, LOG_OPACITY] + (
            casters[k, A] * dx * dx + casters[k, B] * dx * dy + casters[k, C] * dy * dy
        )
        if not (power >= LOG_CUTOFF):
            continue
        label = np.int64(casters[k, LABEL])
        if label == own or casts[label] == 0:
            continue
        first, second, third = row_at(
            casters[k, HIT + HX], casters[k, HIT + HY], casters[k, HIT + HZ], dy
        )
        hit = ray_hit_at(
            dx, casters[k, HIT + GX], casters[k, HIT + GY], first, second, third,
            casters[k, HIT + CENTER], casters[k, HIT + REACH], is_parallel,
        )  # fmt: skip
        gap, both = depth - hit, sigma + casters[k, HIT + SPREAD]
        if gap <= both:
            continue
        ramp = one
        if gap < np.float32(3) * both:
            ramp = (gap - both) / (both + both)
        alpha = min(MOST_ALPHA, exponential(min(power, zero) * SHRINK))
        if light.distance >= zero:
            ramp *= fading(light, gap)
        seen *= one - alpha * ramp
        if seen < OPAQUE:
            return zero
    return seen


@scalar
def plane_depth(view, u, v, nx, ny, nz, height):
    """Return the depth at which pixel (u, v) sees the plane n · p = height."""
    x, y, _ = unproject(view, u, v, 1.0)
    if view.is_parallel:
        return (height - nx * x - ny * y) / nz
    return height / (nx * x + ny * y + nz)


@scalar
def past_surfaces(light, view, u, v, x, y, z, normal, sigma, depths):
    """Return the part of 2 × 2 pixels of a depth picture that lie behind a receiver or are clear.

    A point of a surface is compared with the depth of its own plane at each pixel, so that a plane
    does not shadow itself.

    Args:
        view: VIEW record of the depth picture.
        u, v, x, y, z: The receiver on the screen [pixel], and in camera space.
        normal: Of a surface in camera space, 3 numbers; 0 for a splat.
        sigma: Standard deviation of a splat along the view.
        depths: Planar depths, +inf where nothing is, shape (h, w) f32.
    """
    height, width = depths.shape[0], depths.shape[1]
    first_column, first_row = math.floor(u), math.floor(v)
    along, across = u - first_column, v - first_row
    scale = 1.0 if view.is_parallel else z
    pixel = scale / min(view.fx, view.fy)
    nx, ny, nz = normal
    level = nx * x + ny * y + nz * z
    reach = STEEPEST * pixel
    seen = np.float32(0)
    for j in range(2):
        for i in range(2):
            column, row = np.int64(first_column) + i, np.int64(first_row) + j
            weight = (along if i == 1 else 1.0 - along) * (across if j == 1 else 1.0 - across)
            left = np.float32(1)
            if 0 <= column < width and 0 <= row < height:
                own = z
                if abs(nz) > 0.0:
                    plane = plane_depth(
                        view, np.float64(column), np.float64(row), nx, ny, nz, level
                    )
                    own = min(max(plane, z - reach), z + reach)
                gap = np.float32(own - pixel - depths[row, column])
                if gap > sigma:
                    ramp = np.float32(1)
                    if gap < np.float32(3) * sigma:
                        ramp = (gap - sigma) / (sigma + sigma)
                    if light.distance >= np.float32(0):
                        ramp *= fading(light, gap)
                    left = np.float32(1) - ramp
            seen += np.float32(weight) * left
    return seen


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="points", writes=("sums",))
def illuminate(
    i, light, points, normals, shapes, prims, lit, own, world_to_screen, views, splats, tiles,
    depths, through, sums,
):  # fmt: skip
    """Add the light of one sample to a receiver.

    Args:
        light: One LIGHT record, shape (1,).
        points, normals, shapes: Receivers, see `receivers.place_splats`; no `shapes` for surfaces.
        prims: Number of the prim of each receiver, shape (n,) i32; empty if all have number 0.
        lit: Whether the light is linked to each prim, shape (prims,) u8.
        own: Appearance of the receivers, which does not shadow them; −1 if all do.
        world_to_screen: To the camera space of the light, shape (3, 4) f64.
        views: VIEW records of the picture of splats and of that of surfaces, shape (2,).
        splats: (casters: see there, shape (n, CASTER) f32; casts: whether each appearance casts
            shadows, shape (appearances,) u8).
        tiles: (starts, lists, grid), see `bins.tile_lists`.
        depths: Depths of surfaces, see `past_surfaces`; empty for none.
        through: Transmittance of the splats to each receiver, shape (n,) f32; empty if it is not
            known, see `light_lanes`.
        sums: Changed in place, shape (n, SUMS) f32.
    """
    prim = 0
    if prims.shape[0] > 0:
        prim = prims[i]
    if prim < 0 or lit[prim] == 0:
        return
    one = light[0]
    px, py, pz = points[i, 0], points[i, 1], points[i, 2]
    if one.face != ALL_FACES and face_of(px - one.x, py - one.y, pz - one.z) != one.face:
        return
    red, green, blue = arriving(one, px, py, pz, normals[i])
    if not (red + green + blue > np.float32(0)):
        return
    seen = np.float32(1)
    m = world_to_screen
    x, y, z = apply(m, px, py, pz)
    if one.casts and (views[0].is_parallel or z > 0.0):
        sigma = np.float32(0)
        nx, ny, nz = 0.0, 0.0, 0.0
        if shapes.shape[0] > 0:
            sigma = spread_along(m, shapes[i])
        else:
            wx, wy, wz = normals[i, 0], normals[i, 1], normals[i, 2]
            nx = m[0, 0] * wx + m[0, 1] * wy + m[0, 2] * wz
            ny = m[1, 0] * wx + m[1, 1] * wy + m[1, 2] * wz
            nz = m[2, 0] * wx + m[2, 1] * wy + m[2, 2] * wz
        depth = 1.0 if views[0].is_parallel else z
        if through.shape[0] > 0:
            seen = through[i]
        elif splats[0].shape[0] > 0:
            view = views[0]
            u, v = view.fx * (x / depth) + view.cx, view.fy * (y / depth) + view.cy
            seen = through_splats(one, u, v, z, sigma, own, view.is_parallel, splats, tiles)
        if depths.shape[0] > 0 and seen > np.float32(0):
            view = views[1]
            u, v = view.fx * (x / depth) + view.cx, view.fy * (y / depth) + view.cy
            seen *= past_surfaces(one, view, u, v, x, y, z, (nx, ny, nz), sigma, depths)
    hidden = np.float32(1) - seen
    sums[i, 0] += red * (seen + hidden * one.shadow_red)
    sums[i, 1] += green * (seen + hidden * one.shadow_green)
    sums[i, 2] += blue * (seen + hidden * one.shadow_blue)
    sums[i, 3] += red
    sums[i, 4] += green
    sums[i, 5] += blue
