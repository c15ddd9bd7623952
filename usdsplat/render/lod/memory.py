"""Estimate the memory of a picture, with its splat trees."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace

import numpy as np

from usdsplat.render import memory
from usdsplat.render.lights.memory import node_bytes
from usdsplat.render.lights.needs import LightRequest
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
PER_PART = 4 * (3 + 4)
"""The same for the AOV of a light group."""
PER_LIGHT = 4 * 3
"""The same for the AOVs `shadow` and `irradiance`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewLoad:
    """What a picture of a view needs of the splat trees of a scene."""

    nodes: int
    """Number of nodes that are read; instances share them."""
    splats: int
    """Number of splats that are drawn; each instance counts."""
    bytes: int
    """Size of the splats of these nodes in memory."""


def view_load(scene: RenderScene, view: View, settings: RenderSettings) -> ViewLoad:
    """Return what a picture of a view without blur needs of the splat trees. Nothing is read."""
    cut = view_cut(scene, view, settings)
    coarsest = cut.error_at(1.0)
    sizes: dict[tuple[Hashable, int, bool], int] = {}  # trees of equal chunks share their splats
    for (_, tree), reached in zip(scene.drawn_trees(), cut.trees, strict=True):
        spec, table, seen = tree.spec, tree.spec.table, reached.keeping(reached.seen)
        whole = seen.nodes[seen.errors <= coarsest]  # in any instance and sample
        for of_proxies, nodes in ((False, seen.nodes), (True, whole)):
            counts = table.proxies if of_proxies else table.residents
            for node in np.unique(nodes[counts[nodes] > 0]).tolist():
                key = spec.chunks[table.chunk[node]], int(table.first_row[node]), of_proxies
                sizes[key] = int(counts[node]) * spec.splat_bytes
    read = {(chunk, row) for chunk, row, _ in sizes}
    return ViewLoad(nodes=len(read), splats=cut.splats, bytes=sum(sizes.values()))


def held_node_bytes(scene: RenderScene, view: View, settings: RenderSettings) -> int:
    """Return the bytes of nodes of splat trees that `estimate` counts for a picture."""
    if not scene.has_trees:
        return 0
    return max(scene.node_cache.bytes, view_load(scene, view, settings).bytes)


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
    load = view_load(scene, view, settings)
    more = max(0, load.bytes - scene.node_cache.bytes)
    lit = node_bytes(scene, view, settings, set(request.aovs), load.splats)
    buffers = request.pictures * (load.splats * PER_SPLAT + lit)
    x0, _, x1, _ = view.framing.window
    wanted = LightRequest.of(request.aovs)
    parts, others = len(wanted.parts), wanted.shadow + wanted.irradiance
    per_pixel = PER_PIXEL + PER_PART * parts + PER_LIGHT * others
    band = request.pictures * found.rows * (x1 - x0) * per_pixel
    return replace(
        found,
        held=found.held + more,
        splats=found.splats + buffers,
        band=found.band + band,
    )
