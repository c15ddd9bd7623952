"""Project splats on a GPU, with a block of threads for each block of slots.

Threads take splats in the order of rows, and votes determine their slots. Visible splats are packed
to the front in the order of rows, as on the CPU.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from usdsplat.kernels.crop import is_left
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.project import (
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

THREADS = 128
WARPS = THREADS // 32
ALL_LANES = 0xFFFFFFFF


@kernel(exact=True)  # like `frame.project`: both must find the same splats, in the same order
def _project(
    camera, matrices, weights, volumes, crops, rows, positions, rotations, scales, opacities,
    closed, block, base, out, found,
):  # fmt: skip
    records, keys, sources = out
    seen_of = cuda.shared.array(WARPS, np.int32)
    record = cuda.local.array(RECORD, np.float32)
    thread = cuda.threadIdx.x
    warp = thread // 32
    cam = camera[0]
    n = positions.shape[0]
    blocks = (n + block - 1) // block
    item = cuda.blockIdx.x
    m = matrices[item // blocks]
    weight = np.float32(1)
    if weights.shape[0] > 0:
        weight = weights[item // blocks]
    first = (item % blocks) * block
    end = min(first + block, n)
    if closed.shape[0] > 0 and closed[item]:
        end = first
    slot = base + item * block
    count = 0
    for begin in range(first, end, THREADS):
        i = begin + thread
        is_seen = False
        if i < end and (
            volumes.shape[0] == 0 or is_left(volumes, crops[item // blocks], positions[i])
        ):
            is_seen = project_one(
                cam, m, positions[i], rotations[i], scales[i], opacities[i], weight, record
            )
        votes = np.uint32(cuda.ballot_sync(ALL_LANES, is_seen))
        at = slot + count + cuda.popc(np.uint32(votes & cuda.lanemask_lt()))
        if thread % 32 == 0:
            seen_of[warp] = cuda.popc(votes)
        cuda.syncthreads()
        for w in range(WARPS):
            if w < warp:
                at += seen_of[w]
            count += seen_of[w]
        if is_seen:
            for c in (U, V, A, B, C, LOG_OPACITY, HALF_WIDTH, HALF_HEIGHT, DEPTH):
                records[at, c] = record[c]
            if cam.sorting == SORT_DISTANCE and cam.projection != ORTHOGRAPHIC:
                keys[at] = squared_distance(m, positions[i])
            else:
                keys[at] = record[DEPTH]
            sources[at] = rows[i] if rows.shape[0] > 0 else i
        cuda.syncthreads()
    if thread == 0:
        found[item] = count


def project(device: CudaDevice, *args: Any) -> None:
    """Project all instances of one field, see `kernels.project.project`."""
    found = args[-1]
    if found.shape[0] > 0:
        _project[found.shape[0], THREADS, device.stream](*args)
