"""Motion of splats onto a surface: timing, path, and orientation on the surface.

The target of a splat is a triangle, a position on it, a height over it and a rotation relative to
it, so the splat follows a mesh that moves.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import exact, scalar
from ..launch import BlockArray, block_kernel, kernel
from .facets import unit
from .philox import STAGGER, uniforms

PRESERVE, DENSITY, FLATTEN = range(3)
"""Policies for the sizes of splats."""


# --- 1. mathematics: one splat ----------------------------------------------------------


@scalar
def progress(now, rank, start, duration, stagger):
    """Return how far a splat is on its path, 0 to 1, with speed and acceleration 0 at both ends.

    Source: Perlin 2002, "Improving Noise" (the smootherstep polynomial).
    """
    late = now - start - stagger * rank
    s = 1.0 if late >= 0.0 else 0.0
    if duration > 0.0:
        s = min(max(late / duration, 0.0), 1.0)
    return s * s * s * (s * (6.0 * s - 15.0) + 10.0)


@exact
def rotate(w, x, y, z, vx, vy, vz):
    """Rotate a vector by a unit quaternion."""
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


@exact
def multiply(aw, ax, ay, az, bw, bx, by, bz):
    """Return the product of quaternions a and b: the rotation by b, then by a."""
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@exact
def shortest_arc(ax, ay, az, bx, by, bz):
    """Return the smallest rotation of the line along unit vector a to the line along b, at most 90
    degrees."""
    cosine = ax * bx + ay * by + az * bz
    if cosine < 0.0:
        bx, by, bz, cosine = -bx, -by, -bz, -cosine
    x, y, z, w = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx, 1.0 + cosine
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return w / length, x / length, y / length, z / length


@exact
def part_of_turn(w, x, y, z, part):
    """Return the rotation by a fraction of the angle (slerp from the identity)."""
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    half = part * math.atan2(sine, w)
    factor = math.sin(half) / sine if sine > 1e-30 else part
    return math.cos(half), factor * x, factor * y, factor * z


@scalar
def on_face(values, weights, i, a):
    """Interpolate component `a` of the values of three corners at the position of splat i."""
    u, v, w = weights[i, 0], weights[i, 1], weights[i, 2]
    return (
        u * np.float64(values[0, a]) + v * np.float64(values[1, a]) + w * np.float64(values[2, a])
    )


@scalar
def place(points, triangles, face, weights, i, a):
    """Return coordinate `a` of the position of splat i on its triangle."""
    u, v, w = weights[i, 0], weights[i, 1], weights[i, 2]
    return (
        u * np.float64(points[triangles[face, 0], a])
        + v * np.float64(points[triangles[face, 1], a])
        + w * np.float64(points[triangles[face, 2], a])
    )


@scalar
def lying(g, axes, i):
    """Return the normal of the flat splat: that of its captured plane, transformed by cofactors."""
    x, y, z = np.float64(axes[i, 0]), np.float64(axes[i, 1]), np.float64(axes[i, 2])
    if g.shape[0] > 0:
        a, b, c = np.float64(g[i, 0, 0]), np.float64(g[i, 0, 1]), np.float64(g[i, 0, 2])
        d, e, f = np.float64(g[i, 1, 0]), np.float64(g[i, 1, 1]), np.float64(g[i, 1, 2])
        p, q, r = np.float64(g[i, 2, 0]), np.float64(g[i, 2, 1]), np.float64(g[i, 2, 2])
        x, y, z = (
            (e * r - f * q) * x + (f * p - d * r) * y + (d * q - e * p) * z,
            (c * q - b * r) * x + (a * r - c * p) * y + (b * p - a * q) * z,
            (b * f - c * e) * x + (c * d - a * f) * y + (a * e - b * d) * z,
        )
    return unit(x, y, z)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="ids", writes=("out",))
def draw_ranks(i, seed, ids, out):
    """Draw a number in [0, 1) for each id, (n,) i64 to (n,) f32: the order in which splats
    start."""
    first, _, _, _ = uniforms(seed, STAGGER, ids[i], 0, 0)
    out[i] = first


@kernel(over="axes", writes=("out",))
def look(i, gradient, axes, out):
    """Compute the current normals of splats.

    Args:
        gradient: Deformation gradients, shape (n, 3, 3), or empty.
        axes: Smallest axis of each splat as captured, unit, shape (n, 3) f32.
        out: Receives unit vectors, shape (n, 3) f32.
    """
    out[i, 0], out[i, 1], out[i, 2] = lying(gradient, axes, i)


@kernel(over="rows", writes=("turns", "ups"))
def attach(k, rows, axes, faces, places, normals, frames, turns, ups):
    """Compute the rotations that splats will have relative to their triangles.

    Args:
        rows: Rows of the splats, shape (m,) i64.
        axes: Current normals of splats, shape (n, 3) f32.
        faces, places: Triangle that each splat is bound to, shape (n,) i32, and barycentric weights
            on it, (n, 3) f32.
        normals, frames: Of the mesh now: normals of its corners, shape (t, 3, 3), frames of its
            triangles, (t, 4) f32.
        turns: Receives the smallest rotation onto the mesh, in the triangle's frame, shape (n, 4)
            f32.
        ups: Receives the mesh's unit normals, shape (n, 3) f32.
    """
    i = rows[k]
    face = faces[i]
    corner = normals[face]
    nx, ny, nz = unit(
        on_face(corner, places, i, 0),
        on_face(corner, places, i, 1),
        on_face(corner, places, i, 2),
    )
    ups[i, 0], ups[i, 1], ups[i, 2] = nx, ny, nz
    w, x, y, z = shortest_arc(
        np.float64(axes[i, 0]), np.float64(axes[i, 1]), np.float64(axes[i, 2]), nx, ny, nz
    )
    f = frames[face]
    w, x, y, z = multiply(f[0], -f[1], -f[2], -f[3], w, x, y, z)
    turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3] = w, x, y, z


@kernel(over="points", writes=("out",))
def approach(i, points, faces, places, mesh, way, out):
    """Compute the positions of splats on straight lines to their positions on the mesh.

    Args:
        points: Start positions, shape (n, 3) f32.
        faces, places: Triangles and barycentric weights, see `attach`.
        mesh: (points (p, 3) f32, triangles (t, 3) i32).
        way: Progress 0 to 1, shape (n,) f32.
        out: Receives positions, shape (n, 3) f32.
    """
    mesh_points, triangles = mesh
    for a in range(3):
        x = np.float64(points[i, a])
        goal = place(mesh_points, triangles, faces[i], places, i, a) if faces[i] >= 0 else x
        out[i, a] = x + way[i] * (goal - x)


@kernel(over="ranks", writes=("out",))
def advance(i, now, timing, ranks, select, out):
    """Compute the progress of splats, 0 to 1.

    Args:
        now: Time [s] since the simulation's start.
        timing: (weight, start, duration, stagger).
        ranks: Order of starting, 0 to 1, shape (n,) f32.
        select: Weight of each splat, shape (n,) f32.
        out: Receives the progress, shape (n,) f32.
    """
    weight, start, duration, stagger = timing
    eased = progress(now, np.float64(ranks[i]), start, duration, stagger)
    out[i] = weight * np.float64(select[i]) * eased


@block_kernel(
    over="points",
    writes=("points", "gradient"),
    scratch=(BlockArray(shape=12, dtype=np.float64),),
)
def move(first, last, own, points, gradient, way, bound, mesh, splats, how, slide):
    """Move, rotate and stretch splats by their progress towards their targets.

    Args:
        points: Changed in place, shape (n, 3) f32.
        gradient: Deformation gradients, changed in place, shape (n, 3, 3) f32, or empty.
        way: Progress 0 to 1, shape (n,) f32; splats at 0 are not changed.
        bound: (faces (n,) i32, places (n, 3), turns (n, 4), heights (n,), spreads (n,): growth
            factors of the spacing, sizes (n,): sizes of the faces when splats were bound; f32).
        mesh: Mesh now: (points, triangles, normals (t, 3, 3), frames (t, 4), sizes (t,) f32).
        splats: (axes (n, 3): smallest axes as captured, flats (n,): factor on the smallest size
            that makes a splat flat, f32).
        how: (orient, keep_thickness, PRESERVE, DENSITY or FLATTEN).
        slide: (faces (n,) i32, places (n, 3), from (n, 3), heights (n,) f32): closest points of the
            mesh to points on straight lines, these points, and heights over the mesh at the
            beginning; empty for straight paths.
    """
    faces, places, turns, heights, spreads, sizes = bound
    mesh_points, triangles, normals, frames, mesh_sizes = mesh
    axes, flats = splats
    orient, keep, scale_mode = how
    slide_faces, slide_places, slide_from, slide_heights = slide
    goal, f = own[:3], own[3:]
    for i in range(first, last):
        c, face = np.float64(way[i]), faces[i]
        if c == 0.0 or face < 0:
            continue
        corner = normals[face]
        nx, ny, nz = unit(
            on_face(corner, places, i, 0),
            on_face(corner, places, i, 1),
            on_face(corner, places, i, 2),
        )
        height = keep * np.float64(heights[i])
        if slide_faces.shape[0] == 0:
            for a in range(3):
                goal[a] = place(mesh_points, triangles, face, places, i, a)
            goal[0] += nx * height
            goal[1] += ny * height
            goal[2] += nz * height
            for a in range(3):
                x = np.float64(points[i, a])
                points[i, a] = x + c * (goal[a] - x)
        else:
            under = normals[slide_faces[i]]
            ux, uy, uz = unit(
                on_face(under, slide_places, i, 0),
                on_face(under, slide_places, i, 1),
                on_face(under, slide_places, i, 2),
            )
            for a in range(3):
                goal[a] = place(mesh_points, triangles, slide_faces[i], slide_places, i, a)
            dx, dy, dz = unit(
                slide_from[i, 0] - goal[0],
                slide_from[i, 1] - goal[1],
                slide_from[i, 2] - goal[2],
            )
            up = (1.0 - c) * (-1.0 if dx * ux + dy * uy + dz * uz < 0.0 else 1.0)
            dx, dy, dz = unit(up * dx + c * ux, up * dy + c * uy, up * dz + c * uz)
            over = (1.0 - c) * np.float64(slide_heights[i]) + c * height
            points[i, 0] = goal[0] + over * dx
            points[i, 1] = goal[1] + over * dy
            points[i, 2] = goal[2] + over * dz
        if gradient.shape[0] > 0:
            ax, ay, az = lying(gradient, axes, i)
            r, t = frames[face], turns[i]
            qw, qx, qy, qz = multiply(r[0], r[1], r[2], r[3], t[0], t[1], t[2], t[3])
            bx, by, bz = rotate(qw, qx, qy, qz, ax, ay, az)
            w, x, y, z = shortest_arc(bx, by, bz, nx, ny, nz)
            w, x, y, z = multiply(w, x, y, z, qw, qx, qy, qz)
            w, x, y, z = part_of_turn(w, x, y, z, c * orient)
            flat, wide = 1.0, 1.0
            if scale_mode == DENSITY and sizes[i] > 0:
                grown = np.float64(spreads[i]) * mesh_sizes[face] / sizes[i]
                wide += c * (grown - 1.0)
            elif scale_mode == FLATTEN:
                flat += c * (np.float64(flats[i]) - 1.0)
            bx, by, bz = rotate(w, x, y, z, ax, ay, az)
            # R (wide I + (flat - wide) a aT): first wide R by columns, then the part along b = R a
            f[0], f[3], f[6] = rotate(w, x, y, z, wide, 0.0, 0.0)
            f[1], f[4], f[7] = rotate(w, x, y, z, 0.0, wide, 0.0)
            f[2], f[5], f[8] = rotate(w, x, y, z, 0.0, 0.0, wide)
            d = flat - wide
            f[0] += d * bx * ax
            f[1] += d * bx * ay
            f[2] += d * bx * az
            f[3] += d * by * ax
            f[4] += d * by * ay
            f[5] += d * by * az
            f[6] += d * bz * ax
            f[7] += d * bz * ay
            f[8] += d * bz * az
            for b in range(3):
                x, y, z = gradient[i, 0, b], gradient[i, 1, b], gradient[i, 2, b]
                for a in range(3):
                    gradient[i, a, b] = f[3 * a] * x + f[3 * a + 1] * y + f[3 * a + 2] * z
