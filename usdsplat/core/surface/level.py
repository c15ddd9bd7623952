"""A level of a subdivision surface: its edges and corners and their sharpness.

A corner is one vertex of one face; its edge leads to the next corner of that face. The rules of
sharpness are OpenSubdiv's: open and non-manifold edges are infinitely sharp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, I64

INFINITE = np.float32(10.0)
"""Sharpness from which on an edge or vertex never becomes smooth."""

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Level:
    """The faces and edges of a level, with their sharpness."""

    vertices: int
    offsets: I64
    """First corner of each face, and the end, shape (f + 1,)."""
    corners: I64
    """Vertex at each corner, shape (c,)."""
    following: I64
    """Next corner of the same face, shape (c,)."""
    edge_of: I64
    """Edge from each corner to the next, shape (c,)."""
    ends: I64
    """The two vertices of each edge, shape (e, 2)."""
    edge_sharpness: F32
    """Sharpness of each edge, shape (e,)."""
    vertex_sharpness: F32
    """Sharpness of each vertex, shape (vertices,)."""

    @property
    def faces(self) -> int:
        """Number of faces."""
        return len(self.offsets) - 1

    @property
    def face_of(self) -> I64:
        """Face of each corner, shape (c,)."""
        return np.repeat(np.arange(self.faces), np.diff(self.offsets))

    @property
    def preceding(self) -> I64:
        """Previous corner of the same face, shape (c,)."""
        before = np.empty_like(self.following)
        before[self.following] = np.arange(len(before))
        return before


def ring(counts: I64) -> tuple[I64, I64]:
    """Return the first corner of each face and the end, and the next corner of each corner."""
    offsets = np.concatenate([[0], np.cumsum(counts)])
    following = np.arange(1, offsets[-1] + 1)
    following[offsets[1:] - 1] = offsets[:-1]
    return offsets, following


def groups(keys: I64, size: int) -> tuple[I64, I64]:
    """Return the start of each key in sorted order, shape (size + 1,), and that order."""
    offsets = np.concatenate([[0], np.cumsum(np.bincount(keys, minlength=size))])
    # Sorting keys with row numbers in the low bits is several times faster than argsort.
    bits = max(len(keys) - 1, 1).bit_length()
    packed = np.sort((keys << bits) | np.arange(len(keys)))
    return offsets, packed & ((1 << bits) - 1)


def edges(corners: I64, following: I64, vertices: int) -> tuple[I64, I64]:
    """Return the distinct edges, shape (e, 2), lower vertex first, and the edge of each corner."""
    ends = np.stack([corners, corners[following]], axis=1)
    ends.sort(axis=1)
    keys, edge_of = np.unique(ends[:, 0] * max(vertices, 1) + ends[:, 1], return_inverse=True)
    return np.stack(np.divmod(keys, max(vertices, 1)), axis=1), edge_of


def edge_numbers(level: Level, first: I64, second: I64) -> I64:
    """Return the edge between pairs of vertices of a coarsest level, -1 if there is none."""
    wanted = np.minimum(first, second) * level.vertices + np.maximum(first, second)
    keys = level.ends[:, 0] * level.vertices + level.ends[:, 1]
    if len(keys) == 0:
        return np.full(len(wanted), -1)
    found = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[found] == wanted, found, -1)


def coarsest(counts: I64, corners: I64, vertices: int) -> Level:
    """Return the level of authored faces, without sharpness."""
    offsets, following = ring(counts)
    ends, edge_of = edges(corners, following, vertices)
    return Level(
        vertices=vertices,
        offsets=offsets,
        corners=corners,
        following=following,
        edge_of=edge_of,
        ends=ends,
        edge_sharpness=np.zeros(len(ends), np.float32),
        vertex_sharpness=np.zeros(vertices, np.float32),
    )


def sizes(counts: I64) -> I64:
    """Return the distinct counts in ascending order."""
    return np.flatnonzero(np.bincount(counts))


def twins(level: Level) -> I64:
    """Return the corner along the same edge in the other direction, -1 unless there is exactly
    one."""
    offsets, order = groups(level.edge_of, len(level.ends))
    pairs = offsets[:-1][np.diff(offsets) == 2]
    a, b = order[pairs], order[pairs + 1]
    opposed = level.corners[a] != level.corners[b]
    a, b = a[opposed], b[opposed]
    twin = np.full(len(level.corners), -1)
    twin[a], twin[b] = b, a
    return twin


def fans(level: Level, twin: I64) -> I64:
    """Return the lowest corner reachable from each corner around its vertex, through twins."""
    own = np.arange(len(level.corners))
    left = np.where(twin >= 0, level.following[twin], own)
    before = twin[level.preceding]
    right = np.where(before >= 0, before, own)
    label = own
    while True:
        lower = np.minimum(label, np.minimum(label[left], label[right]))
        lower = lower[lower]
        if np.array_equal(lower, label):
            return label
        label = lower


def open_edges(level: Level) -> Bools:
    """Return which edges have one face only."""
    return np.asarray(np.bincount(level.edge_of, minlength=len(level.ends)) == 1)


def sharpen(level: Level, *, corners: bool) -> None:
    """Make open and non-manifold edges and vertices infinitely sharp, in place.

    A vertex is non-manifold if it has several fans of faces or a non-manifold edge. If exactly two
    such edges and no open edge meet there, it remains a crease.

    Args:
        level: A coarsest level.
        corners: Whether vertices with one face only become sharp as well.
    """
    twin = twins(level)
    opened = open_edges(level)
    manifold = np.zeros(len(level.ends), bool)
    manifold[level.edge_of[twin >= 0]] = True
    crossed = ~manifold & ~opened
    level.edge_sharpness[~manifold] = INFINITE

    label = fans(level, twin)
    roots = level.corners[label == np.arange(len(label))]
    crosses = _at_vertices(level, crossed)
    face_count = np.bincount(level.corners, minlength=level.vertices)
    edge_count = np.bincount(level.ends.ravel(), minlength=level.vertices)
    creased = (crosses == 2) & (_at_vertices(level, opened) == 0) & (face_count > edge_count)
    several = np.bincount(roots, minlength=level.vertices) > 1
    sharp = (several | (crosses > 0)) & ~creased
    if corners:
        sharp |= (face_count == 1) & (edge_count == 2)
    level.vertex_sharpness[sharp] = INFINITE


def _at_vertices(level: Level, which: Bools) -> I64:
    """Return the number of edges `which` at each vertex."""
    return np.bincount(level.ends[which].ravel(), minlength=level.vertices)


def softened(sharpness: F32) -> F32:
    """Return the sharpness at the next level: one less, unless it is infinite."""
    return np.where(sharpness >= INFINITE, sharpness, np.maximum(sharpness - 1, np.float32(0)))


def quad_corners(level: Level) -> I64:
    """Return the vertices of Catmull-Clark's quads, one per corner, shape (c, 4).

    Vertices keep their numbers; edge vertices follow, then face vertices. Quad c belongs to corner
    c: its vertex, the middle of its edge, the face's middle, the middle of the edge before.
    """
    on_edge = level.vertices + level.edge_of
    on_face = level.vertices + len(level.ends) + level.face_of
    return np.stack([level.corners, on_edge, on_face, on_edge[level.preceding]], axis=1)


def quads(level: Level) -> Level:
    """Return the next Catmull-Clark level, whose faces are `quad_corners`."""
    corners, before, edge_count = quad_corners(level), level.preceding, len(level.ends)
    near, far = _halves(level)
    inner = 2 * edge_count + np.arange(len(before))
    edge_of = np.stack([near, inner, inner[before], far], axis=1)
    return _finer(level, corners, edge_of, corners[:, 1:3], level.faces)


def triangle_corners(level: Level) -> I64:
    """Return the vertices of Loop's triangles, shape (4 f, 3): three at corners, then the middle.

    Vertices keep their numbers; edge vertices follow.
    """
    on_edge = level.vertices + level.edge_of
    outer = np.stack([level.corners, on_edge, on_edge[level.preceding]], axis=1)
    pieces = [outer.reshape(-1, 3, 3), on_edge.reshape(-1, 1, 3)]
    return np.concatenate(pieces, axis=1).reshape(-1, 3)


def triangles(level: Level) -> Level:
    """Return the next Loop level, whose faces are `triangle_corners`."""
    near, far = _halves(level)
    inner = 2 * len(level.ends) + np.arange(len(near))  # edge i cuts off corner i
    outer = np.stack([near, inner, far], axis=1).reshape(-1, 3, 3)
    middle = np.roll(inner.reshape(-1, 3), -1, axis=1)[:, None]
    edge_of = np.concatenate([outer, middle], axis=1).reshape(-1, 3)
    on_edge = level.vertices + level.edge_of
    ends = np.stack([on_edge, on_edge[level.preceding]], axis=1)
    return _finer(level, triangle_corners(level), edge_of, ends, 0)


def _halves(level: Level) -> tuple[I64, I64]:
    """Return the halves of each corner's edge, and of the edge before it, that end at the
    corner."""
    edge, before = level.edge_of, level.edge_of[level.preceding]
    near = 2 * edge + (level.corners != level.ends[edge, 0])
    return near, 2 * before + (level.corners != level.ends[before, 0])


def _finer(level: Level, corners: I64, edge_of: I64, inner: I64, middles: int) -> Level:
    """Return the level with these faces, which all have equally many corners."""
    count, edge_count = level.vertices, len(level.ends)
    offsets, following = ring(np.full(len(corners), corners.shape[1]))
    halves = np.empty((edge_count, 2, 2), np.int64)
    halves[:, :, 0] = level.ends
    halves[:, :, 1] = count + np.arange(edge_count)[:, None]
    edge_sharpness = np.zeros(2 * edge_count + len(inner), np.float32)
    edge_sharpness[: 2 * edge_count] = np.repeat(softened(level.edge_sharpness), 2)
    vertex_sharpness = np.zeros(count + edge_count + middles, np.float32)
    vertex_sharpness[:count] = softened(level.vertex_sharpness)
    return Level(
        vertices=len(vertex_sharpness),
        offsets=offsets,
        corners=corners.ravel(),
        following=following,
        edge_of=edge_of.ravel(),
        ends=np.concatenate([halves.reshape(-1, 2), inner]),
        edge_sharpness=edge_sharpness,
        vertex_sharpness=vertex_sharpness,
    )
