"""Kernels of every form, for tests of launches."""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.jit import parallel, serial
from usdsplat.kernels.launch import EACH, BlockArray, block_kernel, kernel, reduction


@kernel(over="values", writes=("out",))
def doubled(i, values, factor, out):
    """Write factor * value where that is positive."""
    if values[i] <= 0:
        return
    out[i] = factor * values[i]


@kernel(over="out", writes=("out",), axes=2)
def numbered(y, x, out):
    """Write the number of each pixel, row by row."""
    out[y, x] = y * out.shape[1] + x


@kernel(over="size", writes=("out",), axes=2)
def sized(y, x, size, out):
    """Write the number of each pixel of a size, into a flat array."""
    out[y * size[1] + x] = 10 * y + x


@kernel(over=("rows", "columns"), writes=("out",), axes=2)
def table(y, x, rows, columns, out):
    """Write the product of each row's number with each column's."""
    out[y, x] = rows[y] * columns[x]


@kernel(over="values", writes=("both", "last"))
def nested(i, values, both, three, last):
    """Read and write arrays in tuples."""
    first, second = both
    a, b, c = three
    first[i] = a * values[i] + b
    second[i] = c
    last[i] = first[i] + second[i]


@block_kernel(over="values", writes=("out",), block=8)
def summed(first, last, values, out):
    """Write to each item the number of items before it in its block, and its value."""
    for i in range(first, last):
        out[i] = values[i] + np.float32(1)


@block_kernel(
    over="values",
    writes=("out",),
    block=8,
    scratch=(BlockArray(shape=(2, EACH), dtype=np.float32),),
)
def mirrored(first, last, own, values, out):
    """Write squares by way of scratch, which has a column for each item of a block."""
    for i in range(first, last):
        own[0, i - first] = values[i]
    for i in range(first, last):
        own[1, i - first] = own[0, i - first] * own[0, i - first]
    for i in range(first, last):
        out[i] = own[1, i - first]


@block_kernel(
    over="values",
    writes=("out",),
    block=8,
    scratch=(BlockArray(shape=3, dtype=np.int64), BlockArray(shape=EACH, dtype=np.float32)),
)
def weighed(first, last, whole, parts, values, out):
    """Use two arrays of scratch of different types."""
    for k in range(3):
        whole[k] = k + 1
    for i in range(first, last):
        parts[i - first] = values[i] * np.float32(whole[2])
    for i in range(first, last):
        out[i] = parts[i - first] + np.float32(whole[0])


@kernel(over="counts", writes=("out",), team=True)
def filled(item, lane, lanes, counts, width, out):
    """Fill the first places of each item's part."""
    for k in range(lane, counts[item], lanes):
        out[item * width + k] = item + 1


@reduction(over="values", by="sum")
def total(i, values):
    """Return each value."""
    return np.float64(values[i])


@reduction(over="values", by="max", writes=("out",))
def most(i, values, out):
    """Write each value's square, and return its size."""
    out[i] = values[i] * values[i]
    return np.float64(abs(values[i]))


@reduction(over="values", by="any")
def above(i, values, limit):
    """Return whether a value is above the limit."""
    return values[i] > limit


@parallel
def undeclared(out):
    """Write without saying so."""
    out[0] = 1


@serial(writes=("rows", "parts", "out"))
def by_steps(values, rows, parts, out):
    """Write what the CPU makes one after the other, into arrays and one in a tuple."""
    for i in range(len(values)):
        rows[i, 1] = values[i]
        parts[0][i] = values[i]
        out[i] = values[i]
