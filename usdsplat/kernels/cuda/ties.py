"""Sort splats of equal sort keys.

They are sorted by their full depth, and those of equal depth by instance and row, so that the order
in memory does not matter. In a short run of equal keys, each splat is compared with all others. A
long run, for example of a flat field that faces the camera, is merge-sorted by a block of threads.
"""

from __future__ import annotations

from numba import cuda, int32

TIES = 1024
"""Maximum number of splats of a short run."""
MERGERS = 1024
"""Number of threads of a block that merges long runs."""
MERGING = 64
"""Number of blocks that merge long runs."""


@cuda.jit(device=True, inline="always")
def limit(keys, n, key, beyond):
    """Return the index of the first of n ascending keys that is >= `key`, or > `key` if `beyond`;
    n if there is none."""
    low, high = int32(0), int32(n)
    while low < high:
        middle = (low + high) >> 1
        if keys[middle] < key or (beyond and keys[middle] == key):
            low = middle + 1
        else:
            high = middle
    return low


@cuda.jit(device=True, inline="always")
def comes_before(a, b, depths, names):
    """Return whether item `a` is drawn before item `b` of the same key.

    depths: Depths of all items, f32; empty if keys are full depths. names: Unique numbers, i64.
    """
    if depths.shape[0] > 0 and depths[a] != depths[b]:
        return depths[a] < depths[b]
    return names[a] < names[b]


@cuda.jit(device=True)
def place_in_run(k, n, keys, order, depths, names, total, firsts):
    """Return the position of item order[k]. If its run is long, return k and list the run.

    Args:
        keys, order: Sorted keys and items; the first n entries are used.
        depths, names: See `comes_before`.
        total, firsts: Receive the number of long runs, (1,) i32, and the first index of each, in
            any order.
    """
    key = keys[k]
    if not ((k > 0 and keys[k - 1] == key) or (k + 1 < n and keys[k + 1] == key)):
        return int32(k)
    first, end = limit(keys, n, key, False), limit(keys, n, key, True)
    if end - first > TIES:
        if k == first:
            firsts[cuda.atomic.add(total, 0, 1)] = first
        return int32(k)
    to = first
    for j in range(first, end):
        if comes_before(order[j], order[k], depths, names):
            to += int32(1)
    return to


@cuda.jit(device=True)
def merge_run(first, end, source, target, depths, names):
    """Sort source[first:end] with all threads of a block; `target` is scratch there.

    Runs of one item are merged to runs of two, and so on: each item counts the items of the other
    half that come before it.
    """
    length = end - first
    width = int32(1)
    is_swapped = False
    while width < length:
        for i in range(cuda.threadIdx.x, length, cuda.blockDim.x):
            begin = i // (2 * width) * (2 * width)
            middle = min(begin + width, length)
            item = target[first + i] if is_swapped else source[first + i]
            in_front = i < middle
            start = middle if in_front else begin
            low, high = start, min(middle + width, length) if in_front else middle
            while low < high:
                at = (low + high) >> 1
                other = target[first + at] if is_swapped else source[first + at]
                if comes_before(other, item, depths, names):
                    low = at + 1
                else:
                    high = at
            own = i - begin if in_front else i - middle
            to = first + begin + own + low - start
            if is_swapped:
                source[to] = item
            else:
                target[to] = item
        cuda.syncthreads()
        is_swapped = not is_swapped
        width *= int32(2)
    if is_swapped:
        for i in range(first + cuda.threadIdx.x, end, cuda.blockDim.x):
            source[i] = target[i]
    cuda.syncthreads()
