"""Tables of 256 numbers that many numbers are written by: the k-means of a line.

Source: Lloyd 1982, "Least squares quantization in PCM", on sorted numbers, where a cell is a range
of rows. Two things differ from it. The cells to begin with come from cutting the costliest in two
until there are enough, so that a few far numbers cannot take the table from the others. And a cell
is written as what lies halfway from its mean to its middle: the greatest error falls by a sixth
where numbers are few, for 2 % of the mean one.
"""

from __future__ import annotations

import heapq
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64
from usdsplat.formats.cloud_builder import in_parallel

SIZE = 256
"""Numbers of a table: their places fit a byte."""

_ROUNDS = 60

Floats = npt.NDArray[np.floating[Any]]


def codebook(values: Floats) -> F64:
    """The table that writes numbers with little error; exact where they are of 256 kinds or fewer.

    Args:
        values: Finite numbers, any shape.

    Returns:
        In ascending order, shape (256,); the last repeats where fewer are enough.
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
    """Places of the numbers of `table` that are nearest, in the shape of `values`."""
    limits = (table[1:] + table[:-1]) / 2
    flat = values.reshape(-1)
    codes = np.empty(len(flat), np.uint8)

    def look_up(rows: slice) -> None:
        codes[rows] = np.searchsorted(limits, flat[rows])

    in_parallel(len(flat), look_up, rows=1 << 18)
    return codes.reshape(values.shape)


def _cuts(ordered: F64) -> npt.NDArray[np.intp]:
    """Edges of at most `SIZE` cells, each cut in the middle of what was the costliest by then."""

    def cell(start: int, stop: int) -> tuple[float, int, int]:
        return -(stop - start) * float(ordered[stop - 1] - ordered[start]) ** 3, start, stop

    heap = [cell(0, len(ordered))]
    while len(heap) < SIZE and heap[0][0] < 0:
        _, start, stop = heapq.heappop(heap)
        middle = ordered[start] / 2 + ordered[stop - 1] / 2
        cut = start + int(np.searchsorted(ordered[start:stop], middle, side="right"))
        cut = min(cut, stop - 1)  # neighbouring floats have no middle
        heapq.heappush(heap, cell(start, cut))
        heapq.heappush(heap, cell(cut, stop))
    return np.array([0, *sorted(stop for _, _, stop in heap)])


def _centres(ordered: F64, sums: F64, edges: npt.NDArray[np.intp]) -> F64:
    """What each cell is written as; the number itself where it has only one kind."""
    least, most = ordered[edges[:-1]], ordered[edges[1:] - 1]
    means = np.clip(np.diff(sums[edges]) / np.diff(edges), least, most)
    return np.clip(means / 2 + (least / 4 + most / 4), least, most)
