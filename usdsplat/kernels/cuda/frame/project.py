"""Find the splats that a view sees, and write their records, in the order of storage.

`cull` marks blocks that the view cannot see. For the other blocks, a CUDA block processes a PART of
the splats of one instance. `see` sets a bit for each splat that touches the view. A prefix sum over
the parts then gives the position of each part's records, and `place` writes them. Both kernels
project a splat with the same bits, so only the marks are stored between them: the records need
memory for visible splats only.

The parts of a field follow from its number of splats and of instances. Those of nodes of splat
trees are listed in a table, so that nodes anywhere in one memory are drawn in one launch, and
another cut is another table.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import cuda, float32, int32, int64, uint64

from usdsplat.kernels.blocks import is_outside
from usdsplat.kernels.color import convert
from usdsplat.kernels.cuda.frame.load import (
    load_floats,
    load_packed,
    row_of,
    shade_floats,
    shade_packed,
    shade_packed_flat,
)
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.cuda.vectors import store4
from usdsplat.kernels.cuda.warp import FULL, below, votes
from usdsplat.kernels.fading import WHOLE
from usdsplat.kernels.project import (
    BLOCK,
    DEPTH,
    HALF_HEIGHT,
    HALF_WIDTH,
    LOG_OPACITY,
    ORTHOGRAPHIC,
    RECORD,
    SORT_DISTANCE,
    A,
    B,
    C,
    U,
    V,
    project_one,
    squared_distance,
)

PART = 256
"""Splats of a CUDA block, one per thread; divides a BLOCK, the splats that share a bounding box."""
WORDS = PART // 32
"""Number of 32-bit words with the marks of a part."""
F4, F8 = np.uint64(4), np.uint64(8)


@kernel
def cull(cameras, matrices, group, instance, instances, first, boxes, closed):
    """Set closed[first + item], u8, to whether a block of an instance is certainly invisible.

    For the other arguments see `make_see`.
    """
    item = cuda.grid(1)
    blocks = boxes.shape[0]
    if item < instances * blocks:
        m = matrices[instance + item // blocks]
        closed[first + item] = is_outside(cameras[group], m, boxes[item % blocks])


@cuda.jit(device=True, inline="always")
def count_of_field(item, first_block, parts, n, closed):
    """Return the number of splats of a part of a field; 0 if its block is closed."""
    part, owner = item % parts, item // parts
    blocks = (parts * PART + BLOCK - 1) // BLOCK
    if closed[first_block + owner * blocks + part * PART // BLOCK]:
        return int64(0)
    return int64(min(PART, n - part * PART))


@cuda.jit(device=True, inline="always")
def place_of_field(item, parts):
    """Return the first splat of a part of a field in memory, and its instance."""
    return int64(item % parts * PART), int64(item // parts)


@cuda.jit(device=True, inline="always")
def weight_in_field(item, parts):
    """Return the weight of a part of a field: fields are not faded."""
    return float32(1)


@cuda.jit(device=True, inline="always")
def name_in_field(splats, item, k, i, instance, owner):
    """Return a number of splat k of a part, i in memory, that ascends in drawing order: by
    instance, and row in the field."""
    return int64(instance + owner) << int64(32) | int64(row_of(splats, i))


@cuda.jit(device=True, inline="always")
def count_of_nodes(item, first_block, parts, n, closed):
    """Return the number of splats of a part of a node."""
    return int64(parts[item, 1])


@cuda.jit(device=True, inline="always")
def place_of_nodes(item, parts):
    """Return the first splat of a part of a node in memory, and its instance."""
    return int64(parts[item, 0]), int64(parts[item, 2])


@cuda.jit(device=True, inline="always")
def weight_in_nodes(item, parts):
    """Return the weight that fades a part of a node."""
    return float32(parts[item, 3]) * float32(1 / WHOLE)


@cuda.jit(device=True, inline="always")
def name_in_nodes(splats, item, k, i, instance, owner):
    """Return a number of splat k of a part that ascends in drawing order, which is that of the
    table."""
    return int64(instance) << int64(32) | int64(item * PART + k)


class Source(NamedTuple):
    """Functions that find the splats of a part."""

    suffix: str
    """Of the names of kernels."""
    count_of: Any
    place_of: Any
    weight_of: Any
    name_in: Any


FIELD = Source("", count_of_field, place_of_field, weight_in_field, name_in_field)
NODES = Source(",nodes", count_of_nodes, place_of_nodes, weight_in_nodes, name_in_nodes)


def make_see(load: Any, source: Source) -> Any:
    """Return the kernel that marks visible splats, for splats that are read with `load`.

    The arguments of the kernel:

    cameras: a CAMERA for each group. matrices: those of all instances, (m, 3, 4) f64.
    group, instance, first, first_block: number of the group, of its first instance, of its first
    part and of its first block.
    parts: parts of an instance; or the table of the parts of nodes, (parts, 4) i32: first splat in
    memory, number of splats, instance, weight in 1 / WHOLE. n: splats of an instance; unused for
    nodes. closed: written by `cull`; unused for nodes.
    splats: arrays of the splats. marks: receives marks, WORDS for each part, u32. found: receives
    the number of visible splats, (parts,) i32. totals, span: are reset.
    """

    count_of, place_of, weight_of = source.count_of, source.place_of, source.weight_of

    @kernel(name=f"cuda.frame.project.see({load.__name__}{source.suffix})", exact=True)
    def see(
        cameras, matrices, group, instance, first, first_block, parts, n, closed, splats, marks,
        found, totals, span,
    ):  # fmt: skip
        item, t = cuda.blockIdx.x, cuda.threadIdx.x
        if first + item + t == 0:  # the other counters are set by kernels launched after this one
            totals[1] = totals[3] = 0
            span[0], span[1] = float32(np.inf), float32(-np.inf)
        count = count_of(item, first_block, parts, n, closed)
        if count == 0:
            if t == 0:
                found[first + item] = 0
            return
        begin, owner = place_of(item, parts)
        cam, m = cameras[group], matrices[instance + owner]
        record = cuda.local.array(RECORD, float32)
        q, s = cuda.local.array(4, float32), cuda.local.array(3, float32)
        i = begin + t
        seen = int32(0)
        if t < count:
            opacity = load(splats, i, q, s)
            weight = weight_of(item, parts)
            if project_one(cam, m, splats[0][i], q, s, opacity, weight, record):
                seen = int32(1)
        word = votes(seen)
        if t % 32 == 0:
            marks[(first + item) * WORDS + t // 32] = word
        total = cuda.syncthreads_count(seen)
        if t == 0:
            found[first + item] = total

    return see


def make_place(load: Any, shade: Any, source: Source) -> Any:
    """Return the kernel that writes records, colours and keys of visible splats.

    `shade` computes the colour of splat i for a unit view direction. The arguments of the kernel
    besides those of `make_see`:

    sights: see `radiance`. degree: degree of the harmonics. conversions: (groups, 14) f32, the last
    number is 1 if colours are converted.
    starts: first record of each part, (parts + 1,). room: capacity for records.
    records: (room * RECORD,) f32, keys: (room,) f32, rows: (room,) i32 and names: (room,) i64,
    instance and row in the field: receive the values of each record.
    span: (2,) f32, widened to contain all keys. totals: receives the number of records in [0].
    """

    place_of, weight_of, name_in = source.place_of, source.weight_of, source.name_in

    @kernel(name=f"cuda.frame.project.place({shade.__name__}{source.suffix})", exact=True)
    def place(
        cameras, matrices, sights, conversions, group, instance, first, parts, degree, splats,
        marks, found, starts, room, records, keys, rows, names, span, totals,
    ):  # fmt: skip
        item, t = cuda.blockIdx.x, cuda.threadIdx.x
        count, start = found[first + item], starts[first + item]
        if t == 0 and first + item == starts.shape[0] - 2:
            totals[0] = start + count  # this is the last part
        if count == 0:
            return
        begin, owner = place_of(item, parts)
        at, lane = start, t % 32
        for k in range(t // 32):
            at += int32(cuda.popc(marks[(first + item) * WORDS + k]))
        word = marks[(first + item) * WORDS + t // 32]
        at += int32(cuda.popc(np.uint32(word & below(lane))))
        if word >> np.uint32(lane) & np.uint32(1) and at < room:
            rows[at] = begin + t
        cuda.syncthreads()
        cam, m, sight, numbers = (
            cameras[group], matrices[instance + owner], sights[instance + owner],
            conversions[group],
        )  # fmt: skip
        near_far = cuda.shared.array(2, float32)
        if t == 0:
            near_far[0], near_far[1] = float32(np.inf), float32(-np.inf)
        cuda.syncthreads()
        record = cuda.local.array(RECORD, float32)
        q, s = cuda.local.array(4, float32), cuda.local.array(3, float32)
        color = cuda.local.array(3, float32)
        by_distance = cam.sorting == SORT_DISTANCE and cam.projection != ORTHOGRAPHIC
        near, far = float32(np.inf), float32(-np.inf)
        at = start + t
        if t < count and at < room:
            i = rows[at]
            opacity = load(splats, i, q, s)
            project_one(cam, m, splats[0][i], q, s, opacity, weight_of(item, parts), record)
            shade(splats, i, sight, degree, color)
            r, g, b = color[0], color[1], color[2]
            if numbers[13] > float32(0):
                r, g, b = convert(r, g, b, numbers)
            to = uint64(at) * uint64(RECORD)
            store4(records, to, record[U], record[V], record[A], record[B])
            store4(
                records, to + F4, record[C], record[LOG_OPACITY], record[HALF_WIDTH],
                record[HALF_HEIGHT],
            )  # fmt: skip
            store4(records, to + F8, r, g, b, record[DEPTH])
            names[at] = name_in(splats, item, i - begin, i, instance, owner)
            key = squared_distance(m, splats[0][i]) if by_distance else record[DEPTH]
            keys[at] = near = far = key
        for shift in (16, 8, 4, 2, 1):
            near = min(near, cuda.shfl_xor_sync(FULL, near, shift))
            far = max(far, cuda.shfl_xor_sync(FULL, far, shift))
        if lane == 0:
            cuda.atomic.min(near_far, 0, near)
            cuda.atomic.max(near_far, 1, far)
        cuda.syncthreads()
        if t == 0 and near_far[0] <= near_far[1]:
            cuda.atomic.min(span, 0, near_far[0])
            cuda.atomic.max(span, 1, near_far[1])

    return place


SEE = {False: make_see(load_floats, FIELD), True: make_see(load_packed, FIELD)}
"""Whether splats are packed -> the kernel that finds visible ones."""
_FLOATS = make_place(load_floats, shade_floats, FIELD)
PLACE = {
    (False, False): _FLOATS,
    (False, True): _FLOATS,
    (True, False): make_place(load_packed, shade_packed_flat, FIELD),
    (True, True): make_place(load_packed, shade_packed, FIELD),
}
"""(Whether splats are packed, whether they have degrees above 0) -> the kernel that writes
records."""
SEE_NODES = make_see(load_floats, NODES)
PLACE_NODES = make_place(load_floats, shade_floats, NODES)
