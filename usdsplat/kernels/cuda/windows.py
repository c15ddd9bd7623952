"""Keep the contributions of a pixel that wait for their turn, in windows on a GPU.

A window consists of depths and places in the list, shape (slots, threads), and each thread has a
column. Short windows are sorted rings, where most contributions are inserted near the end. Long
ones are binary heaps.
"""

from __future__ import annotations

from numba import cuda


@cuda.jit(device=True)
def _is_before(depth, place, other_depth, other, ranks, begin):
    """Return whether a contribution is in front of another one; equal depths go by rank."""
    if depth == other_depth:
        return ranks[begin + place] < ranks[begin + other]
    return depth < other_depth


@cuda.jit(device=True)
def insert(window, thread, head, held, depth, place, ranks, begin):
    """Insert a contribution into a sorted window, a ring that begins at `head`."""
    depths, places = window
    last = depths.shape[0] - 1
    at = head + held
    at = at - depths.shape[0] if at > last else at
    for _ in range(held):
        before = at - 1 if at > 0 else last
        front, waiting = depths[before, thread], places[before, thread]
        if _is_before(front, waiting, depth, place, ranks, begin):
            break
        depths[at, thread], places[at, thread] = front, waiting
        at = before
    depths[at, thread], places[at, thread] = depth, place


@cuda.jit(device=True)
def push(window, thread, held, depth, place, ranks, begin):
    """Insert a contribution into a long window, a binary heap of `held` contributions."""
    depths, places = window
    at = held
    while at > 0:
        above = (at - 1) >> 1
        front, waiting = depths[above, thread], places[above, thread]
        if _is_before(front, waiting, depth, place, ranks, begin):
            break
        depths[at, thread], places[at, thread] = front, waiting
        at = above
    depths[at, thread], places[at, thread] = depth, place


@cuda.jit(device=True)
def pop(window, thread, held, ranks, begin):
    """Remove the first contribution of a binary heap of `held` contributions."""
    depths, places = window
    last = held - 1
    depth, place = depths[last, thread], places[last, thread]
    at, below = 0, 1
    while below < last:
        front, waiting = depths[below, thread], places[below, thread]
        if below + 1 < last:
            other, its_place = depths[below + 1, thread], places[below + 1, thread]
            if _is_before(other, its_place, front, waiting, ranks, begin):
                below, front, waiting = below + 1, other, its_place
        if _is_before(depth, place, front, waiting, ranks, begin):
            break
        depths[at, thread], places[at, thread] = front, waiting
        at, below = below, 2 * below + 1
    depths[at, thread], places[at, thread] = depth, place
