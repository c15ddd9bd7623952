"""Bounding volume hierarchy of triangles: closest point queries and ray casts.

The tree is complete and stored in one array, the root in row 1 and the children of row i in 2i and
2i + 1. Level d splits the ordered triangles into 2^d runs of equal length, so the run of a node
follows from its row. For a mesh that moves, the boxes are computed again but the order is kept.
Traversal has no stack: the bits of one integer store the path.

Data are float32. Decisions are made in float64 without contraction, so that they are the same on
all devices.

Sources: Ericson 2005, "Real-Time Collision Detection" (distances); Áfra & Szirmay-Kalos 2014,
"Stackless Multi-BVH Traversal" (traversal); Woop et al. 2013, "Watertight Ray/Triangle
Intersection" (edges count for both triangles).
"""

from __future__ import annotations

import numpy as np

from ..jit import exact, serial
from ..launch import kernel

LEAF = 4
"""Largest number of triangles in a leaf."""

_SLACK = 1.0 - 1e-12
"""Factor on distances of boxes.

Boxes that are this much too far are visited too, as rounding could hide a triangle at equal
distance.
"""


# --- 1. mathematics: one triangle, one box ----------------------------------------------


@exact
def closest_on_segment(ax, ay, az, bx, by, bz):
    """Return (distance², parameter 0 to 1) of the point of a segment that is closest to the origin.

    The ends are sorted first, so that an edge gives the same bits for both its triangles.
    """
    swap = ax > bx or (ax == bx and (ay > by or (ay == by and az > bz)))
    if swap:
        ax, ay, az, bx, by, bz = bx, by, bz, ax, ay, az
    ex, ey, ez = bx - ax, by - ay, bz - az
    length = ex * ex + ey * ey + ez * ez
    along = -(ax * ex + ay * ey + az * ez)
    if along <= 0.0:
        distance, part = ax * ax + ay * ay + az * az, 0.0
    elif along >= length:
        distance, part = bx * bx + by * by + bz * bz, 1.0
    else:
        part = along / length
        x, y, z = ax + part * ex, ay + part * ey, az + part * ez
        distance = x * x + y * y + z * z
    return distance, 1.0 - part if swap else part


@exact
def closest_on_triangle(ax, ay, az, bx, by, bz, cx, cy, cz):
    """Return (distance², weight of b, weight of c) of the point of a triangle closest to the
    origin."""
    e0x, e0y, e0z = bx - ax, by - ay, bz - az
    e1x, e1y, e1z = cx - ax, cy - ay, cz - az
    nx, ny, nz = e0y * e1z - e0z * e1y, e0z * e1x - e0x * e1z, e0x * e1y - e0y * e1x
    area = nx * nx + ny * ny + nz * nz
    # Barycentric weights of the perpendicular's foot: areas of its triangles with the edges.
    v = nx * (az * e1y - ay * e1z) + ny * (ax * e1z - az * e1x) + nz * (ay * e1x - ax * e1y)
    w = nx * (ay * e0z - az * e0y) + ny * (az * e0x - ax * e0z) + nz * (ax * e0y - ay * e0x)
    is_flat = not area > 0.0
    by_ca, by_ab, by_bc = v < 0.0 or is_flat, w < 0.0 or is_flat, v + w > area or is_flat
    if not (by_ab or by_bc or by_ca):
        height = ax * nx + ay * ny + az * nz
        return height * height / area, v / area, w / area
    best, v, w = np.inf, 0.0, 0.0  # only edges with the foot on their outer side can be closest
    if by_ab:
        best, v = closest_on_segment(ax, ay, az, bx, by, bz)
    if by_bc:
        distance, part = closest_on_segment(bx, by, bz, cx, cy, cz)
        if distance < best:
            best, v, w = distance, 1.0 - part, part
    if by_ca:
        distance, part = closest_on_segment(cx, cy, cz, ax, ay, az)
        if distance < best:
            best, v, w = distance, 0.0, 1.0 - part
    return best, v, w


@exact
def hit_triangle(dx, dy, dz, ax, ay, az, bx, by, bz, cx, cy, cz):
    """Return (distance, weight of b, weight of c) for a ray from the origin.

    The distance is in lengths of the direction, -1 if the ray misses. Both sides and the edges
    count as hits.
    """
    u = dx * (cy * bz - cz * by) + dy * (cz * bx - cx * bz) + dz * (cx * by - cy * bx)
    v = dx * (ay * cz - az * cy) + dy * (az * cx - ax * cz) + dz * (ax * cy - ay * cx)
    w = dx * (by * az - bz * ay) + dy * (bz * ax - bx * az) + dz * (bx * ay - by * ax)
    total = u + v + w
    is_in = (u >= 0.0 and v >= 0.0 and w >= 0.0) or (u <= 0.0 and v <= 0.0 and w <= 0.0)
    if not is_in or total == 0.0:
        return -1.0, 0.0, 0.0
    u, v, w = u / total, v / total, w / total
    x, y, z = u * ax + v * bx + w * cx, u * ay + v * by + w * cy, u * az + v * bz + w * cz
    way = (x * dx + y * dy + z * dz) / (dx * dx + dy * dy + dz * dz)
    return way, v, w


@exact
def _beyond(x, low, high):
    return max(max(low - x, x - high), 0.0)


@exact
def distance_to_box(x, y, z, boxes, row):
    """Return the distance² of a point from a box, 0 inside."""
    dx = _beyond(x, np.float64(boxes[row, 0]), np.float64(boxes[row, 3]))
    dy = _beyond(y, np.float64(boxes[row, 1]), np.float64(boxes[row, 4]))
    dz = _beyond(z, np.float64(boxes[row, 2]), np.float64(boxes[row, 5]))
    return (dx * dx + dy * dy + dz * dz) * _SLACK


@exact
def _clip(x, direction, low, high, near, far):
    """Return the part (near, far) of a ray between two planes; near > far if there is none."""
    if direction == 0.0:
        return (near, far) if low <= x <= high else (1.0, 0.0)
    first, last = (low - x) / direction, (high - x) / direction
    if first > last:
        first, last = last, first
    return max(near, first * _SLACK if first > 0.0 else first), min(far, last / _SLACK)


@exact
def way_to_box(x, y, z, dx, dy, dz, boxes, row):
    """Return the distance at which a ray enters a box: 0 from inside, inf if it misses."""
    near, far = 0.0, np.inf
    near, far = _clip(x, dx, np.float64(boxes[row, 0]), np.float64(boxes[row, 3]), near, far)
    near, far = _clip(y, dy, np.float64(boxes[row, 1]), np.float64(boxes[row, 4]), near, far)
    near, far = _clip(z, dz, np.float64(boxes[row, 2]), np.float64(boxes[row, 5]), near, far)
    return near if near <= far else np.inf


# --- 2. CPU ----------------------------------------------------------------------------


@serial(writes=("order",))
def build_order(centres, order, depth):
    """Order triangles so that the run of each node is split at the median of its longest axis.

    Args:
        centres: Centres of the triangles, shape (t, 3) f32.
        order: The numbers 0 to t - 1, reordered in place, shape (t,) i32.
        depth: Number of levels of splits.
    """
    t = order.shape[0]
    for level in range(depth):
        for i in range(1 << level):
            first, end = (i * t) >> level, ((i + 1) * t) >> level
            middle = ((2 * i + 1) * t) >> (level + 1)
            axis, widest = 0, np.float32(-1)
            for a in range(3):
                low, high = np.float32(np.inf), np.float32(-np.inf)
                for k in range(first, end):
                    low, high = min(low, centres[order[k], a]), max(high, centres[order[k], a])
                if high - low > widest:
                    axis, widest = a, high - low
            low, high = first, end - 1
            while low < high:  # Hoare; equal centres are sorted by number
                pivot = order[(low + high) >> 1]
                at = centres[pivot, axis]
                a, b = low, high
                while a <= b:
                    while centres[order[a], axis] < at or (
                        centres[order[a], axis] == at and order[a] < pivot
                    ):
                        a += 1
                    while centres[order[b], axis] > at or (
                        centres[order[b], axis] == at and order[b] > pivot
                    ):
                        b -= 1
                    if a <= b:
                        order[a], order[b] = order[b], order[a]
                        a += 1
                        b -= 1
                if middle <= b:
                    high = b
                elif middle >= a:
                    low = a
                else:
                    break


@serial(writes=("boxes",))
def fit_boxes(corners, boxes):
    """Compute the bounding boxes of all nodes.

    Args:
        corners: Corners of the triangles in the tree's order, shape (t, 9) f32.
        boxes: Receives (low, high) of each node, shape (2 * leaves, 6) f32; row 0 is not used.
    """
    leaves, t = boxes.shape[0] // 2, corners.shape[0]
    for leaf in range(leaves):
        for a in range(3):
            low, high = np.float32(np.inf), np.float32(-np.inf)
            for k in range(leaf * t // leaves, (leaf + 1) * t // leaves):
                for c in range(a, 9, 3):
                    low, high = min(low, corners[k, c]), max(high, corners[k, c])
            boxes[leaves + leaf, a], boxes[leaves + leaf, a + 3] = low, high
    for row in range(leaves - 1, 0, -1):
        for a in range(3):
            boxes[row, a] = min(boxes[2 * row, a], boxes[2 * row + 1, a])
            boxes[row, a + 3] = max(boxes[2 * row, a + 3], boxes[2 * row + 1, a + 3])


@kernel(over="points", writes=("out",), exact=True)
def find_closest(i, points, limit, corners, faces, boxes, out):
    """Find the triangle closest to each point; among equally close ones, that of the lowest number.

    Args:
        points: Shape (n, 3) f32.
        limit: Distance² of the search.
        corners, boxes: See `fit_boxes`.
        faces: Numbers of the triangles in the tree's order, shape (t,) i32.
        out: Receives (faces (n,) i32, -1 if there is none within `limit`; weights of the three
            corners (n, 3) f32; distance² (n,) f32, inf if none; closest points (n, 3) f32).
    """
    t, leaves = corners.shape[0], boxes.shape[0] // 2
    out_faces, out_weights, out_squared, out_points = out
    x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
    best, found, at, bv, bw = limit, np.int32(-1), 0, 0.0, 0.0
    row, trail = 1, 0
    if not distance_to_box(x, y, z, boxes, row) <= best:
        row = 0
    while row > 0:
        if row >= leaves:
            leaf = row - leaves
            for k in range(leaf * t // leaves, (leaf + 1) * t // leaves):
                d, v, w = closest_on_triangle(
                    corners[k, 0] - x, corners[k, 1] - y, corners[k, 2] - z,
                    corners[k, 3] - x, corners[k, 4] - y, corners[k, 5] - z,
                    corners[k, 6] - x, corners[k, 7] - y, corners[k, 8] - z,
                )  # fmt: skip
                if d < best or (d == best and (found < 0 or faces[k] < found)):
                    best, found, at, bv, bw = d, faces[k], k, v, w
            is_end = True
        else:
            left = distance_to_box(x, y, z, boxes, 2 * row)
            right = distance_to_box(x, y, z, boxes, 2 * row + 1)
            is_end = min(left, right) > best
            if not is_end:
                row = 2 * row + (1 if right < left else 0)
                trail = 2 * trail + (1 if max(left, right) <= best else 0)
        while is_end and row > 0:
            while trail & 1 == 0 and row > 0:
                row >>= 1
                trail >>= 1
            if row > 0:
                row ^= 1
                trail ^= 1
                is_end = distance_to_box(x, y, z, boxes, row) > best
    out_faces[i], out_squared[i] = found, np.float32(best if found >= 0 else np.inf)
    u = 1.0 - bv - bw
    out_weights[i, 0], out_weights[i, 1], out_weights[i, 2] = u, bv, bw
    for a in range(3):
        out_points[i, a] = (
            u * corners[at, a] + bv * corners[at, a + 3] + bw * corners[at, a + 6]
            if found >= 0
            else points[i, a]
        )


@kernel(over="origins", writes=("out",), exact=True)
def find_hits(i, origins, directions, corners, faces, boxes, out):
    """Find the first triangle that each ray hits.

    Args:
        origins, directions: Shape (n, 3) f32; a ray with a direction of length 0 hits nothing.
        corners, faces, boxes: See `find_closest`.
        out: Receives (faces (n,) i32, -1 without a hit; weights (n, 3) f32; distance² (n,) f32, inf
            without a hit; points (n, 3) f32).
    """
    t, leaves = corners.shape[0], boxes.shape[0] // 2
    out_faces, out_weights, out_squared, out_points = out
    x, y, z = (
        np.float64(origins[i, 0]), np.float64(origins[i, 1]), np.float64(origins[i, 2])
    )  # fmt: skip
    dx, dy, dz = (
        np.float64(directions[i, 0]), np.float64(directions[i, 1]),
        np.float64(directions[i, 2]),
    )  # fmt: skip
    best, found, at, bv, bw = np.inf, np.int32(-1), 0, 0.0, 0.0
    row, trail = 1, 0
    if not dx * dx + dy * dy + dz * dz > 0.0:
        row = 0
    while row > 0:
        if row >= leaves:
            leaf = row - leaves
            for k in range(leaf * t // leaves, (leaf + 1) * t // leaves):
                way, v, w = hit_triangle(
                    dx, dy, dz,
                    corners[k, 0] - x, corners[k, 1] - y, corners[k, 2] - z,
                    corners[k, 3] - x, corners[k, 4] - y, corners[k, 5] - z,
                    corners[k, 6] - x, corners[k, 7] - y, corners[k, 8] - z,
                )  # fmt: skip
                if way >= 0.0 and (way < best or (way == best and faces[k] < found)):
                    best, found, at, bv, bw = way, faces[k], k, v, w
            is_end = True
        else:
            left = way_to_box(x, y, z, dx, dy, dz, boxes, 2 * row)
            right = way_to_box(x, y, z, dx, dy, dz, boxes, 2 * row + 1)
            is_end = not (min(left, right) <= best and min(left, right) < np.inf)
            if not is_end:
                row = 2 * row + (1 if right < left else 0)
                is_both = max(left, right) <= best and max(left, right) < np.inf
                trail = 2 * trail + (1 if is_both else 0)
        while is_end and row > 0:
            while trail & 1 == 0 and row > 0:
                row >>= 1
                trail >>= 1
            if row > 0:
                row ^= 1
                trail ^= 1
                is_end = way_to_box(x, y, z, dx, dy, dz, boxes, row) > best
    square = best * best * (dx * dx + dy * dy + dz * dz)
    out_faces[i], out_squared[i] = found, np.float32(square if found >= 0 else np.inf)
    u = 1.0 - bv - bw
    out_weights[i, 0], out_weights[i, 1], out_weights[i, 2] = u, bv, bw
    for a in range(3):
        out_points[i, a] = (
            u * corners[at, a] + bv * corners[at, a + 3] + bw * corners[at, a + 6]
            if found >= 0
            else origins[i, a]
        )
