"""Find the level of a splat tree that a splat of a picture is on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import I32, I64
from usdsplat.preview import palette
from usdsplat.render.lod.tree import TreeSpec
from usdsplat.render.scene import RenderScene

NO_TREE = 0
"""Entry of `Levels.colors` for splats that are in no tree."""
OTHERS = (96, 96, 96)
"""Their colour."""


@dataclass(frozen=True, slots=True, eq=False)
class TreeLevels:
    """The levels of one tree, by element id."""

    firsts: I64
    """First element id of each run of splats of a node, ascending."""
    levels: I32
    """Level of each run: 0 is the root."""
    depth: int
    """Number of levels."""

    @classmethod
    def of(cls, spec: TreeSpec) -> TreeLevels:
        """Return the levels of a tree."""
        table = spec.table
        spans = table.levels()
        level = np.repeat(np.arange(len(spans)), [end - start for start, end in spans])
        is_leaf = table.child_count == 0
        captured, proxies = spec.first_elements()
        has_some = table.residents + np.where(is_leaf, table.proxies, 0) > 0
        has_proxies = ~is_leaf & (table.proxies > 0)
        firsts = np.concatenate([captured[has_some], proxies[has_proxies]])
        found = np.concatenate([level[has_some], level[has_proxies]])
        order = np.argsort(firsts, kind="stable")
        return cls(firsts[order], found[order].astype(np.int32), len(spans))

    def at(self, elements: npt.NDArray[np.integer]) -> I32:
        """Return the levels of element ids, shape (n,)."""
        return self.levels[np.searchsorted(self.firsts, elements, "right") - 1]


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """The levels of all trees of a scene, by the paths of their prims."""

    trees: Mapping[str, TreeLevels]

    @classmethod
    def of(cls, scene: RenderScene) -> Levels:
        """Return the levels of the drawn trees of a scene."""
        trees: dict[str, TreeLevels] = {}
        for _, tree in scene.drawn_trees():
            found = TreeLevels.of(tree.spec)
            trees |= {instance.path: found for instance in tree.instances}
        return cls(trees)

    @property
    def colors(self) -> palette.Bytes:
        """Colours of `at`: from blue, the root, to red, the finest level of the deepest tree; shape
        (n, 3)."""
        depth = max((tree.depth for tree in self.trees.values()), default=1)
        rows = np.linspace(25, 230, depth).astype(int)
        return np.concatenate([[OTHERS], palette.RAMPS["turbo"][rows]]).astype(np.uint8)

    def at(self, prim_ids: I32, elements: I32, prims: tuple[str, ...]) -> I32:
        """Return the colour's number for each pixel: -1 where nothing is, `NO_TREE` where no tree
        is, else its level and 1.

        Args:
            prim_ids: Numbers of the prims, -1 where nothing is, shape (h, w).
            elements: Element ids, of the same shape.
            prims: Paths of the prims by number.
        """
        found = np.where(prim_ids < 0, -1, NO_TREE).astype(np.int32)
        for number, path in enumerate(prims):
            if path in self.trees:
                there = prim_ids == number
                found[there] = self.trees[path].at(elements[there]) + 1
        return found
