"""Initial patterns: random numbers by point, and patches of noise."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import scalar, serial
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.sim.philox import SEEDS, uniforms

HALF_RANGE = 1 << 20
"""Lattice corners of the noise on either side of the origin, after which it repeats."""


# --- 1. mathematics: one point ----------------------------------------------------------


@scalar
def corner(seed, x, y, z):
    """Return the value at a corner of the lattice, 0 to 1."""
    mask = 2 * HALF_RANGE - 1
    identity = (((z & mask) << 42) | ((y & mask) << 21)) | (x & mask)
    return uniforms(seed, SEEDS, identity, 0, 1)[0]


@scalar
def eased(t):
    """Return a smooth step from 0 to 1."""
    return t * t * (np.float32(3) - np.float32(2) * t)


@scalar
def mixed(a, b, t):
    """Interpolate linearly between two values."""
    return a + t * (b - a)


# --- 2. loops ---------------------------------------------------------------------------


@kernel(over="ids", writes=("out",))
def draw(i, ids, seed, out):
    """Draw a number in [0, 1) for each id. ids: int64 (n,). out: float32 (n,), receives numbers."""
    out[i] = uniforms(seed, SEEDS, ids[i], 0, 0)[0]


@kernel(over="positions", writes=("out",))
def noise(i, positions, seed, size, out):
    """Compute value noise: smooth, 0 to 1, with patches of diameter `size`.

    positions: float32 (n, 3), finite. size: float64. out: float32 (n,), receives noise.
    """
    px, py, pz = positions[i, 0] / size, positions[i, 1] / size, positions[i, 2] / size
    x = np.int64(math.floor(px))  # floor returns float64 on a GPU
    y, z = np.int64(math.floor(py)), np.int64(math.floor(pz))
    tx = eased(np.float32(px - x))
    ty = eased(np.float32(py - y))
    tz = eased(np.float32(pz - z))
    low = high = np.float32(0)
    for k in range(2):
        near = mixed(corner(seed, x, y, z + k), corner(seed, x + 1, y, z + k), tx)
        far = mixed(corner(seed, x, y + 1, z + k), corner(seed, x + 1, y + 1, z + k), tx)
        low, high = high, mixed(near, far, ty)
    out[i] = mixed(low, high, tz)


@serial(writes=("queue", "label"))
def parts(rows, neighbors, queue, label):
    """Label the connected parts of a graph, and return their number.

    rows: int64 (n + 1,). neighbors: int32; the relation must be symmetric. queue: int32 (n,),
    scratch. label: int32 (n,), initially -1, receives labels.
    """
    count = 0
    for first in range(len(label)):
        if label[first] >= 0:
            continue
        label[first] = count
        queue[0] = first
        done, end = 0, 1
        while done < end:
            s = queue[done]
            done += 1
            for e in range(rows[s], rows[s + 1]):
                j = neighbors[e]
                if label[j] < 0:
                    label[j] = count
                    queue[end] = j
                    end += 1
        count += 1
    return count
