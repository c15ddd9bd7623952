"""Morton order (Z-order curve): an order in which points close in space stay close.

Files compress better in this order, and blocks of neighbours have tight bounds.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64

BITS = 20
"""Bits per axis; one more is reserved for the shift."""
KEY_BITS = 21
"""Bits per axis of `keys`."""

_GRID = (1 << BITS) - 1


def codes(positions: F32, *, shift: float = 0.0) -> npt.NDArray[np.uint64]:
    """Return Morton codes of the points in their bounding cube, 20 bits an axis.

    Args:
        positions: Finite points, shape (n, 3).
        shift: Offset of the grid as a fraction of half the cube [0..1]: neighbours that one grid
            separates stay together in another.

    Returns:
        Codes, shape (n,).
    """
    points = positions.astype(np.float64)
    lower = points.min(axis=0, initial=np.inf)
    extent = float(np.max(points - lower, initial=0.0)) or 1.0
    cells = ((points - lower) / extent * 0.5 + 0.5 * shift) * _GRID
    return _interleaved(cells.astype(np.uint64))


def keys(positions: F32, low: F64, edge: float) -> npt.NDArray[np.uint64]:
    """Return Morton codes of points in a given cube, 21 bits an axis.

    Args:
        positions: Finite points, shape (n, 3); those outside the cube count as on its surface.
        low: Lower corner of the cube, shape (3,).
        edge: Edge of the cube, > 0.

    Returns:
        Codes below 2^63, shape (n,).
    """
    cells = (positions - low) / edge * float(1 << KEY_BITS)
    return _interleaved(np.clip(cells, 0, (1 << KEY_BITS) - 1, out=cells).astype(np.uint64))


def order(positions: F32) -> npt.NDArray[np.intp]:
    """Return rows in Morton order, shape (n,); rows of equal code keep their order."""
    return np.argsort(codes(positions), kind="stable")


def _interleaved(cells: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    """Return the bits of cells in three columns as one number, x lowest; up to 21 bits each."""
    spread = cells
    for width, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        spread = (spread | (spread << np.uint64(width))) & np.uint64(mask)
    return spread[:, 0] | (spread[:, 1] << np.uint64(1)) | (spread[:, 2] << np.uint64(2))
