"""Runs of equal keys in a sorted list."""

from __future__ import annotations

from numba import cuda, int32

TIES = 1024
"""Splats of one key that are put in order, each against all others."""


@cuda.jit(device=True, inline="always")
def limit(keys, n, key, beyond):
    """The first of n ascending keys that is not less than `key`, or that is `beyond` it."""
    low, high = int32(0), int32(n)
    while low < high:
        middle = (low + high) >> 1
        if keys[middle] < key or (beyond and keys[middle] == key):
            low = middle + 1
        else:
            high = middle
    return low
