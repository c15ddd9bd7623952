"""Quantise numbers with a table of 256 entries: k-means in one dimension.

Source: Lloyd 1982, "Least squares quantization in PCM", on sorted numbers, where a cell is a range
of rows. This module differs in two points. The initial cells come from splitting the cell with the
largest cost until there are enough, so that a few outliers cannot take entries from the rest. The
value of a cell lies halfway between its mean and its midpoint: that reduces the largest error by a
sixth where numbers are few, and raises the mean error by 2 %.
"""

from __future__ import annotations

import heapq
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.formats.cloud_builder import in_parallel

SIZE = 256
"""Number of entries of a table: indices fit a byte."""

_ROUNDS = 60

Floats = npt.NDArray[np.floating[Any]]


def codebook(values: Floats) -> F64:
    """Return a table that quantises numbers with little error; exact for up to 256 distinct ones.

    Args:
        values: Finite numbers, any shape.

    Returns:
        Entries in ascending order, shape (256,); the last is repeated if fewer suffice.
    """
    ordered = np.sort(values, axis=None).astype(np.float64)
    if not len(ordered):
        return np.zeros(SIZE)
    sums = np.concatenate([[0.0], np.cumsum(ordered)])
    edges = _cuts(ordered)
    centres = _centres(ordered, sums, edges)
    for _ in range(_ROUNDS):
        inner = np.searchsorted(ordered, (centres[1:] + centres[:-1]) / 2)
        moved = np.unique(np.concatenate([[0], inner, [len(ordered)]]))
        if np.array_equal(moved, edges):
            break
        edges = moved
        centres = _centres(ordered, sums, edges)
    return np.concatenate([centres, np.full(SIZE - len(centres), centres[-1])])


def encode(values: Floats, table: F64) -> npt.NDArray[np.uint8]:
    """Return the indices of the nearest entries of `table`, in the shape of `values`."""
    limits = (table[1:] + table[:-1]) / 2
    flat = values.reshape(-1)
    codes = np.empty(len(flat), np.uint8)

    def look_up(rows: slice) -> None:
        codes[rows] = np.searchsorted(limits, flat[rows])

    in_parallel(len(flat), look_up, rows=1 << 18)
    return codes.reshape(values.shape)


def _cuts(ordered: F64) -> npt.NDArray[np.intp]:
    """Return the edges of at most `SIZE` cells, by repeatedly halving the cell of largest cost."""

    def cell(start: int, stop: int) -> tuple[float, int, int]:
        return -(stop - start) * float(ordered[stop - 1] - ordered[start]) ** 3, start, stop

    heap = [cell(0, len(ordered))]
    while len(heap) < SIZE and heap[0][0] < 0:
        _, start, stop = heapq.heappop(heap)
        middle = ordered[start] / 2 + ordered[stop - 1] / 2
        cut = start + int(np.searchsorted(ordered[start:stop], middle, side="right"))
        cut = min(cut, stop - 1)  # adjacent floats have no midpoint
        heapq.heappush(heap, cell(start, cut))
        heapq.heappush(heap, cell(cut, stop))
    return np.array([0, *sorted(stop for _, _, stop in heap)])


def _centres(ordered: F64, sums: F64, edges: npt.NDArray[np.intp]) -> F64:
    """Return the value of each cell; exact if all its numbers are equal."""
    least, most = ordered[edges[:-1]], ordered[edges[1:] - 1]
    means = np.clip(np.diff(sums[edges]) / np.diff(edges), least, most)
    return np.clip(means / 2 + (least / 4 + most / 4), least, most)
