"""Bin splats to tiles on a GPU, with one thread for each splat."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import cuda

from usdsplat.kernels.bins import tile_columns, tile_rows
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.lists import make_lists
from usdsplat.kernels.cuda.loops import BLOCKS, THREADS


@kernel
def _touch(records, grid, writes, places, tiles, splats):
    """Count or write the pairs of a splat, see `make_lists`. Counting and writing are one kernel,
    so that they agree."""
    n = records.shape[0]
    for k in range(cuda.grid(1), n + 1, cuda.gridsize(1)):
        if k == n:
            if not writes:
                places[n] = 0
            continue
        g = grid[0]
        s = records[k]
        at = places[k] if writes else 0
        stop = places[k + 1] if writes else 0
        first, end = tile_rows(s, g)
        for y in range(first, end):
            left, right = tile_columns(s, y, g)
            for x in range(left, right):
                if at < stop:
                    tiles[at], splats[at] = y * g.columns + x, k
                at += 1
        if not writes:
            places[k] = at
        for rest in range(at, stop):
            tiles[rest], splats[rest] = g.columns * g.rows, k


def tile_lists(
    device: CudaDevice, records: Any, grid: Any, tiles: int, _chunks: int, get: Callable[..., Any]
) -> tuple[Any, Any, int]:
    """Make the list of each tile, see `kernels.bins.tile_lists`."""

    def touch(writes: bool, places: Any, keys: Any, splats: Any) -> None:
        _touch[BLOCKS, THREADS, device.stream](records, grid, writes, places, keys, splats)

    return make_lists(device, get, "splat", records.shape[0], tiles, touch)
