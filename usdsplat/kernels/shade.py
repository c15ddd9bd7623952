"""Shade the pixels of surfaces: geometry of the hit, material, light.

A surface is diffuse. It is lit by directional lights without shadows or, if there are none, by a
lamp at the eye. Geometry is float64 and relative to the triangle's first corner. Colour is float32.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from .jit import parallel, scalar
from .raster import corners
from .texture import footprint, trilinear
from .triangles import X, Y, Z, depth_from, depth_plane, facet, find

MATERIAL = np.dtype(
    [
        ("red", "f4"), ("green", "f4"), ("blue", "f4"), ("uses_colors", "i4"),
        ("first", "i4"), ("levels", "i4"), ("wrap_u", "i4"), ("wrap_v", "i4"),
    ]
)  # fmt: skip
"""Diffuse colour, whether the mesh's colours are used, first LEVEL and number of levels of the
texture (0 for none), and its wrap modes."""

LIGHT = 6
"""Floats of a light: direction to it in camera space, unit length | irradiance r g b."""

NOTHING, DRAWN, MATTE = range(3)
"""Values of a pixel in `covered`."""


# --- 1. mathematics: one pixel ----------------------------------------------------------


@scalar
def sight(view, x, y, z):
    """Return the point in camera space that pixel (x, y) sees at depth z."""
    u, v = (x - view.cx) / view.fx, (y - view.cy) / view.fy
    if view.orthographic:
        return u, v, z
    return u * z, v * z, z


@scalar
def hit_at(view, a, b, c, x, y):
    """Return the point in camera space, on the triangle's plane, that pixel (x, y) sees."""
    p, q, r = depth_plane(view, a, b, c)
    z = depth_from(
        view, p * x + (q * y + r), min(a[Z], b[Z], c[Z]), max(a[Z], b[Z], c[Z])
    )  # fmt: skip
    return sight(view, x, y, z)


@scalar
def slopes(view, a, b, c, x, y, z):
    """Return the change of the point that pixel (x, y) sees to the next pixel: (3 to the right, 3
    down)."""
    p, q, _ = depth_plane(view, a, b, c)
    if view.orthographic:
        return 1.0 / view.fx, 0.0, p, 0.0, 1.0 / view.fy, q
    u, v = (x - view.cx) / view.fx, (y - view.cy) / view.fy
    zx, zy = -z * z * p, -z * z * q
    return z / view.fx + u * zx, v * zx, zx, u * zy, z / view.fy + v * zy, zy


@scalar
def weights(a, b, c, x, y, z):
    """Return the weights of corners b and c at a point relative to a, which may lie off the
    plane."""
    nx, ny, nz = facet(a, b, c)
    x1, y1, z1 = b[X] - a[X], b[Y] - a[Y], b[Z] - a[Z]
    x2, y2, z2 = c[X] - a[X], c[Y] - a[Y], c[Z] - a[Z]
    scale = 1.0 / (nx * nx + ny * ny + nz * nz)
    one = nx * (y * z2 - z * y2) + ny * (z * x2 - x * z2) + nz * (x * y2 - y * x2)
    two = nx * (y1 * z - z1 * y) + ny * (z1 * x - x1 * z) + nz * (x1 * y - y1 * x)
    return one * scale, two * scale


@scalar
def within(one, two):
    """Return the weights of corners b and c, clamped to the triangle. Snapped corners cover
    slightly more."""
    one = min(max(one, 0.0), 1.0)
    return one, min(max(two, 0.0), 1.0 - one)


@scalar
def blended(three, one, two, channel):
    """Interpolate one channel of a value at the corners."""
    return (1.0 - one - two) * three[0, channel] + one * three[1, channel] + two * three[2, channel]


@scalar
def visible_side(a, b, c, x, y, z, parallel_rays):
    """Return the facet's unit normal on the side that is visible from (0, 0, 0)."""
    nx, ny, nz = facet(a, b, c)
    away = nz if parallel_rays else nx * x + ny * y + nz * z
    scale = (-1.0 if away > 0.0 else 1.0) / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * scale, ny * scale, nz * scale


@scalar
def turned(m, x, y, z, gx, gy, gz):
    """Transform a normal to camera space by a 3x3, with unit length, on the side of facet normal g.

    If the result has no direction, return the facet's normal.
    """
    nx = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z
    ny = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z
    nz = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z
    square = nx * nx + ny * ny + nz * nz
    if not (0.0 < square < np.inf):
        return gx, gy, gz
    scale = (-1.0 if nx * gx + ny * gy + nz * gz < 0.0 else 1.0) / math.sqrt(square)
    return nx * scale, ny * scale, nz * scale


@scalar
def light_on(lights, nx, ny, nz, px, py, pz, parallel_rays):
    """Return the light that a white surface reflects: (r, g, b). p is the point; the eye is at
    0."""
    zero = np.float32(0)
    if lights.shape[0] == 0:
        if parallel_rays:
            lit = np.float32(max(0.0, -nz))
        else:
            distance = math.sqrt(px * px + py * py + pz * pz)
            lit = np.float32(max(0.0, -(nx * px + ny * py + nz * pz) / distance))
        return lit, lit, lit
    r, g, b = zero, zero, zero
    fx, fy, fz = np.float32(nx), np.float32(ny), np.float32(nz)
    for i in range(lights.shape[0]):
        one = lights[i]
        lit = max(zero, fx * one[0] + fy * one[1] + fz * one[2])
        r, g, b = r + lit * one[3], g + lit * one[4], b + lit * one[5]
    return r, g, b


@scalar
def texture_at(view, a, b, c, corner_uvs, one, two, x, y, z, material, levels, texels):
    """Return the texture at a point of the triangle, filtered over the pixel's footprint: (r, g,
    b)."""
    rx, ry, rz, dx, dy, dz = slopes(view, a, b, c, x, y, z)
    right1, right2 = weights(a, b, c, rx, ry, rz)
    down1, down2 = weights(a, b, c, dx, dy, dz)
    u1, v1 = (
        np.float64(corner_uvs[1, 0]) - corner_uvs[0, 0],
        np.float64(corner_uvs[1, 1]) - corner_uvs[0, 1],
    )
    u2, v2 = (
        np.float64(corner_uvs[2, 0]) - corner_uvs[0, 0],
        np.float64(corner_uvs[2, 1]) - corner_uvs[0, 1],
    )
    size = footprint(
        levels[material.first], right1 * u1 + right2 * u2, right1 * v1 + right2 * v2,
        down1 * u1 + down2 * u2, down1 * v1 + down2 * v2,
    )  # fmt: skip
    return trilinear(
        texels, levels, material.first, material.levels, material.wrap_u, material.wrap_v,
        corner_uvs[0, 0] + one * u1 + two * u2, corner_uvs[0, 1] + one * v1 + two * v2, size,
    )  # fmt: skip


@scalar
def clear(row, column, end, out):
    """Clear pixels column..end-1 of a row, which see no surface."""
    color, normal, albedo, covered, ids, hit, bary = out
    for i in range(column, end):
        for c in range(3):
            color[row, i, c] = np.float32(0)
            normal[row, i, c] = np.float32(0)
            albedo[row, i, c] = np.float32(0)
            ids[c, row, i] = -1
        hit[0, row, i], hit[1, row, i] = -1, -1
        bary[row, i, 0], bary[row, i, 1] = np.float32(0), np.float32(0)
        covered[row, i] = NOTHING


@scalar
def shade_stretch(
    view, shapes, normal_matrices, looks, lights, t, x0, y, row, column, end, out
):  # fmt: skip
    """Shade pixels column..end-1 of a row, all of which see triangle t; `x0` is column 0's x."""
    appearances, firsts, vertex_firsts, triangles, vertices = shapes
    faces, normals, colors, uvs, material_of, materials, levels, texels = looks
    color, normal, albedo, covered, ids, hit, bary = out
    k = find(firsts, t)
    look, local = appearances[k], t - firsts[k]
    a, b, c = corners(appearances, firsts, vertex_firsts, triangles, vertices, t)
    # as scalars, which stay in registers: the compiler cannot know that writing a pixel does not
    # change the arrays
    a, b, c = (a[X], a[Y], a[Z]), (b[X], b[Y], b[Z]), (c[X], c[Y], c[Z])
    number = look.material
    if look.material_of >= 0:
        number += material_of[look.material_of + local]
    material = materials[number]
    has_normals = look.normals >= 0
    has_colors = look.colors >= 0 and material.uses_colors != 0
    has_texture = look.uvs >= 0 and material.levels > 0
    face = faces[look.rows + local]
    shown = np.float32(0) if look.matte else np.float32(1)
    for i in range(column, end):
        x = x0 + np.float64(i)
        px, py, pz = hit_at(view, a, b, c, x, y)
        one, two = weights(a, b, c, px - a[X], py - a[Y], pz - a[Z])
        one, two = within(one, two)
        nx, ny, nz = visible_side(a, b, c, px, py, pz, view.orthographic)
        if has_normals:
            three = normals[look.normals + local]
            nx, ny, nz = turned(
                normal_matrices[k], blended(three, one, two, 0), blended(three, one, two, 1),
                blended(three, one, two, 2), nx, ny, nz,
            )  # fmt: skip
        red, green, blue = material.red, material.green, material.blue
        if has_colors:
            three = colors[look.colors + local]
            red *= np.float32(blended(three, one, two, 0))
            green *= np.float32(blended(three, one, two, 1))
            blue *= np.float32(blended(three, one, two, 2))
        if has_texture:
            r, g, b_ = texture_at(
                view, a, b, c, uvs[look.uvs + local], one, two, x, y, pz, material, levels, texels
            )
            red, green, blue = red * r, green * g, blue * b_
        r, g, b_ = light_on(lights, nx, ny, nz, px, py, pz, view.orthographic)
        color[row, i, 0] = shown * (red * r)
        color[row, i, 1] = shown * (green * g)
        color[row, i, 2] = shown * (blue * b_)
        # USD's camera space has y up and looks along −z
        normal[row, i, 0], normal[row, i, 1], normal[row, i, 2] = nx, -ny, -nz
        albedo[row, i, 0], albedo[row, i, 1], albedo[row, i, 2] = red, green, blue
        ids[0, row, i], ids[1, row, i], ids[2, row, i] = look.prim, look.instance, face
        hit[0, row, i], hit[1, row, i] = k, local
        bary[row, i, 0], bary[row, i, 1] = one, two
        covered[row, i] = MATTE if look.matte else DRAWN


# --- 2. CPU ----------------------------------------------------------------------------


@parallel(writes=("out",), gpu="shade.shade")
def shade(view, shapes, normal_matrices, looks, lights, origin, winner, out):
    """Shade the nearest triangle of each pixel of a band.

    Args:
        view, shapes, winner: See `raster.raster`.
        normal_matrices: From normals in a mesh's space to camera space, of any length, float64,
            shape (n, 3, 3), one per appearance.
        looks: Appearance of all meshes: (faces (t,) i32, normals (.., 3, 3) f32, colors (.., 3, 3)
            f32, uvs (.., 3, 2) f32, material_of (..,) i32, MATERIAL records, LEVEL records, texels
            f32). An APPEARANCE has the first row of a mesh in each.
        lights: Shape (k, LIGHT) f32; without any there is a lamp at the eye.
        origin: x0, y0 of the band, i64.
        out: Receives (color, normal, albedo, covered, ids, hit, bary), see `SurfaceBand`.
    """
    for row in prange(winner.shape[0]):
        eye = view[0]
        y = np.float64(origin[1] + row)
        column = 0
        while column < winner.shape[1]:
            t = winner[row, column]
            end = column + 1
            while end < winner.shape[1] and winner[row, end] == t:
                end += 1
            if t < 0:
                clear(row, column, end, out)
            else:
                shade_stretch(
                    eye, shapes, normal_matrices, looks, lights, t, np.float64(origin[0]), y, row,
                    column, end, out,
                )  # fmt: skip
            column = end
