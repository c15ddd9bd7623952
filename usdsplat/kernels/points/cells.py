"""Points in the order of the cells of a grid that fits them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, F64, I32
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import grid

CHUNK = 1 << 15
"""Rows that a histogram is made of."""
MOST_BITS, LEAST_BITS = 24, 2
"""Of a key, and of an axis."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Cells:
    """n points in cells."""

    inverse: float
    """1 / edge of a cell [1/unit]."""
    bits: tuple[int, int, int]
    """Of the table along x, y, z."""
    start: I32
    """First slot of each cell and, last, n, shape (2^bits + 1,)."""
    order: I32
    """Row of each slot, shape (n,)."""


def into_cells(device: Device, positions: F32, edge: float) -> Cells:
    """Sort points by cell; equal cells keep the order of rows.

    Args:
        device: Where to.
        positions: [unit], shape (n, 3).
        edge: Of a cell [unit], > 0.
    """
    n = len(positions)
    inverse = 1.0 / edge
    bits = _table_bits(extent(device, positions) * inverse, n)
    total = sum(bits)
    entry, moved, rows, order = (device.empty(n, np.int32) for _ in range(4))
    start = device.empty((1 << total) + 1, np.int32)
    device.run(grid.keys, positions, inverse, bits, entry)
    histogram = device.empty((max(1, math.ceil(n / CHUNK)), 1 << grid.TOP_BITS), np.int64)
    device.run(grid.sort_cells, entry, total, histogram, moved, rows, start, order)
    return Cells(inverse=inverse, bits=bits, start=start, order=order)


def extent(device: Device, positions: F32) -> F64:
    """Size of the box about the finite points [unit], shape (3,); zeros where there are none."""
    blocks = math.ceil(len(positions) / grid.BLOCK)
    lower, upper = device.empty((blocks, 3), np.float64), device.empty((blocks, 3), np.float64)
    device.run(grid.bounds, positions, lower, upper)
    size: F64 = upper.max(axis=0, initial=-np.inf) - lower.min(axis=0, initial=np.inf)
    return np.maximum(size, 0.0)


def _table_bits(cells: F64, n: int) -> tuple[int, int, int]:
    """Bits of each axis for a domain of so many cells: a table of at most 2 n where n allows it."""
    most = min(MOST_BITS, max(3 * LEAST_BITS, int(math.log2(max(2 * n, 1)))))
    wanted = np.ceil(np.log2(np.minimum(cells, 2.0**30) + 2.0)).astype(int)
    bits = [max(LEAST_BITS, int(each)) for each in wanted]
    while sum(bits) > most:
        bits[bits.index(max(bits))] -= 1
    return bits[0], bits[1], bits[2]
