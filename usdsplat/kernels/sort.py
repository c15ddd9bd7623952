"""Sort splats by depth: pack the visible splats, sort them by key, and gather their records in that
order.

The sort is a stable radix sort of the bits of float32 keys. The lowest key is subtracted: depths of
a picture differ in about 24 bits, which are two passes of 12. Splats enter in the order
of prim path and row, and stability keeps that order among equal keys. A picture is therefore
reproducible.

Source: Knuth, TAOCP vol. 3, 5.2.5; Satish et al. 2009 for the chunked histograms.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from .jit import launcher, parallel, scalar, serial
from .lanes import fetch
from .launch import kernel

DIGIT_BITS = 12
"""Maximum number of bits by which a pass sorts. Counters of more do not fit the fastest cache."""
DIGITS = 1 << DIGIT_BITS
FEW = 16
"""Number of equal keys up to which they are sorted by insertion, which allocates nothing."""
AHEAD = 16
"""Number of rows between prefetching and copying a row."""


# --- 2. CPU ----------------------------------------------------------------------------


@serial(writes=("visible",), gpu="sort.visible_slots")
def visible_slots(found, starts, blocks, visible):
    """List the used slots in order. Return their number.

    Args:
        found: Visible splats per block, shape (k,).
        starts: First slot of each block, shape (k,) i64.
        blocks: k, the number of blocks.
        visible: Receives slots, i32, room for all.
    """
    count = 0
    for b in range(blocks):
        start = starts[b]
        for i in range(found[b]):
            visible[count] = start + i
            count += 1
    return count


@scalar
def ordered_bits(bits):
    """Return the bits of a float32 as an unsigned number that sorts as the float does; -0 is 0."""
    sign = np.uint32(0x80000000)
    if bits == sign:
        return sign
    return np.uint32(bits ^ np.uint32(0xFFFFFFFF)) if bits & sign else np.uint32(bits | sign)


@parallel(writes=("work", "histogram"))
def take_keys(visible, count, keys, chunks, work, histogram):
    """Start a sort: write the bits of the keys, and the slots, to the first half of `work`. Return
    the lowest and the highest bits. For the arguments see `depth_order`."""
    bits, slots = work
    raw = keys.view(np.uint32)
    for t in prange(chunks):
        low, high = np.uint32(0xFFFFFFFF), np.uint32(0)
        keyed, held = bits[0], slots[0]
        for k in range(count * t // chunks, count * (t + 1) // chunks):
            slot = visible[k]
            key = ordered_bits(raw[np.uint64(slot)])
            low = key if key < low else low
            high = key if key > high else high
            keyed[np.uint64(k)] = key
            held[np.uint64(k)] = slot
        histogram[t, 0], histogram[t, 1] = low, high
    lowest, highest = np.int64(0xFFFFFFFF), np.int64(0)
    for t in range(chunks):
        lowest, highest = min(lowest, histogram[t, 0]), max(highest, histogram[t, 1])
    return lowest, highest


@parallel(writes=("histogram",))
def count_digits(bits, count, lowest, shift, width, chunks, histogram):
    """Find where each chunk writes its keys of each digit: those `width` bits from bit `shift`.

    Args:
        bits: Bits of the keys in their present order, shape (>= count,) u32.
        lowest: Subtracted from them.
        histogram: Receives the places, shape (chunks, DIGITS) i64.
    """
    low, mask, digits = np.uint32(lowest), np.uint32((1 << width) - 1), 1 << width
    for t in prange(chunks):
        row = histogram[t]
        row[:digits] = 0
        for k in range(count * t // chunks, count * (t + 1) // chunks):
            row[((bits[np.uint64(k)] - low) >> np.uint32(shift)) & mask] += 1
    total = 0
    for d in range(digits):
        for t in range(chunks):
            here = histogram[t, d]
            histogram[t, d] = total
            total += here


@parallel(writes=("histogram", "to_bits", "to_slots"))
def move_by_digit(bits, slots, count, lowest, shift, width, chunks, histogram, to_bits, to_slots):
    """Move keys and slots to their places, see `count_digits`, whose `histogram` is changed."""
    low, mask = np.uint32(lowest), np.uint32((1 << width) - 1)
    for t in prange(chunks):
        row = histogram[t]
        for k in range(count * t // chunks, count * (t + 1) // chunks):
            key = bits[np.uint64(k)]
            d = ((key - low) >> np.uint32(shift)) & mask
            to = np.uint64(row[d])
            row[d] += 1
            to_bits[to] = key
            to_slots[to] = slots[np.uint64(k)]


def _go_on():
    """Do nothing between the steps of a sort."""


@launcher(writes=("work", "histogram"), gpu="sort.depth_order")
def depth_order(visible, count, keys, chunks, work, histogram, between=_go_on):
    """Sort slots by key, stably. Return which of the two halves of `work` holds the result.

    Args:
        visible: Slots in tie order, shape (>= count,) i32.
        keys: Key of each slot, f32, no NaN.
        chunks: Number of chunks of a pass; any number gives the same result.
        work: (key bits (2, count) u32, slots (2, count) i32).
        histogram: Scratch, shape (chunks, DIGITS) i64.
        between: Called between the steps; not on a GPU.
    """
    bits, slots = work
    lowest, highest = take_keys(visible, count, keys, chunks, work, histogram)
    used = max(highest - lowest, 0).bit_length()
    passes = -(-used // DIGIT_BITS)
    width = -(-used // max(passes, 1))
    source = 0
    for digit in range(passes):
        to, shift = 1 - source, width * digit
        between()
        count_digits(bits[source], count, lowest, shift, width, chunks, histogram)
        between()
        move_by_digit(
            bits[source], slots[source], count, lowest, shift, width, chunks, histogram, bits[to],
            slots[to],
        )  # fmt: skip
        source = to
    return source


@kernel(over="sources", writes=("sources",))
def name_rows(at, rows, sources):
    """Convert rows of a subset, which a splat budget selects, to rows of the field.

    Args:
        rows: Row in the field of each splat of the subset, shape (n,) i32, n > 0.
        sources: Rows of the subset by slot, arbitrary for unused slots; changed in place, i32.
    """
    sources[at] = rows[min(max(sources[at], 0), rows.shape[0] - 1)]


@kernel(over="order", writes=("out",))
def gather(k, order, records, out):
    """Set out[k] to records[order[k]], so that blending reads memory in order."""
    width = np.uint64(records.shape[1])
    at, slot = np.uint64(k), np.uint64(order[k])
    if k + AHEAD < order.shape[0]:
        later = np.uint64(order[k + AHEAD]) * width
        fetch(records, later)
        fetch(records, later + width - np.uint64(1))
    c = np.uint64(0)
    while c + np.uint64(3) < width:  # four at a time: one register
        d, e, f = c + np.uint64(1), c + np.uint64(2), c + np.uint64(3)
        first, second = records[slot, c], records[slot, d]
        third, fourth = records[slot, e], records[slot, f]
        out[at, c], out[at, d], out[at, e], out[at, f] = first, second, third, fourth
        c += np.uint64(4)
    while c < width:
        out[at, c] = records[slot, c]
        c += np.uint64(1)


@serial(writes=("slots", "work"), gpu="sort.settle")
def settle(bits, slots, count, sources, first_slots, work):
    """Sort splats of equal keys by appearance, then by row.

    If all splats are stored in the order of rows, the stable depth sort has already done so.

    Args:
        bits, slots: Results of `depth_order`, shape (>= count,); slots are changed in place.
        sources: Each slot's row in its field.
        first_slots: First slot of each appearance, ascending, i64.
        work: Scratch, shape (>= count,) i64.
    """
    first = 0
    for k in range(1, count + 1):
        if k < count and bits[k] == bits[first]:
            continue
        if k - first > 1:
            for i in range(first, k):
                drawn = np.searchsorted(first_slots, slots[i], side="right")
                work[i] = np.int64(drawn) << 32 | np.int64(sources[slots[i]])
            if k - first <= FEW:
                for i in range(first + 1, k):
                    place, slot, j = work[i], slots[i], i
                    while j > first and work[j - 1] > place:
                        work[j], slots[j] = work[j - 1], slots[j - 1]
                        j -= 1
                    work[j], slots[j] = place, slot
            else:
                order = np.argsort(work[first:k], kind="mergesort")
                for i in range(k - first):
                    work[first + i] = slots[first + order[i]]
                for i in range(first, k):
                    slots[i] = work[i]
        first = k
