"""Sort the contributions of a pixel by the depths of their ray hits on a GPU.

Contributions arrive nearly sorted, see `quarter_lists`, and wait in the pixel's window until
`walk_block` can process them. The windows of a block are two arrays, depths and places (indices in
the list), of shape (slots, threads); each thread has a column. Short windows are sorted rings,
because most contributions are inserted near the end. Long windows are binary heaps.
"""

from __future__ import annotations

from numba import cuda


@cuda.jit(device=True)
def _is_before(depth, place, other_depth, other, ranks, begin):
    """Return whether a contribution is in front of another one, by depth, then by rank."""
    if depth == other_depth:
        return ranks[begin + place] < ranks[begin + other]
    return depth < other_depth


@cuda.jit(device=True)
def insert(window, thread, head, held, depth, place, ranks, begin):
    """Insert a contribution into a short window, a sorted ring that begins at `head`."""
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
    """Remove the nearest contribution from a long window, a binary heap of `held` contributions."""
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
