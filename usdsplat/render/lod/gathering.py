"""Gather the trees and screens of all samples of a picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from usdsplat.render.lod.cut import TreeView
from usdsplat.render.lod.placing import Placed, Placing
from usdsplat.render.lod.tree import Tree, TreeSpec
from usdsplat.render.sampling import Sample
from usdsplat.render.scene import RenderScene
from usdsplat.render.screen import Screen
from usdsplat.render.specs import InstanceSpec, View

TimeSampler = Callable[[float], tuple[RenderScene, View]]


@dataclass(eq=False)
class SeenTree:
    """A tree in all samples of a picture."""

    tree: Tree
    spec: TreeSpec
    rows: dict[tuple[str, int], int]
    """(path, index) of an instance -> its row in the cut."""
    placings: tuple[Placing, ...]
    """The instances in each of k samples."""

    def view(self) -> TreeView:
        """Return the tree as `choose` takes it."""
        return TreeView(
            table=self.spec.table,
            placings=self.placings,
            closed=frozenset(self.tree.closed),
            tangential=self.spec.projection_mode == "tangential",
        )


def gathered(
    sampler: TimeSampler, plan: Sequence[Sample], reach: float = 0.0
) -> tuple[RenderScene, list[Screen], dict[str, SeenTree]]:
    """Return the scene at the picture's time, and its trees and screens in all samples.

    Args:
        sampler: Scene and view at a time relative to the picture's.
        plan: Samples of the picture.
        reach: Largest offset of a sample from a pixel's centre [pixel], by which windows grow.
    """
    poses: list[tuple[Screen, dict[str, tuple[InstanceSpec, ...]]]] = []
    trees: dict[str, Tree] = {}
    margin = math.ceil(reach)
    lenses = sorted({(each.time, each.lens) for each in plan})
    try:
        for time in sorted({time for time, _ in lenses}):
            scene, view = sampler(time)
            found = scene.drawn_trees()
            trees |= dict(found)
            placed = {path: tree.instances for path, tree in found}
            screen = Screen.of(view)
            x0, y0, x1, y1 = screen.window
            screen = replace(screen, window=(x0 - margin, y0 - margin, x1 + margin, y1 + margin))
            for at, lens in lenses:
                if at == time:
                    through = screen.through(lens, view.camera.focus_distance, (0.0, 0.0))
                    poses.append((through, placed))
    finally:  # samples move the scene in time; return to the frame, also after an error
        scene, _ = sampler(0.0)
    seen = {}
    for path, tree in sorted(trees.items()):
        instances = tuple(each.get(path, ()) for _, each in poses)
        last = tree.placed
        if last is None or not last.is_of(instances):
            last = tree.placed = Placed.of(instances)
        seen[path] = SeenTree(tree, tree.spec, last.rows, last.placings)
    return scene, [screen for screen, _ in poses], seen
