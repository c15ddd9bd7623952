"""The Z-order curve: an order of points in which those that are close in space stay close.

Files compress better in it, and blocks of neighbours have tight bounds. Source: Morton 1966.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32

BITS = 20
"""Of each axis, with one spare for the shift."""

_GRID = (1 << BITS) - 1


def codes(positions: F32, *, shift: float = 0.0) -> npt.NDArray[np.uint64]:
    """Codes of the points' cells in a cube around them, 20 bits an axis.

    Args:
        positions: Finite points, shape (n, 3).
        shift: Moves the grid by this part of half the cube [0..1]: neighbours that one grid parts,
            another keeps together.

    Returns:
        Shape (n,).
    """
    points = positions.astype(np.float64)
    lower = points.min(axis=0, initial=np.inf)
    extent = float(np.max(points - lower, initial=0.0)) or 1.0
    cells = ((points - lower) / extent * 0.5 + 0.5 * shift) * _GRID
    spread = cells.astype(np.uint64)
    for width, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        spread = (spread | (spread << np.uint64(width))) & np.uint64(mask)
    return spread[:, 0] | (spread[:, 1] << np.uint64(1)) | (spread[:, 2] << np.uint64(2))


def order(positions: F32) -> npt.NDArray[np.intp]:
    """Rows along the curve, shape (n,); rows of one cell keep their order."""
    return np.argsort(codes(positions), kind="stable")
