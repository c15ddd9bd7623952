"""Normals of the points of a graph, and consistent orientation of them.

Source: Hoppe et al. 1992, "Surface reconstruction from unorganized points", for planes of
neighbours and signs that spread along a graph.
"""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.jit import serial
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.normals.axes import least_axis

from .grid import squared_distance
from .support import falloff

# --- 1. CPU -----------------------------------------------------------------------------


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
