"""Project triangles: vertices in pixels, edges that neighbours share exactly, depth planes.

Camera space here is x right, y down, z forward; pixel (0, 0) is centred on (0, 0). A vertex in
front of the near plane, and within GUARD, is snapped to 1/4096 pixel, where float64 evaluates edge
functions without rounding. Other vertices stay homogeneous. A triangle that crosses the near plane
is therefore never split: its edges are planes through the eye, and each pixel's depth is compared
with the near plane, which is equivalent to clipping. Depth comes from the plane of the triangle
itself and not from snapped corners.

Source: Pineda 1988 for edge functions; Olano and Greer 1997, "Triangle scan conversion using 2D
homogeneous coordinates"; the top-left rule as the graphics interfaces state it.
"""

from __future__ import annotations

import math

import numpy as np

from .jit import scalar
from .launch import block_kernel

STEPS = 4096.0
"""Positions per pixel to which a vertex is snapped."""
GUARD = 16384.0
"""Distance from pixel (0, 0) beyond which vertices are not snapped [pixel]."""
LIMIT = 1e50
"""Largest coordinate of a drawn triangle [scene unit]. Products of four lengths stay finite."""
SLACK = 1.0
"""Margin of bounds [pixel]."""
TINY = 2.3e-308
"""Minimum of the edge function inside, for an edge whose own pixels belong to the neighbour."""

VERTEX = 5
"""Floats of a vertex: x y z in camera space | u v snapped [pixel], NaN where it is not."""
X, Y, Z, U, V = range(VERTEX)

VIEW = np.dtype(
    [
        ("fx", "f8"), ("fy", "f8"), ("cx", "f8"), ("cy", "f8"), ("near", "f8"), ("far", "f8"),
        ("x0", "i4"), ("y0", "i4"), ("x1", "i4"), ("y1", "i4"), ("orthographic", "i4"),
    ]
)  # fmt: skip
"""A view: focal lengths and principal point [pixel], clipping depths, the data window [pixel], end
exclusive, and whether rays are parallel."""

APPEARANCE = np.dtype(
    [
        ("points", "i8"), ("rows", "i8"), ("normals", "i8"), ("colors", "i8"), ("uvs", "i8"),
        ("material_of", "i8"), ("material", "i8"), ("prim", "i4"), ("instance", "i4"),
        ("double_sided", "i4"), ("mirrored", "i4"), ("matte", "i4"),
    ]
)  # fmt: skip
"""One appearance of a mesh: the first row of its points, its triangles and of each optional array,
else -1; the number of its first material; its ids; whether it is double-sided, mirrored by its
transform, and a matte."""


# --- 1. mathematics: one triangle -------------------------------------------------------


@scalar
def find(firsts, i):
    """Return the range that contains item i. `firsts` are the starts of the ranges, ascending, and
    the end."""
    low, high = 0, firsts.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if firsts[middle] <= i:
            low = middle
        else:
            high = middle
    return low


@scalar
def place_one(view, m, point, vertex):
    """Fill a vertex from a point in its mesh's space and the 3x4 matrix to camera space."""
    px, py, pz = np.float64(point[0]), np.float64(point[1]), np.float64(point[2])
    x = m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3]
    y = m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3]
    z = m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3]
    vertex[X], vertex[Y], vertex[Z] = x, y, z
    vertex[U], vertex[V] = np.nan, np.nan
    if view.orthographic:
        u, v = view.fx * x + view.cx, view.fy * y + view.cy
    elif z >= view.near:
        u, v = view.fx * (x / z) + view.cx, view.fy * (y / z) + view.cy
    else:
        return
    if abs(u) <= GUARD and abs(v) <= GUARD:
        vertex[U] = math.floor(u * STEPS + 0.5) / STEPS
        vertex[V] = math.floor(v * STEPS + 0.5) / STEPS


@scalar
def is_snapped(vertex):
    """Return whether a vertex has a snapped position on the screen."""
    return vertex[U] == vertex[U]


@scalar
def homogeneous(view, vertex):
    """Return a vertex in pixels times w, and w."""
    if is_snapped(vertex):
        return vertex[U], vertex[V], 1.0
    x, y, z = vertex[X], vertex[Y], vertex[Z]
    if view.orthographic:
        return view.fx * x + view.cx, view.fy * y + view.cy, 1.0
    return view.fx * x + view.cx * z, view.fy * y + view.cy * z, z


@scalar
def orientation(view, a, b, c):
    """Return the orientation, positive if a b c are clockwise in the picture as seen by the eye, y
    down."""
    if is_snapped(a) and is_snapped(b) and is_snapped(c):
        return (b[U] - a[U]) * (c[V] - a[V]) - (c[U] - a[U]) * (b[V] - a[V])
    ax, ay, aw = homogeneous(view, a)
    bx, by, bw = homogeneous(view, b)
    cx, cy, cw = homogeneous(view, c)
    return ax * (by * cw - bw * cy) + ay * (bw * cx - bx * cw) + aw * (bx * cy - by * cx)


@scalar
def comes_after(a, b):
    """Return whether end a sorts after end b, in an order that is the same for both triangles of an
    edge."""
    if is_snapped(a) != is_snapped(b):
        return is_snapped(b)
    if a[X] != b[X]:
        return a[X] > b[X]
    return a[Y] > b[Y] if a[Y] != b[Y] else a[Z] > b[Z]


@scalar
def edge_from(view, a, b):
    """Return the edge function A (x − u) + B (y − v) + C of the plane through the eye, a and b.

    It is 0 on the edge, exactly so at a vertex that is snapped.
    """
    ax, ay, aw = homogeneous(view, a)
    bx, by, bw = homogeneous(view, b)
    if is_snapped(a):
        return ay * bw - by, bx - ax * bw, ax, ay, 0.0
    return ay * bw - aw * by, aw * bx - ax * bw, 0.0, 0.0, ax * by - ay * bx


@scalar
def edge(view, a, b, side):
    """Return the edge function, positive inside, and its minimum inside: (A, B, u, v, C, least).

    `side` is the sign of the triangle's orientation. Both neighbours of an edge compute the
    function from the same end and negate it afterwards, so their values are exactly opposite. A
    pixel on the edge belongs to the triangle to the right of it or, if the edge is level, below.
    """
    if comes_after(a, b):
        a, b, side = b, a, -side
    x, y, u, v, c = edge_from(view, a, b)
    x, y, c = side * x, side * y, side * c
    return x, y, u, v, c, 0.0 if x > 0.0 or (x == 0.0 and y > 0.0) else TINY


@scalar
def facet(a, b, c):
    """Return the cross product of two sides, in camera space."""
    x1, y1, z1 = b[X] - a[X], b[Y] - a[Y], b[Z] - a[Z]
    x2, y2, z2 = c[X] - a[X], c[Y] - a[Y], c[Z] - a[Z]
    return y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2


@scalar
def depth_plane(view, a, b, c):
    """Return (P, Q, R) of the depth plane: 1/z, or z if rays are parallel, is P x + Q y + R."""
    nx, ny, nz = facet(a, b, c)
    d = nx * a[X] + ny * a[Y] + nz * a[Z]
    if view.orthographic:
        p, q = -nx / (view.fx * nz), -ny / (view.fy * nz)
        return p, q, d / nz - p * view.cx - q * view.cy
    p, q = nx / (view.fx * d), ny / (view.fy * d)
    return p, q, nz / d - p * view.cx - q * view.cy


@scalar
def depth_from(view, value, low, high):
    """Return planar depth from the plane's value, clamped to the depths of the triangle's corners.

    A snapped corner may cover a pixel that the plane of a triangle seen edge-on misses.
    """
    z = value
    if not view.orthographic:
        z = 1.0 / value if value > 0.0 else high
    return min(max(z, low), high) if z == z else high


@scalar
def near_end(view, a, b, low_u, low_v, high_u, high_v):
    """Widen bounds [pixel] by the part of edge ab that is in front of the near plane."""
    za, zb = a[Z], b[Z]
    x, y, z = a[X], a[Y], za
    if not view.orthographic and za < view.near:
        if zb < view.near:
            return low_u, low_v, high_u, high_v
        t = (view.near - za) / (zb - za)
        x, y, z = x + t * (b[X] - x), y + t * (b[Y] - y), view.near
    elif not view.orthographic and zb < view.near:
        t = (view.near - zb) / (za - zb)
        x1, y1 = b[X] + t * (x - b[X]), b[Y] + t * (y - b[Y])
        u, v = view.fx * (x1 / view.near) + view.cx, view.fy * (y1 / view.near) + view.cy
        low_u, high_u = min(low_u, u), max(high_u, u)
        low_v, high_v = min(low_v, v), max(high_v, v)
    if view.orthographic:
        z = 1.0
    u, v = view.fx * (x / z) + view.cx, view.fy * (y / z) + view.cy
    return min(low_u, u), min(low_v, v), max(high_u, u), max(high_v, v)


@scalar
def bounds(view, a, b, c):
    """Return the lowest and highest pixel coordinates that the triangle can cover: (u, v, u, v)."""
    if is_snapped(a) and is_snapped(b) and is_snapped(c):
        return (
            min(a[U], b[U], c[U]), min(a[V], b[V], c[V]),
            max(a[U], b[U], c[U]), max(a[V], b[V], c[V]),
        )  # fmt: skip
    box = (np.inf, np.inf, -np.inf, -np.inf)
    box = near_end(view, a, b, box[0], box[1], box[2], box[3])
    box = near_end(view, b, c, box[0], box[1], box[2], box[3])
    box = near_end(view, c, a, box[0], box[1], box[2], box[3])
    return box[0] - SLACK, box[1] - SLACK, box[2] + SLACK, box[3] + SLACK


@scalar
def is_sound(vertex):
    """Return whether a vertex is finite and within LIMIT."""
    return abs(vertex[X]) < LIMIT and abs(vertex[Y]) < LIMIT and abs(vertex[Z]) < LIMIT


@scalar
def box_of(view, double_sided, mirrored, a, b, c, box):
    """Fill `box` with the pixels (x0, y0, x1, y1), end exclusive, that the triangle may cover;
    zeros if it is not drawn."""
    box[0], box[1], box[2], box[3] = 0, 0, 0, 0
    if not (is_sound(a) and is_sound(b) and is_sound(c)):
        return
    if max(a[Z], b[Z], c[Z]) < view.near or min(a[Z], b[Z], c[Z]) > view.far:
        return
    turn = orientation(view, a, b, c)
    if turn == 0.0 or (not double_sided and (turn > 0.0) != (mirrored != 0)):
        return
    nx, ny, nz = facet(a, b, c)
    if not (nx * nx + ny * ny + nz * nz > 0.0):
        return
    low_u, low_v, high_u, high_v = bounds(view, a, b, c)
    x0, y0 = max(low_u, np.float64(view.x0)), max(low_v, np.float64(view.y0))
    x1, y1 = min(high_u, np.float64(view.x1 - 1)), min(high_v, np.float64(view.y1 - 1))
    if x0 <= x1 and y0 <= y1:
        box[0], box[1] = np.int32(math.ceil(x0)), np.int32(math.ceil(y0))
        box[2], box[3] = np.int32(math.floor(x1)) + 1, np.int32(math.floor(y1)) + 1


# --- 2. CPU ----------------------------------------------------------------------------


@block_kernel(over="vertices", writes=("vertices",))
def place(first, last, view, appearances, firsts, matrices, points, vertices):
    """Transform the points of all appearances to camera space and to the screen.

    Args:
        view: One VIEW record, shape (1,).
        appearances: APPEARANCE records, shape (n,).
        firsts: First vertex of each appearance, and their total number, shape (n + 1,) i64.
        matrices: Local to camera, float64, shape (n, 3, 4).
        points: Points of all meshes, f32, shape (p, 3).
        vertices: Receives VERTEX rows, f64.
    """
    eye, i = view[0], first
    while i < last:
        k = find(firsts, i)
        offset = appearances[k].points - firsts[k]
        m = matrices[k]
        stop = min(last, firsts[k + 1])
        for j in range(i, stop):
            place_one(eye, m, points[j + offset], vertices[j])
        i = stop


@block_kernel(over="out", writes=("out",))
def boxes(first, last, view, appearances, firsts, vertex_firsts, vertices, triangles, out):
    """Compute the screen bounds of each triangle of each appearance.

    Args:
        view, appearances, vertices: See `place`.
        firsts: First triangle of each appearance, and their total number, shape (n + 1,) i64.
        vertex_firsts: First vertex of each appearance, and their total number, as `firsts`.
        triangles: Triangles of all meshes, rows of their own points, shape (t, 3) i32.
        out: Receives x0 y0 x1 y1 of each triangle [pixel], end exclusive, i32; zeros where it is
            not drawn.
    """
    eye, i = view[0], first
    while i < last:
        k = find(firsts, i)
        look = appearances[k]
        offset, base = look.rows - firsts[k], vertex_firsts[k]
        stop = min(last, firsts[k + 1])
        for j in range(i, stop):
            corner = triangles[j + offset]
            box_of(
                eye, look.double_sided, look.mirrored, vertices[base + corner[0]],
                vertices[base + corner[1]], vertices[base + corner[2]], out[j],
            )  # fmt: skip
        i = stop
