"""Sort splats by depth on a GPU: used slots from a prefix sum, then CUB's stable radix sort."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.loops import BLOCKS, THREADS
from usdsplat.kernels.cuda.ties import (
    MERGERS,
    MERGING,
    TIES,
    limit,
    merge_run,
    place_in_run,
)
from usdsplat.kernels.sort import ordered_bits

NO_DEPTHS = np.empty(0, np.float32)


@kernel
def _with_end(found, out):
    for b in range(cuda.grid(1), found.shape[0] + 1, cuda.gridsize(1)):
        out[b] = found[b] if b < found.shape[0] else 0


@kernel
def _used(found, starts, places, visible):
    for b in range(cuda.blockIdx.x, found.shape[0], cuda.gridDim.x):
        for i in range(cuda.threadIdx.x, found[b], cuda.blockDim.x):
            visible[places[b] + i] = starts[b] + i


@kernel
def _keyed(visible, keys, bits, slots):
    for k in range(cuda.grid(1), bits.shape[0], cuda.gridsize(1)):
        bits[k] = ordered_bits(keys[visible[k]])
        slots[k] = visible[k]


def visible_slots(device: CudaDevice, found: Any, starts: Any, blocks: int, visible: Any) -> int:
    """List the used slots, see `kernels.sort.visible_slots`. The host waits for their number."""
    if blocks == 0:
        return 0
    counts = device.borrow("used counts", blocks + 1, np.int32)
    places = device.borrow("used places", blocks + 1, np.int32)
    _with_end[BLOCKS, THREADS, device.stream](found, counts)
    device.primitives.running_sum(counts, places, blocks + 1)
    _used[BLOCKS, THREADS, device.stream](found, starts, places, visible)
    return device.number(places, blocks)


def depth_order(
    device: CudaDevice,
    visible: Any,
    count: int,
    keys: Any,
    _chunks: int,
    work: Any,
    _histogram: Any,
) -> int:
    """Sort slots by key, see `kernels.sort.depth_order`, with all 32 bits in one sort."""
    bits, slots = work
    if count > 0:
        raw = keys.view(np.uint32)
        _keyed[BLOCKS, THREADS, device.stream](visible, raw, bits[0], slots[0])
        device.primitives.sort_pairs(bits[0], slots[0], bits[1], slots[1], count)
    return 1


@kernel
def _name(slots, count, sources, first_slots, names, total):
    """Write appearance and row of each used slot to `names`, and set total[0] = 0."""
    for k in range(cuda.grid(1), count, cuda.gridsize(1)):
        if k == 0:
            total[0] = 0
        owner = limit(first_slots, first_slots.shape[0], slots[k], True)
        names[slots[k]] = np.int64(owner) << np.int64(32) | np.int64(sources[slots[k]])


@kernel
def _settle(bits, slots, count, depths, names, out, total, long_runs):
    for k in range(cuda.grid(1), count, cuda.gridsize(1)):
        out[place_in_run(k, count, bits, slots, depths, names, total, long_runs)] = slots[k]


@kernel
def _settle_long(bits, slots, count, depths, names, out, total, long_runs):
    for run in range(cuda.blockIdx.x, total[0], cuda.gridDim.x):
        first = long_runs[run]
        merge_run(first, limit(bits, count, bits[first], True), out, slots, depths, names)


@kernel
def _settled(out, count, slots):
    for k in range(cuda.grid(1), count, cuda.gridsize(1)):
        slots[k] = out[k]


def settle(
    device: CudaDevice, bits: Any, slots: Any, count: int, sources: Any, first_slots: Any, work: Any
) -> None:
    """Sort splats of equal keys, see `kernels.sort.settle`."""
    if count == 0:
        return
    names = device.borrow("tie names", sources.shape[0], np.int64)
    out = device.borrow("settled", count, np.int32)
    total = device.borrow("long runs", 1, np.int32)
    firsts = device.borrow("first of long runs", count // TIES + 1, np.int32)
    depths = device.keep(NO_DEPTHS)
    _name[BLOCKS, THREADS, device.stream](slots, count, sources, first_slots, names, total)
    ties = bits, slots, count, depths, names, out, total, firsts
    _settle[BLOCKS, THREADS, device.stream](*ties)
    _settle_long[MERGING, MERGERS, device.stream](*ties)
    _settled[BLOCKS, THREADS, device.stream](out, count, slots)
