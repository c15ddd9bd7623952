"""Normals of splats, and consistent orientation of them.

Source: Hoppe et al. 1992, "Surface reconstruction from unorganized points", for planes of
neighbours and signs that spread along a graph; Smith 1961, "Eigenvalues of a symmetric 3x3 matrix".
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar, serial
from usdsplat.kernels.launch import kernel

from .grid import squared_distance
from .support import falloff

DOUBLE = 1e-12
"""Two eigenvalues count as equal if their difference, relative to the spread, is below the square
root of this. The formula has half of float64's digits there."""

# --- 1. mathematics ---------------------------------------------------------------------


@scalar
def column(w, x, y, z, axis):
    """Return a column of the rotation matrix of a unit quaternion."""
    if axis == 0:
        return 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
    if axis == 1:
        return 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)
    return 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)


@scalar
def cross(ax, ay, az, bx, by, bz):
    """Return a x b and its squared length."""
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return x, y, z, x * x + y * y + z * z


@scalar
def least_axis(xx, xy, xz, yy, yz, zz):
    """Return the two smallest eigenvalues of a symmetric matrix and the unit eigenvector of the
    smallest.

    All are float64. The eigenvector is (0, 0, 0) if it is not unique.
    """
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    spread = math.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    if not spread > 1e-12 * mean:
        return mean, mean, 0.0, 0.0, 0.0
    det = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    angle = math.acos(min(max(det / (2 * spread * spread * spread), -1.0), 1.0)) / 3
    least = mean + 2 * spread * math.cos(angle + 2 * math.pi / 3)
    most = mean + 2 * spread * math.cos(angle)
    middle = 3 * mean - least - most
    a, b, c = xx - least, yy - least, zz - least
    x, y, z, best = cross(a, xy, xz, xy, b, yz)
    u, v, w, size = cross(a, xy, xz, xz, yz, c)
    if size > best:
        x, y, z, best = u, v, w, size
    u, v, w, size = cross(xy, b, yz, xz, yz, c)
    if size > best:
        x, y, z, best = u, v, w, size
    if not best > DOUBLE * spread * spread * spread * spread:
        return least, middle, 0.0, 0.0, 0.0
    size = 1 / math.sqrt(best)
    return least, middle, x * size, y * size, z * size


# --- 2. CPU -----------------------------------------------------------------------------


@kernel(over="scales", writes=("out",))
def thin_axes(i, rotations, scales, out):
    """Compute the axis along which each splat is thinnest.

    Args:
        rotations: Unit quaternions, (n, 4) f32.
        scales: (n, 3) f32.
        out: Receives unit vectors, (n, 3) f32.
    """
    axis = 0
    for a in range(1, 3):
        if scales[i, a] < scales[i, axis]:
            axis = a
    out[i, 0], out[i, 1], out[i, 2] = column(
        rotations[i, 0], rotations[i, 1], rotations[i, 2], rotations[i, 3], axis
    )


@kernel(over="positions", writes=("out", "surfaceness"))
def planes(s, positions, support, order, rows, neighbors, before, out, surfaceness):
    """Compute the normals of planes through neighbours.

    Args:
        positions, support, order, rows, neighbors: Those of a graph.
        before: Earlier normals, (n, 3) f32 by row. Their sign is kept, and they are kept where no
            plane is defined.
        out: Receives the normal of each row, (n, 3) f32.
        surfaceness: Receives 1 - l0 / l1 of the two smallest eigenvalues, (n,) f32 by row: 1 on a
            sheet, 0 if neighbours are on all sides.
    """
    i = order[s]
    px, py, pz = before[i, 0], before[i, 1], before[i, 2]
    out[i, 0], out[i, 1], out[i, 2] = px, py, pz
    surfaceness[i] = 0
    if not support[s] > 0:
        return
    inverse = np.float32(1) / support[s]
    x0, y0, z0 = positions[s, 0], positions[s, 1], positions[s, 2]
    total, sx, sy, sz = 1.0, 0.0, 0.0, 0.0
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for e in range(rows[s], rows[s + 1]):
        j = neighbors[e]
        x, y, z = positions[j, 0], positions[j, 1], positions[j, 2]
        d2 = squared_distance(x0, y0, z0, x, y, z)
        w = np.float64(falloff(d2 * inverse * inverse))
        dx = np.float64((x - x0) * inverse)
        dy = np.float64((y - y0) * inverse)
        dz = np.float64((z - z0) * inverse)
        total += w
        sx, sy, sz = sx + w * dx, sy + w * dy, sz + w * dz
        xx, xy, xz = xx + w * dx * dx, xy + w * dx * dy, xz + w * dx * dz
        yy, yz, zz = yy + w * dy * dy, yz + w * dy * dz, zz + w * dz * dz
    sx, sy, sz = sx / total, sy / total, sz / total
    least, middle, x, y, z = least_axis(
        xx / total - sx * sx, xy / total - sx * sy, xz / total - sx * sz,
        yy / total - sy * sy, yz / total - sy * sz, zz / total - sz * sz,
    )  # fmt: skip
    if x * x + y * y + z * z > 0:
        surfaceness[i] = 1 - max(least, 0.0) / middle
        sign = -1.0 if x * px + y * py + z * pz < 0 else 1.0
        out[i, 0], out[i, 1], out[i, 2] = sign * x, sign * y, sign * z


@serial(writes=("normals", "queue", "state"))
def orient(normals, rows, neighbors, seeds, outward, queue, state):
    """Orient the normals of each connected part to the same side.

    Starts from the outermost splat, breadth first. Each splat takes the side of the majority of its
    oriented neighbours, weighted by the cosine between the normals.

    Args:
        normals: Normals of each slot, (n, 3) f32, flipped in place.
        rows, neighbors: Those of a graph.
        seeds: Slots, in the order in which they may start a part, (n,).
        outward: Directions for the first normal of each part, (n, 3) f32 by slot.
        queue: Scratch, (n,) i32.
        state: Initially zeros, (n,) u8: 1 is waiting, 2 is oriented.
    """
    for seed in seeds:
        if state[seed] != 0:
            continue
        queue[0], state[seed] = seed, 1
        head, tail = 0, 1
        while head < tail:
            s = queue[head]
            x, y, z = normals[s, 0], normals[s, 1], normals[s, 2]
            vote = 0.0
            if head == 0:
                vote = x * outward[s, 0] + y * outward[s, 1] + z * outward[s, 2]
            for e in range(rows[s], rows[s + 1]):
                j = neighbors[e]
                if state[j] == 2:
                    vote += x * normals[j, 0] + y * normals[j, 1] + z * normals[j, 2]
                elif state[j] == 0:
                    state[j] = 1
                    queue[tail] = j
                    tail += 1
            if vote < 0:
                normals[s, 0], normals[s, 1], normals[s, 2] = -x, -y, -z
            state[s] = 2
            head += 1
