"""Make loops for the threads of a GPU from functions of one item."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from numba import cuda

from usdsplat.kernels.cuda.jit import kernel
from usdsplat.kernels.launch import ROUND, BlockArray, Kernel, Reduction

THREADS = 128
"""Number of threads of a block."""
BLOCKS = 132 * 16
"""Maximum number of blocks of a launch, which fills any GPU. The loops process the remaining
items."""


@functools.cache
def gpu_loop(given: Kernel) -> Any:
    """Return the GPU's kernel of a function of one item.

    It is called with the size and a tuple of arguments. A reduction's is called with the size, the
    number of blocks, their results and the arguments.
    """
    item = given.item
    if isinstance(given, Reduction):
        return kernel(given.named(_blocks_to_numbers(given)), made_of=(__name__,))

    def items(n, args):
        for i in range(cuda.grid(1), n, cuda.gridsize(1)):
            item(i, *args)

    def pixels(size, args):
        rows, columns = size
        for k in range(cuda.grid(1), rows * columns, cuda.gridsize(1)):
            item(k // columns, k % columns, *args)

    def blocks(n, args):
        for i in range(cuda.grid(1), n, cuda.gridsize(1)):
            item(i, i + 1, *args)

    def teams(n, args):
        for i in range(cuda.blockIdx.x, n, cuda.gridDim.x):
            item(i, cuda.threadIdx.x, cuda.blockDim.x, *args)

    if given.team:
        loop = teams
    elif given.scratch:
        loop = _blocks_with_scratch(item, given.scratch)
    elif given.block:
        loop = blocks
    else:
        loop = items if given.axes == 1 else pixels
    return kernel(given.named(loop), made_of=(__name__,), exact=given.exact)


def grid_of(count: int) -> int:
    """Return the number of blocks of threads of a launch over `count` items."""
    return max(1, min(BLOCKS, -(-count // THREADS)))


def _blocks_with_scratch(item: Any, scratch: tuple[BlockArray, ...]) -> Callable[..., None]:
    shape, dtype = scratch[0].sized(1), scratch[0].dtype

    def with_one(n, args):
        own = cuda.local.array(shape, dtype)
        for i in range(cuda.grid(1), n, cuda.gridsize(1)):
            item(i, i + 1, own, *args)

    if len(scratch) == 1:
        return with_one
    shape2, dtype2 = scratch[1].sized(1), scratch[1].dtype

    def with_two(n, args):
        one, two = cuda.local.array(shape, dtype), cuda.local.array(shape2, dtype2)
        for i in range(cuda.grid(1), n, cuda.gridsize(1)):
            item(i, i + 1, one, two, *args)

    return with_two


def _blocks_to_numbers(given: Reduction) -> Callable[..., None]:
    """Return the loop of a reduction, with one result for each block.

    Source: Harris 2007, "Optimizing parallel reduction in CUDA".
    """
    item, combine, dtype = given.item, given.combine, given.dtype

    def loop(n, blocks, partial, args):
        totals = cuda.shared.array(THREADS, dtype)
        me, threads = cuda.threadIdx.x, cuda.blockDim.x
        for k in range(cuda.blockIdx.x, blocks, cuda.gridDim.x):
            total = dtype(0)
            for i in range(k * ROUND + me, min(n, (k + 1) * ROUND), threads):
                total = combine(total, item(i, *args))
            totals[me] = total
            cuda.syncthreads()
            half = threads // 2
            while half > 0:
                if me < half:
                    totals[me] = combine(totals[me], totals[me + half])
                cuda.syncthreads()
                half //= 2
            if me == 0:
                partial[k] = totals[0]
            cuda.syncthreads()

    return loop
