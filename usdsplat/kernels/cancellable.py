"""Run kernels of the CPU for work that may be cancelled: long launches in parts.

A part is a few blocks of splats or rows of tiles, so that a launch has many chunks for each thread
and a part takes about 5 ms. Parts are slices of the arguments: no kernel knows of them, results
have the same bits, and work that cannot be cancelled is launched whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from usdsplat.core.cancel import CancelToken
from usdsplat.kernels import bins, blend, light_lanes, median, project, radiance, sort, walk
from usdsplat.kernels.bins import TILE
from usdsplat.kernels.device import CpuDevice

BLOCKS = 48
"""Blocks of splats in a part, for each thread."""
TILES = 96
"""Tiles in a part, at least, for each thread."""
RECEIVERS = 1 << 13
"""Number of receivers of light in one launch, for each thread."""
ROWS = 1 << 18
"""Splats in a part that only copies them, for each thread."""


class CancellableCpu(CpuDevice):
    """A CPU device whose work ends before the next part of a launch once a token is cancelled.

    Args:
        device: The device, whose threads are used.
        cancel: The token; `run` raises `Cancelled`.
    """

    def __init__(self, device: CpuDevice, cancel: CancelToken) -> None:
        self.remark, self.threads, self._launch = device.remark, device.threads, device._launch
        self._cancel = cancel

    def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        """Call `kernel`, in parts if that takes long, and return what the last part returns.

        Raises:
            Cancelled: If the token is cancelled before a part.
        """
        result = None
        if kernel is bins.tile_lists:
            args = *args[:-1], self._checked(args[-1])
        elif kernel is sort.depth_order:
            args = *args, self._cancel.check
        parts = PARTS.get(kernel)
        for part in (args,) if parts is None else parts(args, self.threads):
            self._cancel.check()
            result = super().run(kernel, *part)
        return result

    def _checked(self, get: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that returns buffers, which a launcher calls between its kernels."""

        def checked(*args: Any) -> Any:
            self._cancel.check()
            return get(*args)

        return checked


def project_parts(args: tuple[Any, ...], threads: int) -> Iterator[tuple[Any, ...]]:
    """Return arguments of `project.project` for a few blocks at a time."""
    camera, matrices, weights, volumes, crops, rows, *splats, closed, block, base, out, found = args
    n, most = len(splats[0]), BLOCKS * threads
    blocks = -(-n // block)
    if len(matrices) * blocks <= most:
        yield args
        return
    several = max(1, most // blocks)  # instances of a small field
    for i in range(0, len(matrices), several):
        some = slice(i, i + several)
        for b in range(0, blocks, most):
            first, last = b * block, min((b + most) * block, n)
            named = rows[first:last] if len(rows) or blocks <= most else _numbers(first, last)
            begin = i * blocks + b
            these = slice(begin, begin + min(most, blocks - b) * len(matrices[some]))
            yield (
                camera, matrices[some], weights[some], volumes, crops[some], named,
                *(array[first:last] for array in splats), closed[these], block,
                base + begin * block, out, found[these],
            )  # fmt: skip


def radiance_parts(args: tuple[Any, ...], threads: int) -> Iterator[tuple[Any, ...]]:
    """Return arguments of `radiance.radiance` for a few blocks of an instance at a time."""
    sights, positions, sh, *how, block, base, sources, found, paints, column = args
    most = BLOCKS * threads
    blocks = -(-len(positions) // block)
    for i in range(len(sights)):
        for b in range(i * blocks, (i + 1) * blocks, most):
            end = min(b + most, (i + 1) * blocks)
            yield (
                sights[i : i + 1], positions, sh, *how, block, base + b * block, sources,
                found[b:end], paints, column,
            )  # fmt: skip


def settle_parts(args: tuple[Any, ...], threads: int) -> Iterator[tuple[Any, ...]]:
    """Return arguments of `sort.settle` for some rows at a time; equal keys stay together."""
    bits, slots, count, sources, first_slots, work = args
    first = 0
    while first < count:
        last = bits[min(first + ROWS, count) - 1]
        end = int(np.searchsorted(bits[:count], last, side="right"))
        part = slice(first, end)
        yield bits[part], slots[part], end - first, sources, first_slots, work[part]
        first = end


def gather_parts(args: tuple[Any, ...], threads: int) -> Iterator[tuple[Any, ...]]:
    """Return arguments of `sort.gather` for some rows at a time."""
    order, records, out = args
    for k in range(0, len(order), ROWS * threads):
        part = slice(k, k + ROWS * threads)
        yield order[part], records, out[part]


class _Strip(NamedTuple):
    """Some rows of the tiles of a band."""

    rows: slice
    """Its rows of pixels."""
    starts: npt.NDArray[np.int64]
    tiles: slice
    grid: npt.NDArray[Any]


def _strips(starts: npt.NDArray[np.int64], grid: npt.NDArray[Any], threads: int) -> list[_Strip]:
    """Return a few rows of tiles at a time."""
    g = grid[0]
    x0, y0, x1, y1, top = (int(g[name]) for name in ("x0", "y0", "x1", "y1", "top"))
    columns = max(int(g["columns"]), 1)
    step = max(1, TILES * threads // columns)
    found = []
    for row in range(0, int(g["rows"]), step):
        first, last = max(y0, top + row * TILE), min(y1, top + (row + step) * TILE)
        end = min(row + step, int(g["rows"]))
        found.append(
            _Strip(
                rows=slice(first - y0, last - y0),
                starts=starts[row * columns : end * columns + 1],
                tiles=slice(row * columns, end * columns),
                grid=bins.grid_of(x0, first, x1, last),
            )
        )
    return found


def blend_parts(args: tuple[Any, ...], threads: int) -> Iterator[tuple[Any, ...]]:
    """Return arguments of `blend.blend` for a few rows of tiles at a time."""
    records, paints, column, starts, lists, grid, hits, depth, is_parallel, image, work = args
    for strip in _strips(starts, grid, threads):
        yield (
            records, paints, column, strip.starts, lists, strip.grid, hits, depth[strip.rows],
            is_parallel, image[strip.rows], work[strip.tiles],
        )  # fmt: skip


def median_parts(args: tuple[Any, ...], threads: int) -> Iterator[tuple[Any, ...]]:
    """Return arguments of `median.median` for a few rows of tiles at a time."""
    records, starts, lists, grid, hits, depth, is_parallel, image, covered, part, ranks = args
    for strip in _strips(starts, grid, threads):
        yield (
            records, strip.starts, lists, strip.grid, hits, depth[strip.rows], is_parallel,
            image[strip.rows], covered[strip.rows], part, ranks[strip.rows],
        )  # fmt: skip


def shine_parts(args: tuple[Any, ...], threads: int) -> Iterator[tuple[Any, ...]]:
    """Return arguments of `light_lanes.shine` for some receivers at a time."""
    light, points, normals, shapes, prims, *others, sums = args
    for k in range(0, len(points), RECEIVERS * threads):
        part = slice(k, k + RECEIVERS * threads)
        yield (
            light, points[part], normals[part], shapes[part] if len(shapes) else shapes,
            prims[part] if len(prims) else prims, *others, sums[part],
        )  # fmt: skip


def walk_parts(args: tuple[Any, ...], threads: int) -> Iterator[tuple[Any, ...]]:
    """Return arguments of `walk.walk` for a few rows of tiles at a time; those of deep pictures and
    with a holdout, which no window draws, are left whole."""
    options, records, features, keeps, labels, starts, lists, grid, hits, depth = args[:10]
    covered, holdout, out = args[10:]
    *images, through, median_out, front, prims, counts, offsets, deep = out
    if len(holdout[0]) or len(offsets):
        yield args
        return
    for strip in _strips(starts, grid, threads):
        rows = strip.rows
        pairs = (tuple(array[rows] for array in pair) for pair in (median_out, front, prims))
        own = (*(image[rows] for image in images), through[rows], *pairs, counts[rows])
        yield (
            options, records, features, keeps, labels, strip.starts, lists, strip.grid, hits,
            depth[rows], covered[rows], holdout, (*own, offsets, deep),
        )  # fmt: skip


def _numbers(first: int, last: int) -> npt.NDArray[np.int32]:
    """Return row numbers as `Device.keep` returns arrays."""
    numbers = np.arange(first, last, dtype=np.int32)
    numbers.flags.writeable = False
    return numbers


PARTS: dict[Callable[..., Any], Callable[[tuple[Any, ...], int], Iterator[tuple[Any, ...]]]] = {
    project.project: project_parts,
    radiance.radiance: radiance_parts,
    sort.settle: settle_parts,
    sort.gather: gather_parts,
    blend.blend: blend_parts,
    median.median: median_parts,
    walk.walk: walk_parts,
    light_lanes.shine: shine_parts,
}
"""Kernel that may take long -> the function that divides its arguments."""
