"""Read the splats of a splat tree: its leaves, a coarser level, a cut of a number of splats, or the
cut of a view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Usd

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.node_cuts import NodeCut, budget_cut, level_cut
from usdsplat.core.sh import coefficient_count
from usdsplat.render.specs import View
from usdsplat.schema.chunks import ChunkReader, check_chunk
from usdsplat.schema.tree import Tree
from usdsplat.schema.validation import missing_chunks


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewChoice:
    """The nodes that a picture of a view draws. Nodes out of view are as coarse as possible."""

    view: View
    """View in the world of the stage, at the time at which the stage is read."""
    error: float = 1.0
    """Largest projected error of a node that is not refined [pixel]."""
    budget: int = 0
    """Maximum number of splats in the view, of fields and trees; 0 for any. Only trees are
    reduced."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeChoice:
    """Which nodes of splat trees are read. A level, `max_splats` and a view exclude each other."""

    level: int = 0
    """Level of detail: 0 is the leaves, each further one the next coarser nodes, up to the root."""
    max_splats: int | None = None
    """Largest number of splats of a tree, filled by refining the largest errors first; None for the
    level."""
    view: ViewChoice | None = None
    """View that chooses for all trees and their instances; None for the level."""


LEAVES = TreeChoice()


@dataclass(frozen=True, slots=True, eq=False)
class TreeReading:
    """The nodes of a splat tree that are read."""

    prim: Usd.Prim
    tree: Tree
    cut: NodeCut

    @classmethod
    def of(cls, prim: Usd.Prim, choice: TreeChoice = LEAVES) -> TreeReading:
        """Choose the nodes without regard to a view; no chunk is opened.

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
        rows = self.cut.rows(self.tree.table)
        self._check_chunks(rows)
        return read_rows(self.tree.chunks, rows, self.tree.degree)

    def _check_chunks(self, rows: list[tuple[int, int, int]]) -> None:
        """Raise an error if a chunk lacks rows, before memory for all of them is allocated."""
        needed: dict[int, int] = {}
        for chunk, first, count in rows:
            needed[chunk] = max(needed.get(chunk, 0), first + count)
        for chunk, count in needed.items():
            path = self.tree.chunks[chunk]
            if not path:
                (found,) = missing_chunks(self.prim, self.tree)
                raise StageError(found.path, found.found, found.expected)
            check_chunk(path, count, self.tree.degree, "as in the tree")


def read_rows(
    chunks: Sequence[str], rows: Sequence[tuple[int, int, int]], degree: int
) -> SplatCloud:
    """Read rows of chunks as one cloud.

    Args:
        chunks: File of each chunk.
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
    start, reader = 0, ChunkReader(chunks, degree)
    for chunk, first, count in rows:
        part = reader.read(chunk, first, count)
        for name in ("positions", "scales", "rotations", "opacities", "sh"):
            getattr(cloud, name)[start : start + count] = getattr(part, name)
        start += count
    return cloud
