"""Vector quantisation: a palette of rows that stand for many rows, in two levels.

Rows are parted into groups by k-means, then each group into cells of its own. A row meets the
centres of its group only, which costs the root of what one level would, for a little more error.

Source: Linde, Buzo & Gray 1980, "An algorithm for vector quantizer design"; two levels as Gersho &
Gray 1992, "Vector Quantization and Signal Compression", chapter 12.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.formats.filling import in_parallel

LARGEST = 1 << 16
"""Rows of a palette whose labels have 16 bits."""

_ROUNDS = 6
_SAMPLES = 64  # rows for each centre that groups are found from
_BLOCK = 2048  # rows whose distances are looked at together
_TILE = 32  # rows of a product too small for BLAS to wake threads of its own: they get in our way

Labels = npt.NDArray[np.intp]


def size_for(count: int) -> int:
    """Rows of the palette for so many: the power of two that is not above, at most 65536."""
    return min(LARGEST, 1 << (count.bit_length() - 1)) if count else 0


def palette(rows: F32, told: Callable[[int], None]) -> tuple[npt.NDArray[np.uint16], F32]:
    """Find a palette and who takes which of its rows.

    Args:
        rows: Finite, of any length, shape (n, ...); it may be a view.
        told: Called with the number of rows that have found their place.

    Returns:
        Labels, shape (n,), and the palette, shape (`size_for(n)`, values of a row) or shorter.
    """
    count = len(rows)
    width = math.prod(rows.shape[1:])
    size = size_for(count)
    if not size:
        return np.empty(0, np.uint16), np.empty((0, width), np.float32)
    rng = np.random.default_rng(0)
    groups = math.isqrt(size)
    sample = rng.permutation(count)[: groups * _SAMPLES]
    centres = _kmeans(rows[np.sort(sample)].reshape(-1, width), groups, rng)
    group = np.empty(count, np.intp)

    def find_groups(block: slice) -> None:
        group[block] = _nearest(rows[block].reshape(-1, width), centres)

    in_parallel(count, find_groups)
    members = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])
    members = [rows_of for rows_of in members if len(rows_of)]
    wanted = _shares(np.array([len(rows_of) for rows_of in members]), size)

    def cells(task: tuple[Labels, int, int]) -> tuple[Labels, F32, Labels]:
        mine, many, seed = task
        points = rows[mine].reshape(-1, width)
        found = _kmeans(points, many, np.random.default_rng(seed))
        return mine, found, _nearest(points, found)

    labels = np.empty(count, np.uint16)
    table: list[F32] = []
    done = used = 0
    with ThreadPoolExecutor(max_workers=min(8, cpu_count() or 1)) as workers:
        tasks = zip(members, wanted.tolist(), range(len(members)), strict=True)
        for mine, found, nearest in workers.map(cells, tasks):
            labels[mine] = nearest + used
            table.append(found)
            used += len(found)
            done += len(mine)
            told(done)
    return labels, np.concatenate(table)


def _shares(counts: Labels, size: int) -> Labels:
    """Centres for each group, `size` in all: by its rows, at least one and no more than those."""
    edges = np.rint(np.cumsum(counts) * (size / counts.sum())).astype(np.intp)
    shares = np.maximum(np.diff(edges, prepend=0), 1)
    surplus = int(shares.sum()) - size
    for largest in np.argsort(-shares, kind="stable")[: max(surplus, 0)]:
        shares[largest] -= shares[largest] > 1
    return np.minimum(shares, counts)


def _kmeans(points: F32, count: int, rng: np.random.Generator) -> F32:
    """At most `count` centres of points, shape (centres, width); they start as some of these."""
    if count >= len(points):
        return points
    centres = points[np.sort(rng.permutation(len(points))[:count])]
    for _ in range(_ROUNDS):
        nearest = _nearest(points, centres)
        order = np.argsort(nearest.astype(np.uint16), kind="stable")
        taken, starts = np.unique(nearest[order], return_index=True)
        sums = np.add.reduceat(points[order], starts, axis=0)
        centres[taken] = sums / np.diff(starts, append=len(points))[:, None].astype(np.float32)
        idle = np.setdiff1d(np.arange(len(centres)), taken, assume_unique=True)
        if len(idle):  # they go to the points that fare worst
            off = points - centres[nearest]
            worst = np.argsort(np.einsum("ij,ij->i", off, off))[-len(idle) :]
            centres[idle] = points[worst]
    return centres


def _nearest(points: F32, centres: F32) -> Labels:
    """Row of the centre nearest to each point."""
    half = np.einsum("ij,ij->i", centres, centres) / 2
    across = np.ascontiguousarray(centres.T)
    nearest = np.empty(len(points), np.intp)
    for start in range(0, len(points), _BLOCK):
        block = points[start : start + _BLOCK]
        whole = len(block) - len(block) % _TILE
        tiles = block[:whole].reshape(-1, _TILE, block.shape[1])
        for piece, first in ((tiles, start), (block[whole:], start + whole)):
            closeness = (piece @ across).reshape(-1, len(centres))
            closeness -= half
            nearest[first : first + len(closeness)] = closeness.argmax(axis=1)
    return nearest
