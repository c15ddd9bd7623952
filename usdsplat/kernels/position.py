"""Convert depth to world position, and to motion to another frame."""

from __future__ import annotations

import numpy as np

from .jit import scalar
from .launch import kernel

VIEW = np.dtype([("fx", "f8"), ("fy", "f8"), ("cx", "f8"), ("cy", "f8"), ("is_parallel", "i4")])
"""Focal lengths and principal point [pixel], and whether rays are parallel."""
STILL = -1
"""Marks an appearance whose elements do not move in local space."""


# --- 1. mathematics: one pixel ---------------------------------------------------------


@scalar
def unproject(view, column, row, depth):
    """Return a pixel's point in camera space: x right, y down, z forward."""
    x, y = (column - view.cx) / view.fx, (row - view.cy) / view.fy
    if view.is_parallel:
        return x, y, depth
    return x * depth, y * depth, depth


@scalar
def apply(m, x, y, z):
    """Multiply a 3x4 matrix by a point."""
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3],
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3],
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3],
    )


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="depth", writes=("out",), axes=2)
def positions(y, x, view, camera_to_world, depth, x0, y0, out):
    """Write the world position of every pixel, 0 where nothing is visible.

    Args:
        view: One VIEW record, shape (1,).
        camera_to_world: Shape (3, 4) f64, from x right, y down, z forward.
        depth: Planar, +inf where nothing is, shape (h, w) f32.
        x0, y0: Pixel of the first column and row.
        out: Receives positions, shape (h, w, 3) f32.
    """
    z = np.float64(depth[y, x])
    if not z < np.inf:
        out[y, x, 0] = out[y, x, 1] = out[y, x, 2] = np.float32(0)
        return
    px, py, pz = unproject(view[0], np.float64(x0 + x), np.float64(y0 + y), z)
    px, py, pz = apply(camera_to_world, px, py, pz)
    out[y, x, 0], out[y, x, 1], out[y, x, 2] = (
        np.float32(px),
        np.float32(py),
        np.float32(pz),
    )


@kernel(over="rows", writes=("out",), axes=2)
def seen(y, x, prims, rows, elements, hit, bary, splats, out):
    """Find appearance and position on it for the pixels that show surfaces.

    Args:
        prims, rows, elements: Visible prim, row and element, -1 where nothing is, shape (h, w) i32;
            a surface has no row.
        hit: Row among surfaces and triangle, shape (2, h, w) i32.
        bary: Weights of the triangle's second and third corner, shape (h, w, 2) f32.
        splats: Rows of splats; those of surfaces follow.
        out: Receives (rows, elements (h, w) i32, weights (h, w, 2) f32); the weights of a splat are
            (-1, -1).
    """
    all_rows, all_elements, weights = out
    if rows[y, x] < 0 and prims[y, x] >= 0:
        all_rows[y, x], all_elements[y, x] = splats + hit[0, y, x], hit[1, y, x]
        weights[y, x, 0], weights[y, x, 1] = bary[y, x, 0], bary[y, x, 1]
    else:
        all_rows[y, x], all_elements[y, x] = rows[y, x], elements[y, x]
        weights[y, x, 0], weights[y, x, 1] = np.float32(-1), np.float32(-1)


@kernel(over="depth", writes=("out",), axes=2)
def motion(
    y, x, views, moves, turns, first, deltas, depth, rows, elements, weights, x0, y0, sign, out
):
    """Write the motion in pixels from the visible point of each pixel to another frame.

    Args:
        views: VIEW records of this frame and the other, shape (2,).
        moves: For each appearance, from this frame's camera space to the other's, (m, 3, 4) f64.
        turns: From an appearance's own space to the other frame's camera space, (m, 3, 3) f64.
        first: First row of an appearance's deltas, or STILL, shape (m,) i64.
        deltas: Motion of points in local space, shape (n, 3) f32: one row for each
            splat, and one for each corner of each triangle.
        depth: Planar, +inf where nothing is, shape (h, w) f32.
        rows: Row of the visible appearance, -1 where none is, shape (h, w) i32.
        elements: Splat or triangle of the appearance, shape (h, w) i32.
        weights: Weights of the triangle's second and third corner, shape (h, w, 2) f32; (-1, -1)
            for a splat; empty if there are only splats.
        x0, y0: Pixel of the first column and row.
        sign: 1 for motion to the other frame, -1 for motion from it.
        out: Receives (right, up) [pixel], 0 where nothing is, shape (h, w, 2) f32.
    """
    z, row = np.float64(depth[y, x]), rows[y, x]
    out[y, x, 0], out[y, x, 1] = np.float32(0), np.float32(0)
    if row < 0 or not z < np.inf:
        return
    column, line = np.float64(x0 + x), np.float64(y0 + y)
    px, py, pz = unproject(views[0], column, line, z)
    px, py, pz = apply(moves[row], px, py, pz)
    if first[row] != STILL:
        b, c = -1.0, -1.0
        if weights.shape[0] > 0:
            b, c = np.float64(weights[y, x, 0]), np.float64(weights[y, x, 1])
        dx, dy, dz = 0.0, 0.0, 0.0
        if b < 0.0:
            at = first[row] + elements[y, x]
            dx, dy, dz = (
                np.float64(deltas[at, 0]),
                np.float64(deltas[at, 1]),
                np.float64(deltas[at, 2]),
            )
        else:
            at = first[row] + 3 * np.int64(elements[y, x])
            a = 1.0 - b - c
            dx = a * deltas[at, 0] + b * deltas[at + 1, 0] + c * deltas[at + 2, 0]
            dy = a * deltas[at, 1] + b * deltas[at + 1, 1] + c * deltas[at + 2, 1]
            dz = a * deltas[at, 2] + b * deltas[at + 1, 2] + c * deltas[at + 2, 2]
        t = turns[row]
        px += t[0, 0] * dx + t[0, 1] * dy + t[0, 2] * dz
        py += t[1, 0] * dx + t[1, 1] * dy + t[1, 2] * dz
        pz += t[2, 0] * dx + t[2, 1] * dy + t[2, 2] * dz
    other = views[1]
    if not other.is_parallel:
        if not pz > 0.0:
            return
        px, py = px / pz, py / pz
    u, v = other.fx * px + other.cx, other.fy * py + other.cy
    out[y, x, 0] = np.float32(sign * (u - column))
    out[y, x, 1] = np.float32(sign * (line - v))
