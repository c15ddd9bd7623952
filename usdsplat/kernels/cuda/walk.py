"""Compute all requested products of each pixel on a GPU, with one thread for each pixel of a tile.

If pixels are sorted by ray hits, a block walks a quarter of a tile with a list of `quarter_lists`.
The window of a thread holds the contributions that must wait, because later splats of the list may
be in front of them. Windows are in shared memory. If one overflows, the quarter is walked again by
blocks of fewer threads with longer windows. If these overflow too, the last attempt has windows in
global memory that hold the longest list. The order is therefore exact.

The median depends on the final coverage of its pixel, so it takes a second walk.

Source: Radl et al. 2024, "StopThePop", for the order.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.bins import TILE
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.quarter_lists import QUARTERS, SIDE, quarter_lists
from usdsplat.kernels.cuda.tile import BATCH, THREADS
from usdsplat.kernels.cuda.walk_block import block_walk
from usdsplat.kernels.walk import COLOR, MEDIAN, WEIGH

FEW_ROWS = SIDE // 2
"""Number of rows of a quarter that a block walks after an overflow."""
RAY_BATCH = 32
"""Number of splats of a batch if pixels are sorted by ray hits: windows take most of the memory."""
SLOTS, MORE_SLOTS = 40, 224
"""Number of contributions that a window holds in the first and in the second attempt. The windows
of a block take 15 and 42 KiB of shared memory: 6 bytes for depth and index of each contribution."""
SHARED_PLACES, FAR_PLACES = 1 << 16, 1 << 31
"""Number of list indices that windows in shared memory store with 16 bits, and windows in the GPU's
memory with 32."""
FAR_ENTRY = 8
"""Bytes of a contribution in a window in global memory."""
ROOM = 1 << 30
"""Maximum total size of the windows in global memory [byte], unless one block needs more."""
BLOCKS = 132 * 4
"""Maximum number of blocks of a launch in which each block needs buffers."""
MANY_PRIMS = 256
"""Number of prims above which buffers are sized by the longest list, because a tile has no more
prims than splats."""
NO_UNITS = np.empty(0, np.int32)
NO_ORDER = np.empty(0, np.int64), NO_UNITS, np.empty(0, np.float32)
STEP = 4
"""Lists of a group differ in length by less than this factor."""


_WALK_TILE = block_walk(TILE, TILE, BATCH, sorts=False)


@kernel
def _walk_lists(options, arrays, prims):
    """Walk all tiles in the order of their lists, without sorting by ray hits."""
    known, names, table = prims
    starts = arrays[4]
    none = cuda.local.array((1, 1), np.float32)
    no_places = cuda.local.array((1, 1), np.int32)
    block = cuda.blockIdx.x
    room = min(block, known.shape[0] - 1)
    for tile in range(block, starts.shape[0] - 1, cuda.gridDim.x):
        cuda.syncthreads()
        listed = starts[tile], starts[tile + 1] - starts[tile]
        _WALK_TILE(
            (none, no_places), tile, (0, 0), listed, options, *arrays, known[room], names[room],
            table[room],
        )  # fmt: skip


def _ray_walk(name: str, parent: int, height: int, slots: int, *, only_color: bool = False) -> Any:
    """Return the kernel that walks rows of quarters of tiles in the order of ray hits.

    Args:
        parent: Number of rows of each unit that is passed to the kernel.
        height: Number of rows that a block walks; a divisor of `parent`.
        slots: Number of contributions that a window in shared memory holds; 0 if windows are in
            global memory.
        only_color: See `block_walk`.
    """
    walk_block = block_walk(
        SIDE,
        height,
        RAY_BATCH,
        sorts=True,
        most_places=SHARED_PLACES if slots else FAR_PLACES,
        is_long=height < SIDE,
        only_color=only_color,
    )
    threads, parts, units_of_quarter = SIDE * height, parent // height, SIDE // parent
    size = slots, threads

    def place_of(k, units):
        """Return the k-th part to walk, as (quarter, index of the part within it)."""
        unit = units[k // parts] if units.shape[0] > 0 else k // parts
        return unit // units_of_quarter, unit % units_of_quarter * parts + k % parts

    def walk_part(quarter, part, window, options, arrays, known, names, table):
        firsts = arrays[12]
        of_tile = quarter % QUARTERS
        first_pixel = of_tile % 2 * SIDE, of_tile // 2 * SIDE + part * height
        listed = firsts[quarter], firsts[quarter + 1] - firsts[quarter]
        return walk_block(
            window, quarter // QUARTERS, first_pixel, listed, options, *arrays, known, names, table
        )

    place_of, walk_part = cuda.jit(device=True)(place_of), cuda.jit(device=True)(walk_part)

    def walk_rays(options, arrays, prims, units, count, again, total):
        known, names, table = prims
        depths = cuda.shared.array(size, np.float32)
        places = cuda.shared.array(size, np.uint16)
        room = min(cuda.blockIdx.x, known.shape[0] - 1)
        for k in range(cuda.blockIdx.x, count * parts, cuda.gridDim.x):
            quarter, part = place_of(k, units)
            cuda.syncthreads()
            overflows = walk_part(
                quarter, part, (depths, places), options, arrays, known[room], names[room],
                table[room],
            )  # fmt: skip
            if overflows and cuda.threadIdx.x == 0:
                again[cuda.atomic.add(total, 0, 1)] = quarter * (SIDE // height) + part

    def walk_far(options, arrays, prims, units, count, windows):
        known, names, table = prims
        depths, places = windows
        block = cuda.blockIdx.x
        room = min(block, known.shape[0] - 1)
        for k in range(block, count * parts, cuda.gridDim.x):
            quarter, part = place_of(k, units)
            cuda.syncthreads()
            walk_part(
                quarter, part, (depths[block], places[block]), options, arrays, known[room],
                names[room], table[room],
            )  # fmt: skip

    return kernel(walk_rays if slots else walk_far, name=f"cuda.walk.{name}")


_WALK_COLOR = _ray_walk("walk_color", SIDE, SIDE, SLOTS, only_color=True)
_WALK_RAYS = _ray_walk("walk_rays", SIDE, SIDE, SLOTS)
_WALK_FEW_ROWS = _ray_walk("walk_few_rows", SIDE, FEW_ROWS, MORE_SLOTS)
_WALK_FAR = _ray_walk("walk_far", FEW_ROWS, FEW_ROWS, 0)


@kernel
def _clear(total):
    total[0] = 0


def walk(device: CudaDevice, options: tuple[Any, ...], *args: Any) -> None:
    """Compute all requested products, see `kernels.walk.walk`. MEDIAN takes a second walk."""
    wants, sorts, is_parallel, *rest = options
    records, starts, lists, grid, ray_hits = args[0], *args[4:8]
    order = None
    if sorts:
        order = quarter_lists(device, is_parallel, records, ray_hits, starts, lists, grid)
    for part in (wants & ~MEDIAN, wants & MEDIAN):
        if part:
            walk_pixels(device, (part, sorts, is_parallel, *rest), *args, order=order)


def walk_pixels(
    device: CudaDevice, options: tuple[Any, ...], *args: Any, order: Any = None
) -> None:
    """Compute the requested products of all pixels in one walk.

    Args:
        options, args: The arguments of `kernels.walk.walk`. MEDIAN cannot be combined with other
            products.
        order: Result of `quarter_lists`; None if pixels are not sorted by ray hits.
    """
    wants, _, _, known, *_ = options
    keeps, starts, occluder_depth, holdout = args[2], args[4], args[8], args[10]
    tiles = starts.shape[0] - 1
    if tiles == 0:
        return
    prims = known if wants & WEIGH else 0
    if prims > MANY_PRIMS:
        prims = min(prims, max(1, int(np.diff(device.fetch(starts)).max())))

    def rooms(blocks: int, threads: int) -> tuple[int, Any]:
        blocks = min(blocks, BLOCKS) if prims else blocks
        return blocks, _prim_room(device, known, prims, blocks, threads)

    if order is None:
        blocks, room = rooms(tiles, THREADS)
        arrays = *args, *(device.keep(each) for each in NO_ORDER)
        _walk_lists[blocks, THREADS, device.stream](options, arrays, room)
        return
    arrays = *args, *order
    is_color = wants == COLOR and not any(each.size for each in (keeps, occluder_depth, holdout[0]))
    units, count = device.keep(NO_UNITS), QUARTERS * tiles
    for walk_rays, parent, height in (
        (_WALK_COLOR if is_color else _WALK_RAYS, SIDE, SIDE),
        (_WALK_FEW_ROWS, SIDE, FEW_ROWS),
    ):
        size = count * (parent // height)
        again = device.borrow(f"walk again {height}", size, np.int32)
        total = device.borrow("walk total", 1, np.int32)
        _clear[1, 1, device.stream](total)
        blocks, room = rooms(size, SIDE * height)
        walk_rays[blocks, SIDE * height, device.stream](
            options, arrays, room, units, count, again, total
        )
        units, count = again, device.number(total, 0)
        if count == 0:
            return
    crowded = device.fetch(units)[:count]
    lengths = np.diff(device.fetch(order[0]))[crowded // (SIDE // FEW_ROWS)]
    threads = SIDE * FEW_ROWS
    for some, longest in _groups(lengths):
        most = max(1, ROOM // (threads * longest * FAR_ENTRY))
        blocks, room = rooms(min(len(some), BLOCKS, most), threads)

        def window(name: str, dtype: Any, depth: int = longest, blocks: int = blocks) -> Any:
            size = blocks * depth * threads
            return device.borrow(name, size, dtype)[:size].reshape((blocks, depth, threads))

        windows = window("walk depths", np.float32), window("walk places", np.int32)
        _WALK_FAR[blocks, threads, device.stream](
            options, arrays, room, device.keep(crowded[some]), len(some), windows
        )


# --- private -------------------------------------------------------------------------------


def _prim_room(
    device: CudaDevice, known: int, prims: int, blocks: int, threads: int
) -> tuple[Any, Any, Any]:
    """Return buffers for the numbers, names and weights of the prims of each block's tile.

    Args:
        known: Number of prims of the scene.
        prims: Maximum number of prims of a tile, 0 if they are not weighed.
    """
    if not prims:
        known, prims, blocks = 1, 1, 1

    def room(name: str, dtype: Any, *shape: int) -> Any:
        size = blocks * math.prod(shape)
        return device.borrow(name, size, dtype)[:size].reshape((blocks, *shape))

    return (
        room("walk known", np.int32, known), room("walk names", np.int32, prims),
        room("walk table", np.float32, prims, threads),
    )  # fmt: skip


def _groups(lengths: Any) -> list[tuple[Any, int]]:
    """Return groups of indices whose lists have similar lengths, and the longest of each."""
    order = np.argsort(-lengths, kind="stable").astype(np.int32)
    sizes = np.maximum(lengths[order], 1)
    groups, first = [], 0
    while first < len(order):
        end = int(np.searchsorted(-sizes, -(sizes[first] // STEP), side="left"))
        end = max(end, first + 1)
        groups.append((order[first:end], int(sizes[first])))
        first = end
    return groups
