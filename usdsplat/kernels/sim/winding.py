"""Generalized winding number of a surface around points: 1 inside a closed surface, 0 outside.

With holes, it is between 0 and 1. Comparing it with one half separates inside from outside without
a watertight mesh. A distant run of triangles is approximated by a dipole, its area vector at its
centre; for near triangles the solid angles are summed.

Sources: Jacobson, Kavan & Sorkine-Hornung 2013, "Robust Inside-Outside Segmentation using
Generalized Winding Numbers"; Barill et al. 2018, "Fast Winding Numbers for Soups and Clouds"; Van
Oosterom & Strackee 1983, "The Solid Angle of a Plane Triangle".
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import exact, serial
from ..launch import kernel

MOMENTS = 7
"""Columns of a node's dipole: area vector, centre, radius."""


# --- 1. mathematics: one triangle, one dipole -------------------------------------------


@exact
def solid_angle(ax, ay, az, bx, by, bz, cx, cy, cz):
    """Return the solid angle [sr] of a triangle from the origin, positive from behind; 0 in its
    plane."""
    a = math.sqrt(ax * ax + ay * ay + az * az)
    b = math.sqrt(bx * bx + by * by + bz * bz)
    c = math.sqrt(cx * cx + cy * cy + cz * cz)
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    ab, bc = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz
    ca = cx * ax + cy * ay + cz * az
    below = a * b * c + ab * c + bc * a + ca * b
    return 2.0 * math.atan2(volume, below) if volume != 0.0 else 0.0


@exact
def dipole(nx, ny, nz, x, y, z):
    """Return the solid angle [sr] of a distant area vector at (x, y, z), from the origin."""
    square = x * x + y * y + z * z
    return (nx * x + ny * y + nz * z) / (square * math.sqrt(square))


# --- 2. CPU ----------------------------------------------------------------------------


@serial(writes=("moments",))
def fit_dipoles(corners, moments):
    """Compute the dipole of each node.

    Args:
        corners: Corners of the triangles in the tree's order, shape (t, 9) f32.
        moments: Receives a dipole for each row of the tree, shape (2 * leaves, MOMENTS) f64.
    """
    leaves, t = moments.shape[0] // 2, corners.shape[0]
    for row in range(2 * leaves - 1, 0, -1):
        level = 0
        while row >> (level + 1) > 0:
            level += 1
        i = row - (1 << level)
        first, end = i * t >> level, (i + 1) * t >> level
        m = moments[row]
        m[:] = 0.0
        total = 0.0
        if row >= leaves:
            for k in range(first, end):
                c = corners[k]
                ux, uy, uz = (
                    np.float64(c[3]) - c[0], np.float64(c[4]) - c[1], np.float64(c[5]) - c[2]
                )  # fmt: skip
                vx, vy, vz = (
                    np.float64(c[6]) - c[0], np.float64(c[7]) - c[1], np.float64(c[8]) - c[2]
                )  # fmt: skip
                nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
                area = 0.5 * math.sqrt(nx * nx + ny * ny + nz * nz)
                m[0] += 0.5 * nx
                m[1] += 0.5 * ny
                m[2] += 0.5 * nz
                for a in range(3):
                    m[3 + a] += area * (np.float64(c[a]) + c[a + 3] + c[a + 6]) / 3.0
                total += area
            m[6] = total
        else:  # the column of the radius contains the area until all centres are known
            for child in (2 * row, 2 * row + 1):
                for a in range(3):
                    m[a] += moments[child, a]
                    m[3 + a] += moments[child, 3 + a] * moments[child, 6]
                m[6] += moments[child, 6]
            total = m[6]
        for a in range(3):
            m[3 + a] = m[3 + a] / total if total > 0.0 else np.float64(corners[first, a])
    for row in range(2 * leaves - 1, 0, -1):
        m = moments[row]
        square = 0.0
        if row >= leaves:
            leaf = row - leaves
            for k in range(leaf * t // leaves, (leaf + 1) * t // leaves):
                for c in range(0, 9, 3):
                    dx, dy, dz = (
                        corners[k, c] - m[3], corners[k, c + 1] - m[4], corners[k, c + 2] - m[5]
                    )  # fmt: skip
                    square = max(square, dx * dx + dy * dy + dz * dz)
            m[6] = math.sqrt(square)
        else:
            m[6] = 0.0
            for child in (2 * row, 2 * row + 1):
                dx, dy, dz = (
                    moments[child, 3] - m[3], moments[child, 4] - m[4], moments[child, 5] - m[5]
                )  # fmt: skip
                reach = math.sqrt(dx * dx + dy * dy + dz * dz) + moments[child, 6]
                m[6] = max(m[6], reach)


@kernel(over="points", writes=("out",))
def sum_winding(i, points, corners, moments, far, out):
    """Compute the winding number of a surface around each point.

    Args:
        points: Shape (n, 3) f32.
        corners, moments: See `fit_dipoles`.
        far: A node is approximated by its dipole if its distance is more than this many of its
            radii; inf sums all triangles.
        out: Receives winding numbers, shape (n,) f32.
    """
    t, leaves = corners.shape[0], moments.shape[0] // 2
    x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
    row, total = 1, 0.0
    while row > 0:
        dx, dy, dz = moments[row, 3] - x, moments[row, 4] - y, moments[row, 5] - z
        reach = far * moments[row, 6]
        is_end = True
        if dx * dx + dy * dy + dz * dz > reach * reach:
            total += dipole(moments[row, 0], moments[row, 1], moments[row, 2], dx, dy, dz)
        elif row >= leaves:
            leaf = row - leaves
            for k in range(leaf * t // leaves, (leaf + 1) * t // leaves):
                total += solid_angle(
                    corners[k, 0] - x, corners[k, 1] - y, corners[k, 2] - z,
                    corners[k, 3] - x, corners[k, 4] - y, corners[k, 5] - z,
                    corners[k, 6] - x, corners[k, 7] - y, corners[k, 8] - z,
                )  # fmt: skip
        else:
            row, is_end = 2 * row, False
        if is_end:
            while row & 1 == 1:
                row >>= 1
            row += 1 if row > 0 else 0
    out[i] = np.float32(total / (4.0 * math.pi))
