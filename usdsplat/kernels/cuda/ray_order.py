"""Sort the list of each tile by the least depth at which a ray of the tile may hit each splat.

A pixel that walks a list in this order can process a waiting contribution as soon as it is in front
of the least depth of the next splat.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.loops import BLOCKS, THREADS
from usdsplat.kernels.cuda.tile import origin
from usdsplat.kernels.project import U, V
from usdsplat.kernels.ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, least_hit
from usdsplat.kernels.sort import ordered_bits

DEPTH_BITS = 32


@kernel
def _least(is_parallel, records, ray_hits, starts, lists, grid, least):
    """Write the least depth of each pair of tile and splat."""
    g = grid[0]
    for tile in range(cuda.blockIdx.x, starts.shape[0] - 1, cuda.gridDim.x):
        left, top = origin(g, tile)
        for k in range(starts[tile] + cuda.threadIdx.x, starts[tile + 1], cuda.blockDim.x):
            rank = lists[k]
            u, v = records[rank, U] - np.float32(left), records[rank, V] - np.float32(top)
            hit = ray_hits[rank]
            least[k] = least_hit(
                u, v, hit[GX], hit[GY], hit[HX], hit[HY], hit[HZ], hit[CENTER], hit[REACH],
                is_parallel,
            )  # fmt: skip


@kernel
def _keyed(bits, starts, keys, pairs):
    """Write sort keys of tile and least depth, and the number of each pair."""
    for tile in range(cuda.blockIdx.x, starts.shape[0] - 1, cuda.gridDim.x):
        first = np.uint64(tile) << np.uint64(DEPTH_BITS)
        for k in range(starts[tile] + cuda.threadIdx.x, starts[tile + 1], cuda.blockDim.x):
            keys[k], pairs[k] = first | np.uint64(ordered_bits(bits[k])), k


@kernel
def _gather(pairs, lists, least, ranks, bounds):
    for k in range(cuda.grid(1), pairs.shape[0], cuda.gridsize(1)):
        ranks[k], bounds[k] = lists[pairs[k]], least[pairs[k]]


def ray_order(
    device: CudaDevice, is_parallel: bool, records: Any, ray_hits: Any, starts: Any, lists: Any,
    grid: Any,
) -> tuple[Any, Any]:  # fmt: skip
    """Return the order in which pixels walk through the lists of their tiles.

    Args:
        is_parallel: Whether rays are parallel.
        records, starts, lists, grid, ray_hits: As `blend` takes them.

    Returns:
        The lists, each sorted by least depth, shape (pairs,) i32; and the least depths, shape
        (pairs,) f32. Both are borrowed.
    """
    pairs, tiles = lists.shape[0], starts.shape[0] - 1
    least = device.borrow("ray order least", 2 * pairs, np.float32)
    keys = device.borrow("ray order keys", 2 * pairs, np.uint64)
    places = device.borrow("ray order places", 2 * pairs, np.int32)
    ranks = device.borrow("ray order ranks", pairs, np.int32)
    bounds, order = least[pairs : 2 * pairs], places[pairs : 2 * pairs]
    if pairs:
        blocks = min(tiles, BLOCKS)
        _least[blocks, THREADS, device.stream](
            is_parallel, records, ray_hits, starts, lists, grid, least
        )
        _keyed[blocks, THREADS, device.stream](least.view(np.uint32), starts, keys, places)
        device.primitives.sort_pairs(
            keys, places, keys[pairs:], order, pairs, end_bit=DEPTH_BITS + tiles.bit_length()
        )
        _gather[BLOCKS, THREADS, device.stream](order, lists, least, ranks, bounds)
    return ranks, bounds
