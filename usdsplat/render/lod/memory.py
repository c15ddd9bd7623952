"""Estimate the memory of a picture, with its splat trees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from usdsplat.render import memory
from usdsplat.render.lod.cut import Cut
from usdsplat.render.lod.nodes import view_cut
from usdsplat.render.memory import Estimate, PictureRequest
from usdsplat.render.scene import RenderScene
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import View

PER_SPLAT = 250
"""Bytes of the buffers for one splat of a picture: projected and sorted records, keys, tile
lists."""
PER_PIXEL = 4 * (4 + 3 + 4 + 4 + 1)
"""Bytes of the buffers for one pixel of a band: sums over samples, and over their repetitions."""


def estimate(
    scene: RenderScene,
    view: View,
    settings: RenderSettings,
    request: PictureRequest,
    *,
    band_pixels: int,
    threads: int,
) -> Estimate:
    """Estimate the memory of a picture, see `memory.estimate`. Nothing is read."""
    found = memory.estimate(
        scene, view, settings, request, band_pixels=band_pixels, threads=threads
    )
    if not scene.has_trees:
        return found
    cut = view_cut(scene, view, settings)
    splats = cut.splats
    more = max(0, node_bytes(scene, cut) - scene.node_cache.bytes)
    buffers = request.pictures * splats * PER_SPLAT
    x0, _, x1, _ = view.framing.window
    band = request.pictures * found.rows * (x1 - x0) * PER_PIXEL
    return replace(
        found,
        held=found.held + more,
        splats=found.splats + buffers,
        band=found.band + band,
    )


def node_bytes(scene: RenderScene, cut: Cut) -> int:
    """Return the bytes of the splats that a cut draws. Instances of a tree share its nodes.

    Args:
        scene: The scene.
        cut: A `view_cut` of it.
    """
    total = 0
    for (_, tree), reached in zip(scene.drawn_trees(), cut.trees, strict=True):
        seen = reached.keeping(reached.seen)
        table = tree.spec.table
        whole = np.unique(seen.nodes[seen.errors <= cut.limit])
        splats = table.residents[np.unique(seen.nodes)].sum() + table.proxies[whole].sum()
        total += int(splats) * tree.spec.splat_bytes
    return total
