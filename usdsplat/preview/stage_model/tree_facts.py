"""Facts about a splat tree of the render scene, and what of it is in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from usdsplat.core.node_cuts import heights
from usdsplat.render.lod.appearances import Part
from usdsplat.render.scene import RenderScene

DRAWN = "Drawn now"
"""Name of the fact that changes with each picture."""


def tree_facts(scene: RenderScene, path: str) -> Iterator[tuple[str, str]]:
    """Yield names and texts of facts about the tree at `path`; none if no tree was read there,
    such as one that is hidden.

    Levels are counted as `usdsplat info` does: nodes without proxies are none.
    """
    tree = scene.tree(path)
    if tree is None:
        return
    spec, table, cache = tree.spec, tree.spec.table, scene.node_cache
    levels = int(heights(table)[np.isfinite(table.errors)].max(initial=0)) + 1
    there = {part: each.size for part, (key, each) in list(tree.requests.items()) if key in cache}
    drawn = tree.fields
    yield "Splats", f"{spec.captured:,}"
    yield "SH degree", str(spec.degree)
    yield "Colour space", spec.color_space
    yield "Levels", str(levels)
    yield "Nodes", f"{len(table):,}"
    yield "Chunks", f"{len(spec.chunks):,}"
    yield DRAWN, _counted(drawn, sum(len(each.spec.cloud) for each in drawn.values()))
    size = sum(there.values())
    yield "In memory", f"{_counted(there, size // spec.splat_bytes)}, {size / 1e6:,.1f} MB"


def _counted(parts: Iterable[Part], splats: int) -> str:
    """Return the number of nodes with some parts, and of splats; instances do not count."""
    return f"{len({node for node, _ in parts}):,} nodes, {splats:,} splats"
