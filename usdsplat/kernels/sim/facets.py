"""Measures of a mesh's triangles (frame, size), and smooth normals of their corners, except at
creases.

Source: Thürmer & Wüthrich 1998, "Computing Vertex Normals from Polygonal Facets" (weights by
angle).
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import exact, scalar
from ..launch import kernel

SMOOTH, CREASE = math.cos(math.radians(30)), math.cos(math.radians(60))
"""Triangles that meet at up to 30 degrees share a normal, those that meet at 60 degrees or more do
not. Between, they share it in part, so that normals do not jump when a mesh bends."""


# --- 1. mathematics: one triangle -------------------------------------------------------


@exact
def unit(x, y, z):
    """Normalize a vector; zeros stay."""
    length = math.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length) if length > 0.0 else (0.0, 0.0, 0.0)


@exact
def angle(ax, ay, az, bx, by, bz):
    """Return the angle between two unit vectors [rad], accurate for small angles too."""
    dx, dy, dz, sx, sy, sz = ax - bx, ay - by, az - bz, ax + bx, ay + by, az + bz
    apart, along = dx * dx + dy * dy + dz * dz, sx * sx + sy * sy + sz * sz
    return 2.0 * math.atan2(math.sqrt(apart), math.sqrt(along))


@exact
def turn_to(xx, xy, xz, zx, zy, zz):
    """Return the unit quaternion (w, x, y, z) that rotates the axes x and z to two perpendicular
    unit vectors.

    Source: Shepperd 1978, "Quaternion from Rotation Matrix".
    """
    yx, yy, yz = zy * xz - zz * xy, zz * xx - zx * xz, zx * xy - zy * xx
    trace = xx + yy + zz
    if trace >= max(xx, yy, zz):
        w, x, y, z = 1.0 + trace, yz - zy, zx - xz, xy - yx
    elif xx >= yy and xx >= zz:
        w, x, y, z = yz - zy, 1.0 + xx - yy - zz, xy + yx, xz + zx
    elif yy >= zz:
        w, x, y, z = zx - xz, xy + yx, 1.0 + yy - xx - zz, yz + zy
    else:
        w, x, y, z = xy - yx, xz + zx, yz + zy, 1.0 + zz - xx - yy
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return w / length, x / length, y / length, z / length


@scalar
def share(cosine):
    """Return how far two triangles share a normal, 0 to 1, by the cosine between their normals."""
    s = min(max((cosine - CREASE) / (SMOOTH - CREASE), 0.0), 1.0)
    return s * s * (3.0 - 2.0 * s)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="triangles", writes=("normals", "angles", "frames", "sizes"))
def measure(i, points, triangles, normals, angles, frames, sizes):
    """Measure each triangle.

    Args:
        points, triangles: The mesh, shape (p, 3) f32, (t, 3) i32.
        normals: Receives unit normals, zeros for triangles without area, shape (t, 3) f32.
        angles: Receives the angles at the corners [rad], shape (t, 3) f32.
        frames: Receives unit quaternions: x along the first edge, z along the normal, shape (t, 4)
            f32; the identity for triangles without area.
        sizes: Receives square roots of areas, shape (t,) f32.
    """
    a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
    ux, uy, uz = (
        np.float64(points[b, 0]) - points[a, 0], np.float64(points[b, 1]) - points[a, 1],
        np.float64(points[b, 2]) - points[a, 2],
    )  # fmt: skip
    vx, vy, vz = (
        np.float64(points[c, 0]) - points[a, 0], np.float64(points[c, 1]) - points[a, 1],
        np.float64(points[c, 2]) - points[a, 2],
    )  # fmt: skip
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    sizes[i] = math.sqrt(0.5 * math.sqrt(nx * nx + ny * ny + nz * nz))
    nx, ny, nz = unit(nx, ny, nz)
    normals[i, 0], normals[i, 1], normals[i, 2] = nx, ny, nz
    wx, wy, wz = unit(vx - ux, vy - uy, vz - uz)
    ux, uy, uz = unit(ux, uy, uz)
    vx, vy, vz = unit(vx, vy, vz)
    angles[i, 0] = angle(ux, uy, uz, vx, vy, vz)
    angles[i, 1] = angle(-ux, -uy, -uz, wx, wy, wz)
    angles[i, 2] = angle(vx, vy, vz, wx, wy, wz)
    w, x, y, z = 1.0, 0.0, 0.0, 0.0
    if sizes[i] > 0:
        w, x, y, z = turn_to(ux, uy, uz, nx, ny, nz)
    frames[i, 0], frames[i, 1], frames[i, 2], frames[i, 3] = w, x, y, z


@kernel(over="triangles", writes=("out",))
def smooth(i, triangles, starts, corners, normals, angles, out):
    """Compute the mean normal at each corner, over adjacent triangles with similar normals.

    Args:
        triangles: Shape (t, 3) i32.
        starts, corners: The corners at point p are `corners[starts[p]:starts[p + 1]]`, as 3 * row
            of the triangle + index of the corner, shape (p + 1,) i64, (3 * t,) i32.
        normals, angles: See `measure`.
        out: Receives sums, not normalized, shape (t, 3, 3) f32.
    """
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    for c in range(3):
        x, y, z, point = 0.0, 0.0, 0.0, triangles[i, c]
        for k in range(starts[point], starts[point + 1]):
            other, which = corners[k] // 3, corners[k] % 3
            mx, my, mz = normals[other, 0], normals[other, 1], normals[other, 2]
            weight = angles[other, which] * share(nx * mx + ny * my + nz * mz)
            x += weight * mx
            y += weight * my
            z += weight * mz
        x, y, z = unit(x, y, z)
        out[i, c, 0], out[i, c, 1], out[i, c, 2] = x, y, z
