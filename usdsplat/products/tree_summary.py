"""Describe a splat tree in values that JSON can hold, without reading splats."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.errors import UsdSplatError
from usdsplat.core.node_cuts import heights, level_cut
from usdsplat.core.node_table import NodeTable
from usdsplat.core.progress import Progress, silent
from usdsplat.interchange.authoring import prepare
from usdsplat.interchange.streamed import open_streamed
from usdsplat.interchange.unapplied import is_cropped, is_graded
from usdsplat.schema.chunks import chunk_size

_OF_PRIMS = ("path", "type", "graded", "cropped", "purpose")
"""Parts of the description of a tree that say nothing of a capture."""


def of_tree(prim: Usd.Prim, time: float | None) -> dict[str, Any]:
    """Describe a splat tree, or the reason why it cannot be read.

    Args:
        prim: A prim for which `schema.is_tree` is true.
        time: Time code of the grade; None for the default value, or the first sample.
    """
    identity = {"path": str(prim.GetPath()), "type": str(prim.GetTypeName())}
    try:
        tree = schema.read_tree(prim)
    except UsdSplatError as error:
        return {**identity, "problem": str(error)}
    table, lod_root = tree.table, prim.GetRelationship(schema.tokens.LOD_ROOT)
    used = sorted(set(table.chunk.tolist()) - {-1})
    files = [tree.chunks[row] for row in used if tree.chunks[row]]
    size = sum(map(chunk_size, files))
    splats = level_cut(table, 0).splats(table)
    return {
        **identity,
        "splats": splats,
        "sh_degree": tree.degree,
        "bounds": [table.low[0].tolist(), table.high[0].tolist()],
        "nodes": len(table),
        "residents": int(table.residents.sum()),
        "chunks": len(used),
        "chunks_missing": len(used) - len(files),
        "bytes": size,
        "bytes_per_splat": size / max(1, splats),
        "filtered_pixel": tree.pixel or None,
        "color_space": tree.color_space,
        "rasterize_mode": tree.drawing.rasterize_mode,
        "footprint": tree.drawing.footprint,
        "projection_mode": tree.drawing.projection_mode,
        "sorting_mode": tree.drawing.sorting_mode,
        "graded": is_graded(prim, time),
        "cropped": is_cropped(prim),
        "lod_root": next(iter(map(str, lod_root.GetTargets())), None) if lod_root else None,
        "purpose": str(UsdGeom.Imageable(prim).ComputePurpose()),
        "levels": _levels(table),
    }


def of_streamed(path: Path, *, progress: Progress = silent) -> tuple[dict[str, Any], Usd.Stage]:
    """Describe a streamed SOG with the axes that opening it would choose.

    Args:
        path: `lod-meta.json`, or its folder.
        progress: Receives the progress of reading metadata and sizes.

    Returns:
        The description, and a stage in memory with the tree.

    Raises:
        UsdSplatError: If it cannot be read.
    """
    stage = Usd.Stage.CreateInMemory()
    prepare(stage, None, None)
    prim, capture = open_streamed(path, stage, progress=progress)
    described = {
        "format": capture.format,
        "frame": capture.frame,
        "frame_source": capture.frame_source,
        **of_tree(prim, None),
        "error_bounds": dict(capture.error_bounds),
        "notes": list(capture.notes),
    }
    return {name: each for name, each in described.items() if name not in _OF_PRIMS}, stage


def _levels(table: NodeTable) -> list[dict[str, Any]]:
    """Return nodes, splats and largest error of the cut at each level, the finest first."""
    described = []
    above = heights(table)[np.isfinite(table.errors)]  # a node without proxies is no level
    for level in range(int(above.max(initial=0)) + 1):
        cut = level_cut(table, level)
        described.append(
            {
                "level": level,
                "nodes": len(cut.nodes),
                "splats": cut.splats(table),
                "error": float(np.max(table.errors[cut.nodes])),
            }
        )
    return described
