"""The nodes of a splat tree: bounds, errors, children, and where the splats of each one lie.

A tree holds a capture of any size at several levels of detail. A leaf holds splats of the capture.
An inner node holds proxies, fewer and larger splats that stand for all splats below it. A picture
draws a cut: from the root down, either the proxies of a node or its children. Residents are splats
that are too large for any node below; they are drawn as soon as their node is reached, whether it
is refined or not.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise

import numpy as np

from usdsplat.core.cloud import F32, F64, I32, I64
from usdsplat.core.errors import StageError

NESTED = 1.25
"""Least ratio of a node's error to that of each of its children."""
NODE_SPLATS = 65_536
"""Largest number of proxies, or of splats of a leaf, that a built tree has in a node."""

MOST_LEVELS = 64
"""Largest number of levels of a tree."""
_SLACK = 1e-5
"""Part of a box's size by which single precision may let a child's box exceed its parent's."""
_ROWS = 1 << 40
"""Largest row of a chunk, and largest number of splats of a node, that a table may state."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NodeTable:
    """The nodes of a tree of n nodes, breadth first: node 0 is the root, and the children of each
    node follow each other, after all nodes of the level above."""

    low: F32
    """Lower corner of the box around the splats of the node and of all below it, to where an opaque
    one reaches 1/255 (`core.extent.REACH`) [local unit], shape (n, 3)."""
    high: F32
    """Upper corner, shape (n, 3)."""
    errors: F32
    """Size of a pixel at which the picture of the node's proxies is good enough [local unit], shape
    (n,): 0 for a leaf; infinity for a node without proxies, which is always refined."""
    first_child: I32
    """First child, shape (n,); 0 for a leaf."""
    child_count: I32
    """Number of children, shape (n,); 0 for a leaf."""
    chunk: I32
    """Number of the chunk that holds the splats, shape (n,); -1 if the node has none."""
    first_row: I64
    """Row of the chunk at which the node's proxies begin; its residents follow. Shape (n,)."""
    proxies: I64
    """Number of proxies, or of splats of a leaf, shape (n,)."""
    residents: I64
    """Number of residents, shape (n,)."""

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.errors)

    @cached_property
    def sizes(self) -> I64:
        """Number of proxies and residents of each node, shape (n,)."""
        return self.proxies + self.residents

    @cached_property
    def captured(self) -> int:
        """Number of splats of the capture: those of the leaves, and the residents."""
        leaf = self.child_count == 0
        return int(self.proxies[leaf].sum() + self.residents.sum())

    @cached_property
    def least(self) -> I64:
        """Number of splats of the smallest cut of the subtree of each node, shape (n,). The table
        must be valid."""
        found, parents = self.sizes.copy(), self.parents()
        for start, end in reversed(self.levels()[1:]):
            above = np.unique(parents[start:end])
            below = np.add.reduceat(found[start:end], self.first_child[above] - start)
            found[above] = np.minimum(found[above], self.residents[above] + below)
        return found

    def parents(self) -> I32:
        """Return the parent of each node, shape (n,); -1 for the root. The table is valid."""
        return self._parents

    @cached_property
    def _parents(self) -> I32:
        found = np.full(len(self), -1, np.int32)
        inner = np.flatnonzero(self.child_count)
        counts = self.child_count[inner]
        starts = np.cumsum(counts) - counts
        offsets = np.arange(counts.sum()) - np.repeat(starts, counts)
        found[np.repeat(self.first_child[inner], counts) + offsets] = np.repeat(inner, counts)
        return found

    def levels(self) -> list[tuple[int, int]]:
        """Return the first node of each level from the root on, and the first of the next. The
        table is valid, so that the nodes of a level follow each other."""
        starts = [0, 1]
        while starts[-1] < len(self):
            starts.append(starts[-1] + int(self.child_count[slice(*starts[-2:])].sum()))
        return list(pairwise(starts))


def nested(errors: F64, table: NodeTable) -> F32:
    """Return errors of which each is at least NESTED times those of the node's children, and above
    0 for an inner node."""
    parents, found = table.parents(), errors.astype(np.float64)
    inner = table.child_count > 0
    found[inner] = np.maximum(found[inner], np.finfo(np.float32).tiny)
    for start, end in reversed(table.levels()[1:]):
        np.maximum.at(found, parents[start:end], NESTED * (1 + 1e-6) * found[start:end])
    return found.astype(np.float32)


def rounded(corners: F64, away: float) -> F32:
    """Return corners in single precision, rounded outwards: to -inf or inf, as `away` says."""
    near = corners.astype(np.float32)
    inside = near > corners if away < 0 else near < corners
    return np.where(inside, np.nextafter(near, np.float32(away)), near).astype(np.float32)


def check_nodes(table: NodeTable, where: str, *, chunks: int) -> None:
    """Raise an error unless the table is that of a tree.

    Nothing is allocated in proportion to a number that the table states.

    Args:
        table: Values of a file, of any content and length.
        where: Path of the prim.
        chunks: Number of chunks of the tree.

    Raises:
        StageError: If there is no node, arrays differ in length or have wrong shapes, a number is
            negative or not finite, children are not as `NodeTable` says, the rows of two nodes
            overlap, a child's box is not inside its parent's, or an error is not at least NESTED
            times a child's.
    """
    n = len(table)
    for field in fields(table):
        array = getattr(table, field.name)
        shape = (n, 3) if field.name in ("low", "high") else (n,)
        if array.shape != shape:
            found = f"{field.name} of shape {array.shape}"
            raise StageError(where, found, f"{shape}, for {n} nodes")
    if n == 0:
        raise StageError(where, "no nodes", "at least one")
    _check_links(table, where)
    _check_values(table, where, chunks)
    _check_rows(table, where)
    _check_nesting(table, where)


def _check_nesting(table: NodeTable, where: str) -> None:
    """Raise an error unless boxes and errors of children are smaller than those of their parent."""
    parents = table.parents()[1:]
    low, high = table.low.astype(np.float64), table.high.astype(np.float64)
    slack = _SLACK * (high[parents] - low[parents]).max(axis=1, keepdims=True)
    outside = (low[1:] < low[parents] - slack) | (high[1:] > high[parents] + slack)
    if outside.any():
        node = 1 + int(np.flatnonzero(outside.any(axis=1))[0])
        raise StageError(where, f"node {node} beyond the box of its parent", "nested boxes")
    errors = table.errors.astype(np.float64)
    growing = errors[parents] < NESTED * (1 - 1e-6) * errors[1:]
    if growing.any():
        node = 1 + int(np.flatnonzero(growing)[0])
        found = f"node {node} with the error {table.errors[node]:g}"
        raise StageError(where, found, f"at most 1/{NESTED:g} of its parent's")


def _check_rows(table: NodeTable, where: str) -> None:
    """Raise an error if two nodes have a row of a chunk in common."""
    counts = table.proxies + table.residents
    filled = np.flatnonzero(counts)
    order = filled[np.lexsort((table.first_row[filled], table.chunk[filled]))]
    ends = (table.first_row + counts)[order]
    shared = table.chunk[order[1:]] == table.chunk[order[:-1]]
    overlapping = shared & (table.first_row[order[1:]] < ends[:-1])
    if overlapping.any():
        node = int(order[1 + np.flatnonzero(overlapping)[0]])
        found = f"node {node} with rows of chunk {table.chunk[node]} that another node has"
        raise StageError(where, found, "rows of its own")


def _check_links(table: NodeTable, where: str) -> None:
    """Raise an error unless every node but the first is the child of exactly one earlier node."""
    n = len(table)
    counts = table.child_count.astype(np.int64)
    if (counts < 0).any() or counts.sum() != n - 1:
        raise StageError(where, f"{counts.sum()} children", f"{n - 1}, as there are {n} nodes")
    inner = np.flatnonzero(counts)
    expected = 1 + np.cumsum(counts[inner]) - counts[inner]
    wrong = (table.first_child[inner] != expected) | (expected <= inner)
    if wrong.any():
        node = int(inner[np.flatnonzero(wrong)[0]])
        raise StageError(where, f"node {node} with wrong children", "nodes breadth first")
    begin, end = 0, 1
    for _ in range(MOST_LEVELS):  # the nodes of a level follow each other
        begin, end = end, end + int(counts[begin:end].sum())
        if begin == end:
            return
    raise StageError(where, f"more than {MOST_LEVELS} levels", "a tree of fewer levels")


def _check_values(table: NodeTable, where: str, chunks: int) -> None:
    """Raise an error for numbers that no node may have."""
    leaf = table.child_count == 0
    empty = table.proxies + table.residents == 0
    finite = np.isfinite(table.low) & np.isfinite(table.high)
    for wrong, what in (
        (~finite.all(axis=1), "a box that is not finite"),
        (~(table.low <= table.high).all(axis=1), "a box that is inside out"),
        ((table.proxies < 0) | (table.residents < 0), "a negative number of splats"),
        ((table.proxies > _ROWS) | (table.residents > _ROWS), "too many splats"),
        ((table.first_row < 0) | (table.first_row > _ROWS), "a row out of range"),
        (np.isnan(table.errors) | (table.errors < 0), "an error that is no length"),
        (leaf & (table.first_child != 0), "no children, but a first child"),
        (leaf & (table.errors != 0), "children missing, but an error above 0"),
        (~leaf & (table.errors == 0), "children, but the error 0"),
        (~leaf & (table.proxies == 0) & np.isfinite(table.errors), "children and no proxies"),
        ((table.chunk < -1) | (table.chunk >= chunks), f"a chunk beyond the {chunks} that are"),
        ((table.chunk == -1) & ~empty, "splats, but no chunk"),
    ):
        if wrong.any():
            node = int(np.flatnonzero(wrong)[0])
            raise StageError(where, f"node {node} with {what}", "the table of a splat tree")
