"""Read the splats of a splat tree: its leaves, a coarser level, or a cut of a number of splats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Usd

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.node_cuts import NodeCut, budget_cut, level_cut
from usdsplat.core.sh import coefficient_count
from usdsplat.schema.chunks import ChunkReader, check_chunk
from usdsplat.schema.tree import Tree
from usdsplat.schema.validation import missing_chunks


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeChoice:
    """Which nodes of splat trees are read. `max_splats` excludes a level."""

    level: int = 0
    """Level of detail: 0 is the leaves, each further one the next coarser nodes, up to the root."""
    max_splats: int | None = None
    """Largest number of splats of a tree, filled by refining the largest errors first; None for the
    level."""


LEAVES = TreeChoice()


@dataclass(frozen=True, slots=True, eq=False)
class TreeReading:
    """The nodes of a splat tree that are read."""

    prim: Usd.Prim
    tree: Tree
    cut: NodeCut

    @classmethod
    def of(cls, prim: Usd.Prim, choice: TreeChoice = LEAVES) -> TreeReading:
        """Choose the nodes; no chunk is opened.

        Raises:
            StageError: If the tree cannot be read, or has no cut with so few splats.
        """
        tree = schema.read_tree(prim)
        if choice.max_splats is None:
            return cls(prim, tree, level_cut(tree.table, choice.level))
        cut = budget_cut(tree.table, choice.max_splats)
        if (found := cut.splats(tree.table)) > choice.max_splats:
            said = f"{found} splats at its coarsest level"
            raise StageError(str(prim.GetPath()), said, f"at most {choice.max_splats}")
        return cls(prim, tree, cut)

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

    def cloud(self) -> SplatCloud:
        """Read the splats, in the local space of the tree.

        Raises:
            StageError: If a chunk is missing, cannot be read, or does not have these rows.
        """
        self.check_chunks()
        rows = self.cut.rows(self.tree.table)
        n, degree = len(self), self.tree.degree
        cloud = SplatCloud(
            positions=np.empty((n, 3), np.float32),
            scales=np.empty((n, 3), np.float32),
            rotations=np.empty((n, 4), np.float32),
            opacities=np.empty(n, np.float32),
            sh=np.empty((n, coefficient_count(degree), 3), np.float32),
        )
        start, reader = 0, ChunkReader(self.tree.chunks, degree)
        for chunk, first, count in rows:
            part = reader.read(chunk, first, count)
            for name in ("positions", "scales", "rotations", "opacities", "sh"):
                getattr(cloud, name)[start : start + count] = getattr(part, name)
            start += count
        return cloud

    def check_chunks(self) -> None:
        """Raise an error if a chunk lacks rows, before memory for all of them is allocated.

        Raises:
            StageError: If a chunk is missing, cannot be read, or does not have these rows.
        """
        needed: dict[int, int] = {}
        for chunk, first, count in self.cut.rows(self.tree.table):
            needed[chunk] = max(needed.get(chunk, 0), first + count)
        for chunk, count in needed.items():
            path = self.tree.chunks[chunk]
            if not path:
                (found,) = missing_chunks(self.prim, self.tree)
                raise StageError(found.path, found.found, found.expected)
            check_chunk(path, count, self.tree.degree, "as in the tree")
