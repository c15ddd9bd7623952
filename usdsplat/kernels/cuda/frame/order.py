"""Sort splats by depth: sort shortened keys, then resolve ties.

CUB sorts eight bits at a time. With few splats, two bytes of a key take half the time of four. The
keys of a view are close together. Therefore the smallest key is subtracted, and keys are shortened
to the bits that the largest one needs. Shortened keys are equal only for splats of almost the same
depth. These are then sorted by their full keys, and splats of equal full keys by row, because their
order in memory has no meaning. With many splats more keys are equal, and resolving ties takes
longer than another pass of the sort.
"""

from __future__ import annotations

import numpy as np
from numba import cuda, int32

from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.ties import limit, merge_run, place_in_run
from usdsplat.kernels.sort import ordered_bits

LAST = np.uint32(0xFFFFFFFF)
CUT = ((1 << 17, 16), (1 << 18, 24))
"""(Maximum number of splats for shortened keys, bits of a shortened key)."""


def bits_of(count: int) -> int:
    """Return the bits of the keys for a number of splats."""
    return next((bits for most, bits in CUT if count <= most), 32)


@kernel
def narrow(totals, bits, span, most, keys):
    """Shorten the keys of the existing splats to `most` bits, pad with the largest key, and clear
    totals[4].

    Args:
        totals: Number of existing splats in [0].
        bits: Keys, as the bits of float32, (m,) u32.
        span: Smallest and largest key, as the bits of float32, (2,) u32.
        most: Number of bits of a shortened key.
        keys: Receives shortened keys, (m,) u32.
    """
    k = cuda.grid(1)
    if k == 0:
        totals[4] = 0
    if k < keys.shape[0]:
        low = ordered_bits(span[0])
        width = np.uint32(ordered_bits(span[1]) - low)
        surplus = int32(32) - int32(most) - int32(cuda.clz(width))
        cut = np.uint32(max(surplus, int32(0)))
        own = np.uint32(ordered_bits(bits[k]) - low) >> cut
        keys[k] = own if k < totals[0] else LAST


@kernel
def settle_ties(totals, narrowed, order, keys, names, counts, out, ordered_counts, long_runs):
    """Sort splats of equal shortened keys, and their numbers of tiles with them.

    Args:
        totals: Number of existing splats in [0]. [2] is set to 0: the number of splats of many
            tiles, which later kernels count. [4], cleared by `narrow`, receives the number of long
            runs.
        narrowed, order: Sorted keys and rows of records, (m,).
        keys, names, counts: Key f32, unique number i64 and number of tiles i32 of each record.
        out: Receives the rows of the records in order, (m,) i32. The rows of long runs are not
            sorted yet.
        ordered_counts: Receives the number of tiles of each row in `out`, and 0 for padding, (m +
            1,) i32.
        long_runs: Receives the first index of each long run, (m // TIES + 1,) i32.
    """
    k = cuda.grid(1)
    m = narrowed.shape[0]
    n = min(totals[0], m)
    if k == 0:
        totals[2] = 0
    if n <= k <= m:
        ordered_counts[k] = 0
    if k >= n:
        return
    to = place_in_run(k, n, narrowed, order, keys, names, totals[4:], long_runs)
    out[to], ordered_counts[to] = order[k], counts[order[k]]


@kernel
def settle_long(totals, narrowed, order, keys, names, counts, out, ordered_counts, long_runs):
    """Sort the long runs that `settle_ties` has listed, with a block of threads for each. `order`
    is scratch."""
    n = min(totals[0], narrowed.shape[0])
    for run in range(cuda.blockIdx.x, totals[4], cuda.gridDim.x):
        first = long_runs[run]
        end = limit(narrowed, n, narrowed[first], True)
        merge_run(first, end, out, order, keys, names)
        for k in range(first + cuda.threadIdx.x, end, cuda.blockDim.x):
            ordered_counts[k] = counts[out[k]]
