"""Find coincident points by sorting.

A search for the nearest points would visit all coincident points for each of them.
"""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32, I64

_FACTOR = np.uint64(0x9E3779B97F4A7C15)


def coincident(points: F32) -> tuple[I64, I64]:
    """Return an order in which coincident points are adjacent.

    Args:
        points: Finite, shape (n, 3).

    Returns:
        Rows in that order, ascending among coincident points; and for each point the number of
        coincident points before it. Both have shape (n,).
    """
    sound = points + np.float32(0)  # maps -0 to 0
    bits = np.ascontiguousarray(sound).view(np.uint32).astype(np.uint64)
    key = ((bits[:, 0] * _FACTOR + bits[:, 1]) * _FACTOR + bits[:, 2]) * _FACTOR
    order = np.argsort(key, kind="stable")
    ranks = np.arange(len(points))
    if len(points):
        placed = sound[order]
        first = np.concatenate([[True], (placed[1:] != placed[:-1]).any(axis=1)])
        ranks -= np.maximum.accumulate(np.where(first, ranks, 0))
    return order, ranks
