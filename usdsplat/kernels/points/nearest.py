"""Find the nearest points of a point."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F32, I32
from usdsplat.kernels.device import Device
from usdsplat.kernels.points.cells import extent, into_cells
from usdsplat.kernels.sim import nearest as kernels

LEAF = 8
"""Approximate number of points of a leaf."""


def nearest(device: Device, points: F32, queries: F32, k: int) -> tuple[I32, F32]:
    """Return the k points nearest to each query; of equally near ones, those with the lowest index.

    Args:
        device: Runs the kernels.
        points: [unit], shape (n, 3), with any distribution; points that are not finite are never
            found.
        queries: [unit], shape (m, 3). A query that is one of the points finds itself first.
        k: Number of points to find for each query, >= 1.

    Returns:
        Rows of `points`, nearest first, shape (m, k), and distances [unit], shape (m, k); -1 and
        inf if there are fewer points, or if the query is not finite.
    """
    index = np.flatnonzero(np.isfinite(points).all(axis=1)).astype(np.int32)
    tree = np.ascontiguousarray(points[index], dtype=np.float32)
    queries = np.ascontiguousarray(queries, dtype=np.float32)
    levels = max(0, math.ceil(math.log2(max(len(index), 1) / LEAF)))
    boxes = np.zeros((2 << levels, 6), np.float32)
    if len(index):
        device.run(kernels.plant, tree, index, levels, boxes)
    m = len(queries)
    indices, distances = device.empty(m * k, np.int32), device.empty(m * k, np.float32)
    asked = device.move(queries)
    edge = float(extent(device, asked).max()) / max(1.0, math.sqrt(m)) or 1.0
    order = into_cells(device, asked, edge).order
    device.run(kernels.nearest, tree, index, levels, boxes, asked, order, k, indices, distances)
    return indices.reshape(m, k), np.sqrt(distances, out=distances).reshape(m, k)
