"""Make lists of the items that touch each tile, on a GPU: pairs of tile and item, sorted by tile.

Items write their pairs in item order, and the sort is stable. Every list is therefore in item
order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.bins import MOST_PAIRS
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.loops import BLOCKS, THREADS


@kernel
def _begins(keys, starts):
    """Set starts[t] to the number of keys less than t. The keys are sorted."""
    n, tiles = keys.shape[0], starts.shape[0] - 1
    for i in range(cuda.grid(1), n + 1, cuda.gridsize(1)):
        first = np.int64(keys[i - 1]) + 1 if i > 0 else np.int64(0)
        last = min(np.int64(keys[i]), np.int64(tiles)) if i < n else np.int64(tiles)
        for tile in range(first, last + 1):
            starts[tile] = i


def make_lists(
    device: CudaDevice,
    get: Callable[..., Any],
    name: str,
    things: int,
    tiles: int,
    touch: Callable[[bool, Any, Any, Any], None],
) -> tuple[Any, Any, int]:
    """Make the lists for any kind of item. The result is that of `bins.tile_lists`.

    Args:
        get: Makes buffers by name, shape and dtype.
        name: Prefix of the buffers' names.
        things, tiles: Numbers of items and tiles.
        touch: Launches a kernel with (writes, places, tiles of pairs, items of pairs). If `writes`
            is false, it sets places[k] to the number of tiles that item k < `things` touches, and
            the last entry to 0. Otherwise item k writes its pairs from places[k] to before places[k
            + 1]; missing pairs are written with the tile after the last one.
    """
    narrow = np.uint16 if tiles < 1 << 16 else np.uint32
    starts = get(f"{name} starts", (tiles + 1,), np.int64)
    counts = get(f"{name} counts", (things + 1,), np.int64)
    places = get(f"{name} places", (things + 1,), np.int64)
    none = get(f"{name} none", (0,), narrow)
    lists = get(f"{name} lists", (0,), np.int32)
    touch(False, counts, none, lists)
    device.primitives.running_sum(counts, places, things + 1)
    pairs = device.number(places, things)
    if 0 < pairs <= MOST_PAIRS:
        keys = get(f"{name} keys {narrow.__name__}", (2 * pairs,), narrow)
        owners = get(f"{name} owners", (pairs,), np.int32)
        lists = get(f"{name} lists", (pairs,), np.int32)
        touch(True, places, keys[:pairs], owners)
        ordered = keys[pairs:]
        device.primitives.sort_pairs(
            keys[:pairs], owners, ordered, lists, pairs, end_bit=tiles.bit_length()
        )
        none = ordered
    _begins[BLOCKS, THREADS, device.stream](none, starts)
    return starts, lists, pairs
