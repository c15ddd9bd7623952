"""Topology of face-varying values: the mesh, cut where neighbouring values differ.

The rules are OpenSubdiv's rules of face-varying linear interpolation.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from usdsplat.core.cloud import F32, I64
from usdsplat.core.surface.level import (
    INFINITE,
    Bools,
    Level,
    coarsest,
    fans,
    open_edges,
    sharpen,
    twins,
)
from usdsplat.core.surface.topology import FaceVarying


def hard(level: Level) -> Level:
    """Return the level with everything infinitely sharp, so that its refinement is linear."""
    return replace(
        level,
        edge_sharpness=np.full(len(level.ends), INFINITE),
        vertex_sharpness=np.full(level.vertices, INFINITE),
    )


def cut(level: Level, values: I64, rule: FaceVarying) -> tuple[Level, I64]:
    """Cut a level where the corners of a vertex have different values.

    Args:
        level: A coarsest level, sharpened.
        values: Index of the value at each corner, shape (c,); corners of different vertices share
            no value, even with equal indices.
        rule: Rule of linear interpolation.

    Returns:
        The level, and the corner that each of its vertices takes its value from.
    """
    keys = level.corners * (values.max(initial=0) + 1) + values
    _, first, corners = np.unique(keys, return_index=True, return_inverse=True)
    bare = coarsest(np.diff(level.offsets), corners, len(first))
    owner = level.corners[first]
    edge_sharpness = bare.edge_sharpness
    edge_sharpness[bare.edge_of] = level.edge_sharpness[level.edge_of]
    pieces = replace(
        bare, edge_sharpness=edge_sharpness, vertex_sharpness=level.vertex_sharpness[owner]
    )
    sharpen(pieces, corners=False)
    if rule == "all":
        return hard(pieces), first
    if rule != "none":
        pieces.vertex_sharpness[_pinned(level, pieces, owner, rule)] = INFINITE
    return pieces, first


def split(level: Level) -> I64:
    """Number the corners so that those of one vertex differ across infinitely sharp edges."""
    twin = twins(level)
    twin[level.edge_sharpness[level.edge_of] >= INFINITE] = -1
    return fans(level, twin)


def _pinned(level: Level, pieces: Level, owner: I64, rule: FaceVarying) -> Bools:
    """Return which values are not smoothed."""
    opened = open_edges(pieces)
    cut_at = np.bincount(pieces.ends[opened].ravel(), minlength=pieces.vertices) > 0
    if rule == "boundaries":
        return cut_at
    single = np.bincount(pieces.corners, minlength=pieces.vertices) == 1
    if rule == "cornersOnly":
        return single
    values_of = np.bincount(owner, minlength=level.vertices)
    # A value is disjoint if its faces form several fans, or a permanently sharp edge separates
    # them.
    inner = (pieces.edge_sharpness >= INFINITE) & ~opened
    disjoint = (pieces.vertex_sharpness >= INFINITE) | (
        np.bincount(pieces.ends[inner].ravel(), minlength=pieces.vertices) > 0
    )
    contagious = disjoint | single if rule == "cornersPlus2" else disjoint
    infected = np.bincount(owner, contagious & (values_of[owner] == 2), minlength=level.vertices)
    pinned = single | (values_of[owner] > 2) | (infected[owner] > 0)
    if rule == "cornersPlus2":
        border = np.bincount(level.ends[open_edges(level)].ravel(), minlength=level.vertices) > 0
        pinned |= cut_at & (values_of[owner] == 1) & ~border[owner]
    return np.asarray(pinned)


def weld(corners: I64, values: F32) -> I64:
    """Number face-varying values without indices: equal values at a vertex become one.

    Args:
        corners: Vertex at each corner, shape (c,).
        values: Value at each corner, shape (c, k).
    """
    bits = np.ascontiguousarray(values + np.float32(0)).view(np.int32)  # maps -0 to 0
    order = np.lexsort((*bits.T, corners))
    new = np.ones(len(order), bool)
    new[1:] = (corners[order[1:]] != corners[order[:-1]]) | (
        bits[order[1:]] != bits[order[:-1]]
    ).any(axis=1)
    numbers = np.empty(len(order), np.int64)
    numbers[order] = np.cumsum(new) - 1
    return numbers
