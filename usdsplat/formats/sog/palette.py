"""Vector quantisation in two levels: find a palette of rows that represents many rows.

K-means divides the rows into groups, then each group into cells. A row is compared with the centres
of its group only, which costs the square root of a single level, for a slightly larger error. Equal
rows are merged into one row with a weight, because a capture may contain many splats without
harmonics.

Source: Linde, Buzo & Gray 1980, "An algorithm for vector quantizer design"; two levels as Gersho &
Gray 1992, "Vector Quantization and Signal Compression", chapter 12.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64
from usdsplat.formats.cloud_builder import in_parallel, threads

LARGEST = 1 << 16
"""Maximum number of rows of a palette: labels have 16 bits."""

_ROUNDS = 6
_SAMPLES = 64  # rows per group centre that the groups are computed from
_NEGLIGIBLE = 1e-3  # fraction of the error below which no more centres are searched
_BLOCK = 2048  # rows whose distances are computed together
_TILE = 32  # rows of one matrix product
# Products up to this size stay single-threaded in BLAS; its threads would compete with ours.
_ALONE = 1 << 18

Labels = npt.NDArray[np.intp]


def size_for(count: int) -> int:
    """Return the palette size for `count` rows: the largest power of two not above, at most
    65536."""
    return min(LARGEST, 1 << (count.bit_length() - 1)) if count else 0


def palette(rows: F32, told: Callable[[int], None]) -> tuple[npt.NDArray[np.uint16], F32]:
    """Compute a palette and the label of each row.

    Args:
        rows: Finite values, shape (n, ...); may be a view.
        told: Receives the number of rows that have their label.

    Returns:
        Labels, shape (n,), and the palette, shape (at most `size_for(n)`, values of a row).
    """
    count = len(rows)
    width = math.prod(rows.shape[1:])
    size = size_for(count)
    if not size:
        return np.empty(0, np.uint16), np.empty((0, width), np.float32)
    first, place, weights = _kinds(rows)
    kinds = rows if len(first) == count else rows[first]
    if len(kinds) <= size:
        return place.astype(np.uint16), kinds.reshape(-1, width)
    labels, table = _quantized(kinds, weights, size, told)
    return labels[place], table


def _kinds(rows: F32) -> tuple[Labels, Labels, F32]:
    """Return the first index of each distinct row, the distinct row of each row, and the counts.

    If all rows differ, row i is distinct row i.
    """
    factors = np.random.default_rng(0).integers(1 << 63, size=math.prod(rows.shape[1:]), dtype="u8")
    # Hashes; two distinct rows collide with probability 2^-64.
    marks = np.empty(len(rows), np.uint64)

    def mark(block: slice) -> None:
        numbers = rows[block].reshape(-1, len(factors)) + np.float32(0)  # maps -0 to 0
        bits = numbers.view(np.uint32)
        marks[block] = np.einsum("ij,j->i", bits, factors, dtype=np.uint64, casting="same_kind")

    in_parallel(len(rows), mark)
    _, first, place, weights = np.unique(
        marks, return_index=True, return_inverse=True, return_counts=True
    )
    if len(first) == len(rows):
        first = place = np.arange(len(rows))
    return first, place, weights.astype(np.float32)


def _quantized(
    rows: F32, weights: F32, size: int, told: Callable[[int], None]
) -> tuple[npt.NDArray[np.uint16], F32]:
    """Return labels and a palette of at most `size` rows, for more rows than that."""
    count = len(rows)
    width = math.prod(rows.shape[1:])
    rng = np.random.default_rng(0)
    groups = math.isqrt(size)
    sample = np.sort(rng.permutation(count)[: groups * _SAMPLES])
    centres = _kmeans(rows[sample].reshape(-1, width), weights[sample], groups, rng)
    group = np.empty(count, np.intp)
    errors = np.empty(count, np.float32)

    def find_groups(block: slice) -> None:
        points = rows[block].reshape(-1, width)
        group[block] = _nearest(points, centres)
        errors[block] = _errors(points, centres[group[block]], weights[block])

    in_parallel(count, find_groups)
    counts = np.bincount(group)
    members = np.split(np.argsort(group, kind="stable"), np.cumsum(counts)[:-1])
    wanted = _shares(counts, np.bincount(group, errors).astype(np.float64), size)

    def cells(task: tuple[Labels, int, int]) -> tuple[Labels, F32, Labels]:
        mine, many, seed = task
        points = rows[mine].reshape(-1, width)
        found = _kmeans(points, weights[mine], many, np.random.default_rng(seed))
        return mine, found, _nearest(points, found)

    labels = np.empty(count, np.uint16)
    table: list[F32] = []
    done = used = 0
    with threads() as workers:
        tasks = zip(members, wanted.tolist(), range(len(members)), strict=True)
        for mine, found, nearest in workers.map(cells, tasks):
            labels[mine] = nearest + used
            table.append(found)
            used += len(found)
            done += len(mine)
            told(done)
    return labels, np.concatenate(table)


def _shares(counts: Labels, errors: F64, size: int) -> Labels:
    """Return the number of centres of each group, at most `size` in all.

    Each group gets one, and more in proportion to the error of its rows, but no more than it has
    rows."""
    shares = np.minimum(counts, 1)
    for _ in range(_ROUNDS):  # centres that a group cannot use go to the others
        claims = np.cumsum(np.where(shares < counts, errors, 0))
        if not claims[-1] > _NEGLIGIBLE * errors.sum():
            break
        ends = np.rint(claims / claims[-1] * (size - shares.sum())).astype(np.intp)
        shares = np.minimum(shares + np.diff(ends, prepend=0), counts)
    return shares


def _kmeans(points: F32, weights: F32, count: int, rng: np.random.Generator) -> F32:
    """Return at most `count` k-means centres, shape (centres, width), initialised with some
    points."""
    if count >= len(points):
        return points
    centres = points[np.sort(rng.permutation(len(points))[:count])]
    for _ in range(_ROUNDS):
        nearest = _nearest(points, centres)
        order = np.argsort(nearest.astype(np.uint16), kind="stable")
        taken, starts = np.unique(nearest[order], return_index=True)
        heavy = weights[order, None]
        sums = np.add.reduceat(points[order] * heavy, starts, axis=0)
        centres[taken] = sums / np.add.reduceat(heavy, starts, axis=0)
        idle = np.setdiff1d(np.arange(len(centres)), taken, assume_unique=True)
        if len(idle):  # move unused centres to the points of largest error
            worst = np.argsort(_errors(points, centres[nearest], weights))[-len(idle) :]
            centres[idle] = points[worst]
    return centres


def _errors(points: F32, centres: F32, weights: F32) -> F32:
    """Return the weighted squared distance of each point from its centre."""
    off = points - centres
    return np.einsum("ij,ij->i", off, off) * weights


def _nearest(points: F32, centres: F32) -> Labels:
    """Return the index of the centre nearest to each point."""
    half = np.einsum("ij,ij->i", centres, centres) / 2
    across = np.ascontiguousarray(centres.T)
    columns = max(_ALONE // (_TILE * max(points.shape[1], 1)), 1)
    nearest = np.empty(len(points), np.intp)
    for start in range(0, len(points), _BLOCK):
        block = points[start : start + _BLOCK]
        whole = len(block) - len(block) % _TILE
        tiles = block[:whole].reshape(-1, _TILE, block.shape[1])
        for piece, first in ((tiles, start), (block[whole:], start + whole)):
            products = np.empty((*piece.shape[:-1], len(centres)), np.float32)
            for left in range(0, len(centres), columns):
                few = slice(left, left + columns)
                np.matmul(piece, across[:, few], out=products[..., few])
            closeness = products.reshape(-1, len(centres))
            closeness -= half
            nearest[first : first + len(closeness)] = closeness.argmax(axis=1)
    return nearest
