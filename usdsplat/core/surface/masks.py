"""Compute the weights of a step of Catmull-Clark or Loop subdivision, with creases.

Sources: Catmull and Clark 1978; Loop 1987; semi-sharp creases after DeRose, Kass and Truong 1998,
with the blending of fractional sharpness that OpenSubdiv documents (the uniform method).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, F64, I64
from usdsplat.core.surface.level import Bools, Level, groups, sizes, softened
from usdsplat.core.surface.stencil import Block, Stencil, Step

Valence = Callable[[int], tuple[float, float, float]]


def catmull_clark(level: Level) -> Step:
    """Return the step to `level.quads`: face points are means; edge and vertex points use them."""
    count = level.vertices
    counts = np.diff(level.offsets)
    blocks = []
    for n in sizes(counts):
        faces = np.flatnonzero(counts == n)
        columns = level.corners[level.offsets[faces] + np.arange(n)[:, None]]
        blocks.append(_block(faces, columns, np.full((n, 1), 1 / n)))
    means = Stencil(size=level.faces, blocks=tuple(blocks))

    def smooth(n: int) -> tuple[float, float, float]:
        return (n - 2) / n, 1 / n**2, 1 / n**2

    edge_blocks = _edge_blocks(level, count + level.face_of, 0.25)
    vertex_blocks = _vertex_blocks(level, count + level.face_of, smooth)
    size = count + len(level.ends)
    return Step(means=means, others=Stencil(size=size, blocks=(*vertex_blocks, *edge_blocks)))


def loop(level: Level) -> Step:
    """Return the step to `level.triangles`."""

    def smooth(n: int) -> tuple[float, float, float]:
        beta = (0.625 - (0.375 + 0.25 * math.cos(2 * math.pi / n)) ** 2) / n
        return 1 - n * beta, beta, 0.0

    opposite = level.corners[level.preceding]
    size = level.vertices + len(level.ends)
    blocks = (*_vertex_blocks(level, None, smooth), *_edge_blocks(level, opposite, 0.375))
    return Step(means=None, others=Stencil(size=size, blocks=blocks))


def _block(rows: I64, columns: I64, weights: F64) -> Block:
    """Return a block of rows with their terms and weights."""
    if weights.shape[1] > 1 and (weights == weights[:, :1]).all():
        weights = weights[:, :1]
    return Block(
        rows=rows.astype(np.int32),
        columns=columns.astype(np.int32),
        weights=weights.astype(np.float32),
    )


def _edge_blocks(level: Level, across: I64, near: float) -> list[Block]:
    """Return the blocks of edge points.

    Args:
        level: The coarser level.
        across: Row that counts on each corner's side of its edge: the face's mean or the opposite
            vertex, shape (c,).
        near: Weight of each end of a smooth edge.
    """
    sharp = np.minimum(level.edge_sharpness, 1)
    ends, first = level.ends.T, level.vertices
    hard = np.flatnonzero(sharp >= 1)
    blocks = [_block(first + hard, ends[:, hard], np.full((2, 1), 0.5))]
    offsets, order = groups(level.edge_of, len(level.ends))
    sides = across.astype(np.int32)[order]  # a smooth edge has two faces
    for soft, t in _alike(sharp, sharp < 1):
        ends_weight, side_weight = near + (0.5 - near) * t, (0.5 - near) * (1 - t)
        weights = np.stack([ends_weight, ends_weight, side_weight, side_weight])
        columns = [ends[:, soft], sides[offsets[soft] + np.arange(2)[:, None]]]
        blocks.append(_block(first + soft, np.concatenate(columns), weights))
    return [block for block in blocks if len(block.rows)]


def _alike(share: F64, which: Bools) -> list[tuple[I64, F64]]:
    """Split the rows `which` into those of share 0 and the others; return rows and shares."""
    plain, mixed = np.flatnonzero(which & (share == 0)), np.flatnonzero(which & (share != 0))
    return [(plain, np.zeros(1)), (mixed, share[mixed])]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Blend:
    """Weights of the three rules at each vertex; they add up to one."""

    corner: F64
    crease: F64
    smooth: F64
    early: Bools
    """Whether the crease edges are those before this step, rather than those after it."""


def _blend(level: Level) -> _Blend:
    """Blend the rules before and after this step by the remaining sharpness."""
    edge, vertex = level.edge_sharpness, level.vertex_sharpness
    edge_after, vertex_after = softened(edge), softened(vertex)
    corner, crease = _rule(level, edge, vertex)
    corner_after, crease_after = _rule(level, edge_after, vertex_after)

    ending = (edge > 0) & (edge_after == 0)
    at = level.ends[ending].ravel()
    total = np.bincount(at, np.repeat(edge[ending], 2), minlength=level.vertices)
    number = np.bincount(at, minlength=level.vertices)
    fading = (vertex > 0) & (vertex_after == 0)
    total = total + np.where(fading, vertex, 0)
    w = np.minimum(total / np.maximum(number + fading, 1), 1)
    corners = np.where(corner & corner_after, 1, w * corner + (1 - w) * corner_after)
    creases = np.where(crease & crease_after, 1, w * crease + (1 - w) * crease_after)
    return _Blend(corner=corners, crease=creases, smooth=1 - corners - creases, early=crease)


def _rule(level: Level, edge: F32, vertex: F32) -> tuple[Bools, Bools]:
    """Return whether each vertex is a corner, and whether it is a crease; else it is smooth."""
    sharp = np.bincount(level.ends[edge > 0].ravel(), minlength=level.vertices)
    corner = (vertex > 0) | (sharp > 2)
    return corner, ~corner & (sharp == 2)


def _vertex_blocks(level: Level, means: I64 | None, smooth: Valence) -> list[Block]:
    """Return the blocks of vertex points.

    Args:
        level: The coarser level.
        means: Row of the mean of each corner's face, shape (c,), or None if faces have no weight.
        smooth: Weights at a smooth vertex of n edges: of itself, of each neighbour, of each mean.
    """
    blend = _blend(level)
    starts, order = groups(level.ends.ravel(), level.vertices)
    across = level.ends.ravel()[order ^ 1]  # the other end of each vertex's edges
    at = level.ends.ravel()[order]
    sharpness = level.edge_sharpness[order // 2]
    creased = np.where(blend.early[at], sharpness > 0, softened(sharpness) > 0)
    valence = np.diff(starts)

    alone = valence == 0
    still = np.flatnonzero((blend.corner == 1) | alone)
    along = np.flatnonzero(blend.crease == 1)
    ends = across[creased & (blend.crease[at] == 1)].reshape(-1, 2).T
    blocks = [
        _block(still, still[None], np.ones((1, 1))),
        _block(along, np.concatenate([along[None], ends]), np.array([[0.75], [0.125], [0.125]])),
    ]
    if means is None:
        firsts, faces = starts, np.zeros(level.vertices, np.int64)
    else:
        firsts, by_vertex = groups(level.corners, level.vertices)
        faces = np.diff(firsts)
    moves = (blend.corner < 1) & (blend.crease < 1) & ~alone
    kinds = valence * (faces.max(initial=0) + 1) + faces
    across = across.astype(np.int32)
    around = None if means is None else means.astype(np.int32)[by_vertex]
    for kind in np.unique(kinds[moves]):
        for rows, sharp in _alike(1 - blend.smooth, moves & (kinds == kind)):
            if len(rows) == 0:
                continue
            n, count = int(valence[rows[0]]), int(faces[rows[0]])
            own, near, far = smooth(n)
            neighbours = starts[rows] + np.arange(n)[:, None]
            columns = [rows[None], across[neighbours]]
            if around is not None:
                columns.append(around[firsts[rows] + np.arange(count)[:, None]])
            if len(sharp) == 1 and sharp[0] == 0:
                terms = np.repeat([own, near, far], [1, n, count])[:, None]
            else:
                c, s = blend.crease[rows], blend.smooth[rows]
                terms = np.concatenate(
                    [
                        (blend.corner[rows] + 0.75 * c + own * s)[None],
                        0.125 * c * creased[neighbours] + near * s,
                        np.tile(far * s, (count, 1)),
                    ]
                )
            blocks.append(_block(rows, np.concatenate(columns), terms))
    return [block for block in blocks if len(block.rows)]
