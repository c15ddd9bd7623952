"""Sort points along the Z-order curve, in which runs of points are near to each other."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32, F64, I32
from usdsplat.kernels import curve, sort
from usdsplat.kernels.device import Device

STRAY = 0.004
"""Fraction of the points, at either end of each axis, that share the cells at the edge."""
FEW = 20_000
"""About how many points are sampled to find the bounds of most of them."""


def curve_order(device: Device, positions: F32) -> I32:
    """Return the rows of points, shape (n, 3), in Z-order. Rows in one cell keep their order."""
    n = len(positions)
    low, scale = _cells(positions)
    codes = np.empty(n, np.uint32)
    device.run(curve.codes, device.upload(positions), low, scale, codes)
    chunks = 4 * device.threads
    work = np.empty((2, n), np.uint32), np.empty((2, n), np.int32)
    half = device.run(
        sort.depth_order, np.arange(n, dtype=np.int32), n, codes.view(np.float32), chunks, work,
        np.empty((chunks, sort.DIGITS), np.int64),
    )  # fmt: skip
    return np.array(work[1][half])


def _cells(positions: F32) -> tuple[F64, F64]:
    """Return the lowest corner of the cells, and the number of cells per scene unit along each
    axis."""
    few = positions[:: max(1, len(positions) // FEW)]
    few = few[np.isfinite(few).all(axis=1)]
    if len(few) == 0:
        return np.zeros(3), np.zeros(3)
    low, high = np.quantile(few.astype(np.float64), (STRAY, 1 - STRAY), axis=0)
    return low, curve.CELLS / np.maximum(high - low, np.finfo(np.float32).tiny)
