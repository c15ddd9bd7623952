"""List the splats of each quarter of a tile, sorted by the least depth at which rays may hit them.

When a pixel walks such a list, a waiting contribution can be processed once it is in front of the
least depth of the next splat. Quarters are better than whole tiles: the least depth over a quarter
is closer to the depths in its pixels, and fewer splats touch it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.bins import SLACK, TILE, span
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.loops import BLOCKS, THREADS
from usdsplat.kernels.cuda.tile import origin
from usdsplat.kernels.project import HALF_WIDTH, LOG_CUTOFF, LOG_OPACITY, A, B, C, U, V
from usdsplat.kernels.ray_hit import CENTER, GX, GY, HX, HY, HZ, REACH, least_hit
from usdsplat.kernels.sort import ordered_bits

SIDE = TILE // 2
"""Columns and rows of a quarter."""
QUARTERS = 4
"""Number of quarters of a tile: top left, top right, bottom left, bottom right."""
DEPTH_BITS = 32
SIGN = np.uint32(0x80000000)


@kernel
def _touch(
    is_parallel, records, ray_hits, starts, lists, grid, writes, places, quarters, ranks, least
):  # fmt: skip
    """Count or write the quarters that each splat of each tile's list touches.

    One kernel does both, so that counts and entries match.
    """
    g, most = grid[0], np.float32(SIDE - 1)
    if not writes and cuda.grid(1) == 0:
        places[lists.shape[0]] = 0
    for tile in range(cuda.blockIdx.x, starts.shape[0] - 1, cuda.gridDim.x):
        left, top = origin(g, tile)
        for k in range(starts[tile] + cuda.threadIdx.x, starts[tile + 1], cuda.blockDim.x):
            s, hit = records[lists[k]], ray_hits[lists[k]]
            u, v = s[U] - np.float32(left), s[V] - np.float32(top)
            reach = np.float32(2) * (s[LOG_OPACITY] - LOG_CUTOFF)
            at = places[k] if writes else 0
            for quarter in range(QUARTERS):
                x, y = np.float32(quarter % 2 * SIDE), np.float32(quarter // 2 * SIDE)
                low, high = y - v - SLACK, y - v + most + SLACK
                lowest, highest = span(s[A], s[B], s[C], reach, s[HALF_WIDTH], low, high)
                if u + lowest - SLACK > x + most or u + highest + SLACK < x:
                    continue
                if writes and at < places[k + 1]:
                    quarters[at], ranks[at] = tile * QUARTERS + quarter, lists[k]
                    least[at] = least_hit(
                        u - x, v - y, most, hit[GX], hit[GY], hit[HX], hit[HY], hit[HZ],
                        hit[CENTER], hit[REACH], is_parallel,
                    )  # fmt: skip
                at += 1
            if not writes:
                places[k] = at


@kernel
def _key(quarters, bits, keys):
    for k in range(cuda.grid(1), keys.shape[0], cuda.gridsize(1)):
        first = np.uint64(quarters[k]) << np.uint64(DEPTH_BITS)
        keys[k] = first | np.uint64(ordered_bits(bits[k]))


@kernel
def _unkey(keys, bits, starts):
    """Decode sorted keys: write the bits of least depths, and the first entry of each quarter."""
    n, quarters = keys.shape[0], starts.shape[0] - 1
    for k in range(cuda.grid(1), n + 1, cuda.gridsize(1)):
        first = np.int64(keys[k - 1] >> np.uint64(DEPTH_BITS)) + 1 if k > 0 else np.int64(0)
        last = np.int64(quarters)
        if k < n:
            last = np.int64(keys[k] >> np.uint64(DEPTH_BITS))
            ordered = np.uint32(keys[k] & np.uint64(0xFFFFFFFF))
            bits[k] = ordered ^ SIGN if ordered & SIGN else ordered ^ np.uint32(0xFFFFFFFF)
        for quarter in range(first, last + 1):
            starts[quarter] = k


def quarter_lists(
    device: CudaDevice, is_parallel: bool, records: Any, ray_hits: Any, starts: Any, lists: Any,
    grid: Any,
) -> tuple[Any, Any, Any]:  # fmt: skip
    """Return the lists of all quarters of tiles, each sorted by least depth.

    Args:
        is_parallel: Whether rays are parallel.
        records, starts, lists, grid, ray_hits: See `blend`.

    Returns:
        (starts, splats, least depths): the first entry of each quarter's list and the end of the
        last one, shape (QUARTERS * tiles + 1,) i64; the splats of all lists, shape (n,) i32; their
        least depths, shape (n,) f32. The arrays are from `CudaDevice.borrow`.
    """
    pairs, tiles = lists.shape[0], starts.shape[0] - 1
    quarters = QUARTERS * tiles
    blocks = min(tiles, BLOCKS)
    counts = device.borrow("quarter lists counts", pairs + 1, np.int64)
    places = device.borrow("quarter lists places", pairs + 1, np.int64)

    def touch(writes: bool, at: Any, *out: Any) -> None:
        _touch[blocks, THREADS, device.stream](
            is_parallel, records, ray_hits, starts, lists, grid, writes, at, *out
        )

    def room(name: str, size: int, dtype: Any) -> Any:
        return device.borrow(f"quarter lists {name}", size, dtype)[:size]

    none = room("ranks", 0, np.int32)
    touch(False, counts, none.view(np.uint32), none, room("least", 0, np.float32))
    device.primitives.running_sum(counts, places, pairs + 1)
    n = device.number(places, pairs)
    names, ranks = room("quarters", n, np.uint32), room("ranks", n, np.int32)
    least, firsts = room("least", n, np.float32), room("firsts", quarters + 1, np.int64)
    keys, ordered = room("keys", n, np.uint64), room("ordered keys", n, np.uint64)
    splats = room("splats", n, np.int32)
    if n:
        touch(True, places, names, ranks, least)
        bits = least.view(np.uint32)
        _key[BLOCKS, THREADS, device.stream](names, bits, keys)
        device.primitives.sort_pairs(
            keys, ranks, ordered, splats, n, end_bit=DEPTH_BITS + quarters.bit_length()
        )
    _unkey[BLOCKS, THREADS, device.stream](ordered, least.view(np.uint32), firsts)
    return firsts, splats, least
