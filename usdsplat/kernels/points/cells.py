"""Sort points by the cells of a grid that fits them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import grid

CHUNK = 1 << 15
"""Number of rows per histogram."""
MOST_BITS, LEAST_BITS = 24, 2
"""Maximum bits of a key, minimum bits of an axis."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Cells:
    """n points sorted by cells. Arrays belong to the device."""

    inverse: float
    """1 / edge of a cell [1/unit]."""
    bits: tuple[int, int, int]
    """Bits of the table along x, y and z."""
    start: Any
    """First slot of each cell and, last, n, int32 (2^bits + 1,)."""
    order: Any
    """Row of each slot, int32 (n,)."""


def into_cells(device: Device, positions: Any, edge: float) -> Cells:
    """Sort points by cell; equal cells keep the order of rows.

    Args:
        device: Runs the kernels and holds the result.
        positions: [unit], float32 (n, 3), on the host or the device.
        edge: Edge of a cell [unit], > 0.
    """
    n = positions.shape[0]
    inverse = 1.0 / edge
    place = device.move(positions) if isinstance(positions, np.ndarray) else positions
    bits = _table_bits(extent(device, place) * inverse, n)
    total = sum(bits)
    entry, moved, rows, order = (device.resident(n, np.int32) for _ in range(4))
    start = device.resident((1 << total) + 1, np.int32)
    device.run(grid.keys, place, inverse, bits, entry)
    histogram = device.resident((max(1, math.ceil(n / CHUNK)), 1 << grid.TOP_BITS), np.int64)
    device.run(grid.sort_cells, entry, total, histogram, moved, rows, start, order)
    return Cells(inverse=inverse, bits=bits, start=start, order=order)


def extent(device: Device, positions: Any) -> F64:
    """Return the size of the box around the finite points [unit], shape (3,); zeros if there are
    none.

    positions: float32 (n, 3), on the host or the device.
    """
    blocks = math.ceil(positions.shape[0] / grid.BLOCK)
    lower, upper = device.empty((blocks, 3), np.float64), device.empty((blocks, 3), np.float64)
    device.run(grid.bounds, positions, lower, upper)
    size: F64 = upper.max(axis=0, initial=-np.inf) - lower.min(axis=0, initial=np.inf)
    return np.maximum(size, 0.0)


def _table_bits(cells: F64, n: int) -> tuple[int, int, int]:
    """Return the bits of each axis for a number of cells: a table of at most 2 n entries if n
    allows it."""
    most = min(MOST_BITS, max(3 * LEAST_BITS, int(math.log2(max(2 * n, 1)))))
    wanted = np.ceil(np.log2(np.minimum(cells, 2.0**30) + 2.0)).astype(int)
    bits = [max(LEAST_BITS, int(each)) for each in wanted]
    while sum(bits) > most:
        bits[bits.index(max(bits))] -= 1
    return bits[0], bits[1], bits[2]
