"""The order of depths on a GPU: used slots by a running sum, then CUB's radix sort, also stable."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.cuda.device import BLOCKS, THREADS, CudaDevice, form
from usdsplat.kernels.cuda.ties import TIES, limit
from usdsplat.kernels.sort import ordered_bits


@cuda.jit
def _with_end(found, out):
    for b in range(cuda.grid(1), found.shape[0] + 1, cuda.gridsize(1)):
        out[b] = found[b] if b < found.shape[0] else 0


@cuda.jit
def _used(found, starts, places, visible):
    for b in range(cuda.blockIdx.x, found.shape[0], cuda.gridDim.x):
        for i in range(cuda.threadIdx.x, found[b], cuda.blockDim.x):
            visible[places[b] + i] = starts[b] + i


@cuda.jit
def _keyed(visible, keys, bits, slots):
    for k in range(cuda.grid(1), bits.shape[0], cuda.gridsize(1)):
        bits[k] = ordered_bits(keys[visible[k]])
        slots[k] = visible[k]


@form
def visible_slots(device: CudaDevice, found: Any, starts: Any, blocks: int, visible: Any) -> int:
    """`kernels.sort.visible_slots`; the one number that the host waits for."""
    if blocks == 0:
        return 0
    counts = device.borrow("used counts", blocks + 1, np.int32)
    places = device.borrow("used places", blocks + 1, np.int32)
    _with_end[BLOCKS, THREADS, device.stream](found, counts)
    device.primitives.running_sum(counts, places, blocks + 1)
    _used[BLOCKS, THREADS, device.stream](found, starts, places, visible)
    return int(device.fetch(places[blocks : blocks + 1])[0])


@form
def depth_order(
    device: CudaDevice,
    visible: Any,
    count: int,
    keys: Any,
    _chunks: int,
    work: Any,
    _histogram: Any,
) -> int:
    """`kernels.sort.depth_order`, of 32 bits at once."""
    bits, slots = work
    if count > 0:
        raw = keys.view(np.uint32)
        _keyed[BLOCKS, THREADS, device.stream](visible, raw, bits[0], slots[0])
        device.primitives.sort_pairs(bits[0], slots[0], bits[1], slots[1], count)
    return 1


@cuda.jit
def _settle(bits, slots, count, sources, first_slots, out):
    k = cuda.grid(1)
    while k < count:
        key, to = bits[k], k
        if (k > 0 and bits[k - 1] == key) or (k + 1 < count and bits[k + 1] == key):
            first, end = limit(bits, count, key, False), limit(bits, count, key, True)
            if end - first <= TIES:
                to = first
                own = limit(first_slots, first_slots.shape[0], slots[k], True)
                for j in range(first, end):
                    other = limit(first_slots, first_slots.shape[0], slots[j], True)
                    if other < own or (other == own and sources[slots[j]] < sources[slots[k]]):
                        to += 1
        out[to] = slots[k]
        k += cuda.gridsize(1)


@cuda.jit
def _settled(out, count, slots):
    k = cuda.grid(1)
    while k < count:
        slots[k] = out[k]
        k += cuda.gridsize(1)


@form
def settle(
    device: CudaDevice, bits: Any, slots: Any, count: int, sources: Any, first_slots: Any, work: Any
) -> None:
    """`kernels.sort.settle`, each splat against all others of its key; more than TIES stay."""
    _settle[BLOCKS, THREADS, device.stream](bits, slots, count, sources, first_slots, work)
    _settled[BLOCKS, THREADS, device.stream](work, count, slots)
