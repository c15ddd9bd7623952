"""Read the splats of a cut of a splat tree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Usd

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.node_cuts import NodeCut, budget_cut, level_cut
from usdsplat.core.sh import coefficient_count
from usdsplat.schema.chunks import ChunkReader, check_chunk
from usdsplat.schema.tree import Tree, read_tree
from usdsplat.schema.validation.trees import missing_chunks


@dataclass(frozen=True, slots=True, eq=False)
class TreeReading:
    """The nodes of a splat tree that are read."""

    prim: Usd.Prim
    tree: Tree
    cut: NodeCut

    @classmethod
    def at_level(cls, prim: Usd.Prim, level: int) -> TreeReading:
        """Choose the nodes of a level, see `level_cut`; no chunk is opened.

        Raises:
            StageError: If the tree cannot be read.
        """
        tree = read_tree(prim)
        return cls(prim, tree, level_cut(tree.table, level))

    @classmethod
    def within(cls, prim: Usd.Prim, most: int) -> TreeReading:
        """Choose nodes with at most `most` splats by refining the largest errors first; no chunk is
        opened.

        Raises:
            StageError: If the tree cannot be read, or has no cut with so few splats.
        """
        tree = read_tree(prim)
        found = cls(prim, tree, budget_cut(tree.table, most))
        if len(found) > most:
            said = f"{len(found)} splats at its coarsest level"
            raise StageError(str(prim.GetPath()), said, f"at most {most}")
        return found

    def __len__(self) -> int:
        """Return the number of splats."""
        return self.cut.splats(self.tree.table)

    @property
    def rasterize_mode(self) -> str:
        """Mode of most of the splats: that of the leaves, or "antialiased" for proxies."""
        table, nodes = self.tree.table, self.cut.nodes
        proxies = int(table.proxies[nodes[table.child_count[nodes] > 0]].sum())
        mode = self.tree.drawing.rasterize_mode or "classic"
        return "antialiased" if 2 * proxies > len(self) else mode

    @property
    def files(self) -> tuple[str, ...]:
        """Resolved paths of the chunks that are read."""
        chunks = {chunk for chunk, _, _ in self.cut.rows(self.tree.table)}
        return tuple(self.tree.chunks[chunk] for chunk in sorted(chunks))

    def cloud(self) -> SplatCloud:
        """Read the splats, in the local space of the tree.

        Raises:
            StageError: If a chunk is missing, cannot be read, or does not have these rows.
        """
        self.check_chunks()  # before memory for all of them is allocated
        return read_rows(self.tree.reader(), self.cut.rows(self.tree.table), self.tree.degree)

    def check_chunks(self) -> None:
        """Check that the chunks have the splats, without reading them.

        Raises:
            StageError: If a chunk is missing, cannot be read, or does not have these rows.
        """
        tree = self.tree
        needed: dict[int, int] = {}
        for chunk, first, count in self.cut.rows(tree.table):
            needed[chunk] = max(needed.get(chunk, 0), first + count)
        for chunk, count in needed.items():
            path = tree.chunks[chunk]
            if not path:
                (found,) = missing_chunks(self.prim, tree)
                raise StageError(found.path, found.found, found.expected)
            check_chunk(path, count, tree.degree, "as in the tree", tree.digest(chunk))


def read_rows(reader: ChunkReader, rows: Sequence[tuple[int, int, int]], degree: int) -> SplatCloud:
    """Read rows of chunks as one cloud.

    Args:
        reader: Reader of the chunks.
        rows: What to read, as (chunk, first row, number of rows); see `NodeCut.rows`.
        degree: Degree of the harmonics of the chunks.

    Raises:
        StageError: If a chunk cannot be read, or does not have these rows.
    """
    n = sum(count for _, _, count in rows)
    cloud = SplatCloud(
        positions=np.empty((n, 3), np.float32),
        scales=np.empty((n, 3), np.float32),
        rotations=np.empty((n, 4), np.float32),
        opacities=np.empty(n, np.float32),
        sh=np.empty((n, coefficient_count(degree), 3), np.float32),
    )
    start = 0
    for chunk, first, count in rows:
        part = reader.read(chunk, first, count)
        for name in ("positions", "scales", "rotations", "opacities", "sh"):
            getattr(cloud, name)[start : start + count] = getattr(part, name)
        start += count
    return cloud
