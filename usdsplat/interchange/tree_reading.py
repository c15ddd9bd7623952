"""Read the splats of a splat tree: its leaves, a coarser level, a cut of a number of splats, or the
cut of a view."""

from __future__ import annotations

from dataclasses import dataclass

from pxr import Usd

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.node_cuts import NodeCut, level_cut
from usdsplat.render.specs import View
from usdsplat.schema.tree import Tree
from usdsplat.schema.tree_cuts import check_chunks, cut_rasterize_mode, cut_within, read_cut


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
        return cls(prim, tree, cut_within(prim, tree, choice.max_splats))

    def __len__(self) -> int:
        """Return the number of splats."""
        return self.cut.splats(self.tree.table)

    @property
    def rasterize_mode(self) -> str:
        """Mode of most of the splats: that of the leaves, or "antialiased" for proxies."""
        return cut_rasterize_mode(self.tree, self.cut)

    def cloud(self) -> SplatCloud:
        """Read the splats, in the local space of the tree.

        Raises:
            StageError: If a chunk is missing, cannot be read, or does not have these rows.
        """
        return read_cut(self.prim, self.tree, self.cut)

    def check_chunks(self) -> None:
        """Check that the chunks have the splats, without reading them.

        Raises:
            StageError: If a chunk is missing, cannot be read, or does not have these rows.
        """
        check_chunks(self.prim, self.tree, self.cut)
