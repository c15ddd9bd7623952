"""Choose the outer side of all splats together.

The signs s of normals maximise the sum of `pull` s over splats and of `link` s s' over neighbours:
`pull` says which side of a splat is preferred, `link` how surely two neighbours are on the same
sheet. The sum is maximised greedily: again and again, all nodes of a graph join the neighbour, or
the ground whose sign is +, to which their link is strongest, and parallel links are added up.

Source: Hoppe et al. 1992, "Surface reconstruction from unorganized points", for the graph; Keuper
et al. 2015, "Efficient decomposition of image and mesh graphs by lifted multicuts", for the greedy
contraction; Boruvka 1926, for contracting all nodes at once.
"""

from __future__ import annotations

import math

import numpy as np

from usdsplat.kernels.jit import routine, scalar, serial
from usdsplat.kernels.launch import kernel
from usdsplat.kernels.normals.openness import BEST, LIGHT, SKY
from usdsplat.kernels.normals.smoothing import dot

NEAREST = 8
"""Number of neighbours to which a splat is linked."""
PULL = 0.3
"""Weight of the pull relative to that of a link."""
SHEET = 4.0
"""Power of the flatness of both splats by which a link counts."""
CLOSED, AJAR = 0.2, 0.4
"""Ratio of the light of the darker and the brighter side below which a surface is closed, and above
which it is open on both sides."""
INWARD = 0.3
"""Weight of the side towards the middle of the capture, which a surface faces that is open on both
sides: ground faces what stands on it."""
UNIT = 1 << 20
"""Links and pulls are whole multiples of 1 / UNIT: sums of them do not depend on their order."""

# --- 1. mathematics ---------------------------------------------------------------------


@scalar
def preference(positions, middle, extent, normals, views, flat, i):
    """Return a number in [-1, 1], positive if the normal of splat `i` is on the preferred side.

    In fuzzy matter that is the more open side. A closed surface has it outside. A sheet that is
    open on both sides, such as ground, faces the middle of the capture.
    """
    nx, ny, nz = np.float64(normals[i, 0]), np.float64(normals[i, 1]), np.float64(normals[i, 2])
    best = nx * views[i, BEST] + ny * views[i, BEST + 1] + nz * views[i, BEST + 2]
    light = nx * views[i, LIGHT] + ny * views[i, LIGHT + 1] + nz * views[i, LIGHT + 2]
    brighter = views[i, SKY] + 0.5 * abs(light)
    ratio = (views[i, SKY] - 0.5 * abs(light)) / brighter if brighter > 0 else 1.0
    closed = min(max((AJAR - ratio) / (AJAR - CLOSED), 0.0), 1.0)
    x, y, z = middle[0] - positions[i, 0], middle[1] - positions[i, 1], middle[2] - positions[i, 2]
    inward = x * nx + y * ny + z * nz
    inward /= max(extent, math.sqrt(x * x + y * y + z * z))
    inward = inward if math.isfinite(inward) else 0.0
    sheet = light * closed + INWARD * inward * (1 - closed)
    fuzzy, even = (1 - flat) * (1 - flat), flat * flat
    return fuzzy * best * abs(best) + even * even * sheet


# --- 2. links ---------------------------------------------------------------------------


@kernel(over="normals", writes=("weights", "pull"))
def links(
    i, positions, middle, extent, normals, flatness, views, neighbors, distances, weights, pull,
):  # fmt: skip
    """Compute how splats are linked to their neighbours, and which side they prefer.

    Args:
        positions: (n, 3) f32.
        middle: Middle of the capture, (3,) f64.
        extent: Half its width, in the unit of positions.
        normals: (n, 3) f32.
        flatness: (n,) f32.
        views: See `smoothing.begin`.
        neighbors: See `planes.planes`.
        distances: In the unit of positions, (n, k) f32.
        weights: Receives the links to the nearest neighbours, from -UNIT to UNIT, (n, NEAREST) i32:
            negative if the normals have opposite signs, 0 for none.
        pull: Receives positive numbers where the normal is on the preferred side, (n,) i64.
    """
    for c in range(weights.shape[1]):
        weights[i, c] = 0
        j = neighbors[i, c + 1]
        if j < 0 or j == i:
            continue
        cosine = dot(normals, i, normals, j)
        if distances[i, c + 1] > 0:
            inverse = 1.0 / np.float64(distances[i, c + 1])
            x = (np.float64(positions[j, 0]) - positions[i, 0]) * inverse
            y = (np.float64(positions[j, 1]) - positions[i, 1]) * inverse
            z = (np.float64(positions[j, 2]) - positions[i, 2]) * inverse
            a = x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2]
            b = x * normals[j, 0] + y * normals[j, 1] + z * normals[j, 2]
            cosine *= max(1.0 - max(a * a, b * b), 0.0)
        sheet = (np.float64(flatness[i]) * flatness[j]) ** SHEET
        weights[i, c] = np.int32(round(cosine * abs(cosine) * sheet * UNIT))
    flat = np.float64(flatness[i])
    prefers = preference(positions, middle, extent, normals, views, flat, i)
    pull[i] = np.int64(round(PULL * prefers * UNIT))


# --- 3. contraction ---------------------------------------------------------------------


@serial(writes=("starts", "others", "weights"))
def collect(one_way, neighbors, starts, others, weights):
    """Collect the links of each splat in both directions.

    Args:
        one_way: `weights` of `links`.
        neighbors: See `planes.planes`.
        starts: Receives the first entry of each splat and, last, their number, (n + 1,) i64.
        others: Receives the linked splats, (2 n NEAREST,) i32.
        weights: Receives the links, (2 n NEAREST,) i64.
    """
    n, most = one_way.shape
    starts[:] = 0
    for i in range(n):
        for c in range(most):
            if one_way[i, c] != 0:
                starts[i] += 1
                starts[neighbors[i, c + 1]] += 1
    _begin_lists(starts)
    for i in range(n):
        for c in range(most):
            if one_way[i, c] != 0:
                j = neighbors[i, c + 1]
                _append(starts, others, weights, i, j, one_way[i, c])
                _append(starts, others, weights, j, i, one_way[i, c])
    _end_lists(starts)


@serial(writes=("weights", "parent", "sign", "mark"))
def choose(count, starts, others, weights, pull, parent, sign, mark):
    """Add up parallel links of each node, and find the strongest.

    Of equally strong links the one between the lowest nodes is chosen, so that nodes never choose
    each other in a circle of more than two. Of two nodes that choose each other, the lower one
    stays.

    Args:
        count: Number of nodes; the ground has number `count`.
        starts, others, weights: Links of each node, see `collect`. Parallel ones are added up in
            the first; the others become 0.
        pull: Links to the ground, (n,) i64.
        parent: Receives the node that each node joins, (n + 1,) i32; itself if it stays.
        sign: Receives its sign relative to that node, (n + 1,) i8.
        mark: Scratch, -1 before and after, (n,) i64.

    Returns:
        The number of nodes that join another one.
    """
    for a in range(count):
        for e in range(starts[a], starts[a + 1]):
            b = others[e]
            if mark[b] >= 0:
                weights[mark[b]] += weights[e]
                weights[e] = 0
            else:
                mark[b] = e
        choice, strength = count, pull[a]
        for e in range(starts[a], starts[a + 1]):
            b, w = others[e], weights[e]
            mark[b] = -1
            low, lowest = min(a, b), min(a, choice)
            is_lower = low < lowest or (low == lowest and max(a, b) < max(a, choice))
            if abs(w) > abs(strength) or (abs(w) == abs(strength) and is_lower):
                choice, strength = b, w
        parent[a], sign[a] = (choice, 1 if strength > 0 else -1) if strength != 0 else (a, 1)
    parent[count], sign[count] = count, 1
    joined = 0
    for a in range(count):
        b = parent[a]
        if b > a and parent[b] == a:
            parent[a], sign[a] = a, 1
        joined += parent[a] != a
    return joined


@serial(writes=("parent", "sign", "number"))
def find_roots(count, parent, sign, number):
    """Let each node point to the node that it ends up in, and number those.

    Args:
        count, parent, sign: See `choose`. `parent` becomes the last node of each path, and `sign`
            the sign relative to it.
        number: Receives the new number of nodes that stay, ascending; the ground is the last,
            (n + 1,) i32.

    Returns:
        The new number of nodes.
    """
    for a in range(count):
        root, total = a, np.int8(1)
        while parent[root] != root:
            total *= sign[root]
            root = parent[root]
        node = a
        while parent[node] != node:
            following, rest = parent[node], np.int8(total * sign[node])
            parent[node], sign[node] = root, total
            node, total = following, rest
    left = 0
    for a in range(count + 1):
        if parent[a] == a:
            number[a] = left
            left += 1
    return left - 1


@serial(writes=("label", "side"))
def relabel(parent, sign, number, label, side):
    """Update the node of each splat and its sign relative to it, (n,) i32 and (n,) i8.

    Args:
        parent, sign, number: Results of `find_roots`.
    """
    for i in range(label.shape[0]):
        node = label[i]
        side[i] *= sign[node]
        label[i] = number[parent[node]]


@serial(writes=("pull", "new_pull", "new_starts", "new_others", "new_weights"))
def contract(
    count, starts, others, weights, pull, parent, sign, number, left, new_pull, new_starts,
    new_others, new_weights,
):  # fmt: skip
    """Build the links between the nodes that are left.

    Args:
        count, starts, others, weights, pull: Before, see `choose`.
        parent, sign, number: Results of `find_roots`.
        left: New number of nodes.
        new_pull, new_starts, new_others, new_weights: Receive the same of the new nodes.
    """
    new_pull[:left] = 0
    new_starts[: left + 1] = 0
    for a in range(count):
        to = number[parent[a]]
        if to == left:
            continue
        new_pull[to] += pull[a] * sign[a]
        for e in range(starts[a], starts[a + 1]):
            other = number[parent[others[e]]]
            if other == left:
                new_pull[to] += weights[e] * sign[a] * sign[others[e]]
            elif other != to and weights[e] != 0:
                new_starts[to] += 1
    _begin_lists(new_starts[: left + 1])
    for a in range(count):
        to = number[parent[a]]
        if to == left:
            continue
        for e in range(starts[a], starts[a + 1]):
            other = number[parent[others[e]]]
            if other != left and other != to and weights[e] != 0:
                weight = weights[e] * sign[a] * sign[others[e]]
                _append(new_starts, new_others, new_weights, to, other, weight)
    _end_lists(new_starts[: left + 1])


@routine
def _begin_lists(starts):
    """Turn the sizes of lists into the first entry of each; the last is the number of entries."""
    total = 0
    for a in range(starts.shape[0]):
        here = starts[a]
        starts[a] = total
        total += here


@scalar
def _append(starts, others, weights, a, b, weight):
    """Append an entry to the list of `a`; `starts` is its next free entry."""
    others[starts[a]] = b
    weights[starts[a]] = weight
    starts[a] += 1


@routine
def _end_lists(starts):
    """Undo the advance of `_append`: the next free entry of a list is the first of the next."""
    for a in range(starts.shape[0] - 1, 0, -1):
        starts[a] = starts[a - 1]
    starts[0] = 0
