"""Distances along a graph from several sources, by Dijkstra's algorithm with a binary heap.

Source: Dijkstra 1959, "A note on two problems in connexion with graphs".
"""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.jit import serial


@serial(writes=("distance", "origin", "heap", "place"))
def spread(rows, neighbours, costs, sources, distance, origin, heap, place):
    """Compute the least cost from any source to each node, and the source that it comes from.

    Of equal costs, that of the node with the lowest number is taken first, so that the result does
    not depend on anything else.

    Args:
        rows, neighbours: Ends of the edges of each node, (n + 1,) i64 and (edges,) i32.
        costs: Cost of each edge, not negative, shape (edges,) f32; infinity closes it.
        sources: Distinct nodes, shape (s,) i64.
        distance: Initial cost of each source, and infinity elsewhere; receives costs, shape (n,)
            f32.
        origin: Receives the number of the source, -1 where none is reached, shape (n,) i32.
        heap, place: Scratch, shape (n,) i32 each.
    """
    n = distance.shape[0]
    for i in range(n):
        origin[i], place[i] = -1, -1
    size = 0
    for s in range(sources.shape[0]):
        node = sources[s]
        origin[node] = s
        heap[size], place[node] = node, size
        size += 1
        _up(heap, place, distance, size - 1)
    while size > 0:
        node = heap[0]
        size -= 1
        last = heap[size]
        place[node] = -2  # done
        if size > 0:
            heap[0], place[last] = last, 0
            _down(heap, place, distance, size)
        for e in range(rows[node], rows[node + 1]):
            other = neighbours[e]
            if place[other] == -2:
                continue
            cost = distance[node] + costs[e]
            if cost < distance[other]:
                distance[other], origin[other] = cost, origin[node]
                if place[other] < 0:
                    heap[size], place[other] = other, size
                    size += 1
                _up(heap, place, distance, place[other])


@serial
def _is_before(distance, a, b):
    """Return whether node a leaves the heap before node b."""
    return distance[a] < distance[b] or (distance[a] == distance[b] and a < b)


@serial
def _up(heap, place, distance, k):
    """Move the entry at k towards the top of the heap."""
    node = heap[k]
    while k > 0:
        above = (k - 1) // 2
        if not _is_before(distance, node, heap[above]):
            break
        heap[k] = heap[above]
        place[heap[k]] = k
        k = above
    heap[k], place[node] = node, k


@serial
def _down(heap, place, distance, size):
    """Move the top entry to its place."""
    k, node = 0, heap[0]
    while True:
        below = 2 * k + 1
        if below >= size:
            break
        if below + 1 < size and _is_before(distance, heap[below + 1], heap[below]):
            below += 1
        if not _is_before(distance, heap[below], node):
            break
        heap[k] = heap[below]
        place[heap[k]] = k
        k = below
    heap[k], place[node] = node, k


def geodesics(device, rows, neighbours, costs, sources, starts=None):
    """Return the least cost from any source to each node, f32, and the number of that source, i32.

    Args:
        device: Runs the kernel.
        rows, neighbours, costs, sources: See `spread`.
        starts: Initial cost of each source, shape (s,); None is 0.
    """
    n = len(rows) - 1
    distance = np.full(n, np.inf, np.float32)
    distance[sources] = 0 if starts is None else starts
    origin, heap, place = (np.empty(n, np.int32) for _ in range(3))
    device.run(spread, rows, neighbours, costs, sources, distance, origin, heap, place)
    return distance, origin
