"""Compute codes of splats along the Z-order curve, in which blocks contain neighbours.

`sort.depth_order` can sort the codes, because a code has the bits of a non-negative float. Source:
Morton 1966.
"""

from __future__ import annotations

import numpy as np

from .jit import scalar
from .launch import kernel

CELLS = 1 << 10
"""Number of cells along each axis."""


# --- 1. mathematics: one axis of one splat ----------------------------------------------


@scalar
def spread(cell):
    """Return the bits of a number below CELLS with two zero bits after each, u32."""
    x = np.uint32(cell)
    x = np.uint32((x | (x << np.uint32(16))) & np.uint32(0x030000FF))
    x = np.uint32((x | (x << np.uint32(8))) & np.uint32(0x0300F00F))
    x = np.uint32((x | (x << np.uint32(4))) & np.uint32(0x030C30C3))
    return np.uint32((x | (x << np.uint32(2))) & np.uint32(0x09249249))


@scalar
def cell_of(x, low, scale):
    """Return the cell of a coordinate. Points outside of the box, or not finite, are in a cell at
    its edge."""
    cell = (np.float64(x) - low) * scale
    most = np.float64(CELLS - 1)
    return np.int32(min(cell, most)) if cell > 0.0 else np.int32(0)


# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="positions", writes=("out",))
def codes(i, positions, low, scale, out):
    """Compute the codes of the cells of splats.

    Args:
        positions: Shape (n, 3).
        low: Lowest corner of the box that the cells fill, shape (3,) f64.
        scale: Cells per scene unit along each axis, shape (3,) f64.
        out: Receives codes, shape (n,) u32, below 2**30.
    """
    x = spread(cell_of(positions[i, 0], low[0], scale[0]))
    y = spread(cell_of(positions[i, 1], low[1], scale[1]))
    z = spread(cell_of(positions[i, 2], low[2], scale[2]))
    out[i] = np.uint32(x | (y << np.uint32(1)) | (z << np.uint32(2)))
