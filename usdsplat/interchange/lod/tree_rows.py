"""Read the leaves and residents of a splat tree in parts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from usdsplat.core import edit
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.node_cuts import level_cut
from usdsplat.core.node_table import NodeTable
from usdsplat.interchange.lod.chunks import joined
from usdsplat.interchange.lod.survey import SAMPLED
from usdsplat.schema.chunks import ChunkReader

WINDOW = 1 << 19
"""Number of splats that `sample` reads at a time."""


class TreeRows:
    """The splats of a capture in a tree, numbered in the order of its chunks.

    Only the rows that are asked for are in memory, and some unpacked SOG files.

    Args:
        table: A valid table.
        reader: Reader of its chunks.
    """

    def __init__(self, table: NodeTable, reader: ChunkReader) -> None:
        rows = np.array(level_cut(table, 0).rows(table), np.int64).reshape(-1, 3)
        chunk, first, count = rows.T
        # Nodes that follow each other in a chunk are read together.
        starts = np.ones(len(rows), bool)
        starts[1:] = (chunk[1:] != chunk[:-1]) | (first[1:] != (first + count)[:-1])
        self._chunk, self._first = chunk[starts], first[starts]
        ends = np.cumsum(count)
        self._ends = ends[np.append(starts[1:], True)] if len(rows) else ends
        self._reader = reader
        self.count = int(ends[-1]) if len(rows) else 0
        """Number of splats."""

    def rows(self, first: int, last: int) -> SplatCloud:
        """Return splats `first` to `last`, at least one, in the local space of the tree.

        Raises:
            StageError: If a chunk cannot be read, or does not have these rows.
        """
        parts = []
        place = int(np.searchsorted(self._ends, first, side="right"))
        while first < last:
            end = int(self._ends[place])
            begin = int(self._ends[place - 1]) if place else 0
            taken = min(last, end) - first
            row = int(self._first[place]) + first - begin
            parts.append(self._reader.read(int(self._chunk[place]), row, taken))
            first, place = first + taken, place + 1
        return joined(parts)

    def sample(self) -> Iterator[tuple[SplatCloud, F32]]:
        """Read all splats, and yield some of each part of them, and all its centres, shape (k, 3).

        Raises:
            StageError: As for `rows`.
        """
        step = max(1, self.count // SAMPLED)
        for first in range(0, self.count, WINDOW):
            part = self.rows(first, min(self.count, first + WINDOW))
            yield edit.take(part, np.arange(-first % step, len(part), step)), part.positions
