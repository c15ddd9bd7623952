"""Weigh the prims of each pixel on a GPU: number the prims of a tile, and rank their weights."""

from __future__ import annotations

import numpy as np
from numba import cuda

from usdsplat.kernels.cuda.warp import LANES, below, votes
from usdsplat.kernels.weigh import NONE

WARPS = 8
"""Maximum number of warps of a block."""
UNKNOWN = np.int32(0x7FFFFFFF)


@cuda.jit(device=True)
def number_prims(lists, labels, begin, n, known, names, thread):
    """Number the prims of a tile in the order of its list, as `kernels.weigh.number_prims` does.

    All threads of a block must call it.

    Args:
        lists: The tile's list consists of the `n` entries from `begin` on.
        labels: Number of each splat's prim.
        known: Receives, for each prim of the tile, its number within the tile.
        names: Receives the prim of each of these numbers.

    Returns:
        Number of prims in the tile.
    """
    counts = cuda.shared.array(WARPS, np.int32)
    threads = cuda.blockDim.x
    lane, warp = thread % LANES, thread // LANES
    for prim in range(thread, known.shape[0], threads):
        known[prim] = UNKNOWN
    cuda.syncthreads()
    for k in range(thread, n, threads):
        cuda.atomic.min(known, labels[lists[begin + k]], np.int32(k))
    cuda.syncthreads()
    prims = np.int32(0)
    for first in range(0, n, threads):
        k = first + thread
        label = labels[lists[begin + k]] if k < n else np.int32(0)
        # `known` has numbers for earlier prims. They are less than k, so they do not match.
        is_first = k < n and known[label] == k
        bits = votes(is_first)
        if lane == 0:
            counts[warp] = cuda.popc(bits)
        cuda.syncthreads()
        number = prims + np.int32(cuda.popc(np.uint32(bits & below(lane))))
        for w in range(threads // LANES):
            prims += counts[w]
            if w < warp:
                number += counts[w]
        if is_first:
            known[label], names[number] = number, label
        cuda.syncthreads()
    return prims


@cuda.jit(device=True)
def strongest(table, prims, thread, names, ids, weights, row, column):
    """Write the prims with the largest weights in one pixel, see `kernels.weigh.strongest`."""
    for rank in range(ids.shape[2]):
        best, most = NONE, np.float32(0)
        for j in range(prims):
            if table[j, thread] > most:
                best, most = np.int32(j), table[j, thread]
        ids[row, column, rank] = names[best] if best >= 0 else NONE
        weights[row, column, rank] = most
        if best >= 0:
            table[best, thread] = np.float32(0)
