"""Loops as kernels have them, for tests of what becomes of such loops."""

from __future__ import annotations

import numpy as np
from numba import prange

from usdsplat.kernels.jit import parallel, serial

BLOCK = 4
ROOM = 1 << 12


@parallel
def doubled(values, out):
    """Rows in blocks."""
    n = values.shape[0]
    for b in prange((n + BLOCK - 1) // BLOCK):
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            if values[i] < 0:
                continue
            out[i] = 2 * values[i]


@parallel
def table(out):
    """Two loops of which one is all that is in the other."""
    for i in prange(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = 10 * i + j


@parallel
def negatives(values):
    """What is counted is returned."""
    count = 0
    for i in prange(values.shape[0]):
        if values[i] < 0:
            count += 1
    return count


@parallel
def sums(values, out):
    """A number of each block."""
    n = values.shape[0]
    for b in prange(out.shape[0]):
        total = 0.0
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            total += values[i]
        out[b] = total


@parallel
def greatest(values, out):
    """Likewise the largest."""
    n = values.shape[0]
    for b in prange(out.shape[0]):
        most = 0.0
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            if values[i] == 3:
                continue
            most = max(most, values[i])
        out[b] = most


@parallel
def reversed_rows(values, out):
    """Small arrays of an item's own, of one axis and of two."""
    for i in prange(values.shape[0]):
        kept, twice = np.zeros(3, np.float32), np.empty((2, 3), np.float32)
        for a in range(3):
            kept[a] = values[i, a]
            twice[0, a], twice[1, a] = kept[a], kept[a]
        for a in range(3):
            out[i, a] = twice[1, 2 - a]


@parallel
def in_turns(values, out):
    """Two loops for all threads."""
    for i in prange(values.shape[0]):
        out[i] = values[i]
    for i in prange(values.shape[0]):
        out[i] += 1


@parallel
def roomy(values, out):
    """More of its own than a thread can have."""
    for i in prange(values.shape[0]):
        own = np.zeros(ROOM, np.float32)
        own[i] = values[i]
        out[i] = own[i]


@serial
def fill(row, value):
    """Writes what it is given, if only there."""
    part = row[1:]
    part[0] = value


@parallel
def by_others(values, rows, parts, out):
    """Writes by a call, by a part with a name of its own, and by a tuple; `values` it reads."""
    first, _ = parts
    for i in prange(values.shape[0]):
        fill(rows[i], values[i])
        first[i] = values[i]
        here = out.reshape(-1)
        here[i] += values[i]
