"""Choose what is read of a splat tree: its leaves, a coarser level, a cut of a number of splats, or
the cut of a view."""

from __future__ import annotations

from dataclasses import dataclass

from pxr import Usd

from usdsplat.render.specs import View
from usdsplat.schema.tree_cuts import TreeReading


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


def tree_reading(prim: Usd.Prim, choice: TreeChoice = LEAVES) -> TreeReading:
    """Choose the nodes of a splat tree without regard to a view; no chunk is opened.

    Raises:
        StageError: If the tree cannot be read, or has no cut with so few splats.
    """
    if choice.max_splats is None:
        return TreeReading.at_level(prim, choice.level)
    return TreeReading.within(prim, choice.max_splats)
