"""Write the coarse levels of a tree as stock fields, for renderers that do not draw trees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.node_cuts import NodeCut, budget_cut
from usdsplat.core.node_table import NodeTable
from usdsplat.interchange import files
from usdsplat.interchange.authoring import prepare
from usdsplat.interchange.lod.chunks import ChunkForm
from usdsplat.schema.chunks import ChunkReader
from usdsplat.schema.extent import compute_extent
from usdsplat.schema.lod_root_authoring import author_lod_root
from usdsplat.schema.tree_cuts import read_rows

COARSE = "coarse"
"""Name of the prim beside the tree, below which the LOD root is."""
ROOT = "levels"
"""Name of the LOD root."""
FILE: str = f"{COARSE}.usdc"
"""Name of the layer in the folder of the chunks."""

_MOST = (81_920, 20_480, 5_120)
"""Largest number of splats of each field: 64 k, 16 k and 4 k proxies, and a quarter for
residents."""
_PICTURE = 1920 * 1080
"""Number of pixels of the picture for which the thresholds are chosen."""
_LARGEST = 1e30
"""Limit of a threshold, which single precision can hold."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Level:
    """A level of a tree that becomes a field."""

    cut: NodeCut
    splats: int
    error: float
    """Largest error of its nodes [local unit]."""
    is_coarse: bool
    """Whether most of its splats are proxies."""


def coarse_levels(table: NodeTable) -> list[Level]:
    """Return the levels of a tree that become fields, the finest first, one to three.

    They consist mostly of proxies, and none has as many splats as another. A tree without such a
    level has its coarsest one.
    """
    levels = {each.splats: each for each in (_level(table, most) for most in _MOST)}
    coarse = [each for each in levels.values() if each.is_coarse]
    return coarse or [*levels.values()][-1:]


def write_coarse(
    target: Path, table: NodeTable, chunks: Sequence[Path], form: ChunkForm, *, degree: int
) -> tuple[int, ...]:
    """Write the coarse levels of a tree as a layer with an LOD root, in the tree's local space.

    The default prim is an Xform that can be referenced beside the tree. An item is drawn until the
    errors of the next one are those of a pixel of a picture of 1920 x 1080.

    Args:
        target: File of the layer, .usdc.
        table: The tree.
        chunks: File of each of its chunks.
        form: What all chunks have in common.
        degree: Degree of their harmonics.

    Returns:
        Number of splats of each field, the finest first.

    Raises:
        OutputError: If the file cannot be written.
    """
    levels = coarse_levels(table)
    reader = ChunkReader(list(map(str, chunks)), degree)
    clouds = [read_rows(reader, each.cut.rows(table), degree) for each in levels]
    fields, thresholds = clouds[:1], [_LARGEST]
    for each, cloud in zip(levels[1:], clouds[1:], strict=True):
        area = math.pi * (_radius(clouds) / each.error) ** 2 / _PICTURE
        if 0 < area < thresholds[-1]:  # not if its errors are no larger, or the tree is a point
            fields.append(cloud)
            thresholds.append(area)
    stage = Usd.Stage.CreateInMemory()
    prepare(stage, form.up_axis, form.meters_per_unit)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, f"/{COARSE}").GetPrim())
    author_lod_root(
        stage,
        f"/{COARSE}/{ROOT}",
        fields,
        thresholds=thresholds[1:],
        drawing=form.hints(of_leaves=not levels[0].is_coarse),
        color_space=form.color_space,
    )
    files.save(stage.GetRootLayer(), target)
    return tuple(map(len, fields))


def referring(layer: Sdf.Layer, path: Sdf.Path, asset: str) -> Sdf.Layer:
    """Return a copy of a layer in which a prim refers to the layer of the coarse levels.

    The layer itself is on a stage, which cannot open that file before it is in place.
    """
    made = Sdf.Layer.CreateAnonymous()
    made.TransferContent(layer)
    made.GetPrimAtPath(path).referenceList.Prepend(Sdf.Reference(asset))
    return made


def _level(table: NodeTable, most: int) -> Level:
    """Return the level with at most so many splats."""
    cut = budget_cut(table, most)
    nodes, splats = cut.nodes, cut.splats(table)
    proxies = int(table.proxies[nodes[table.child_count[nodes] > 0]].sum())
    error = float(table.errors[nodes].max())
    return Level(cut=cut, splats=splats, error=error, is_coarse=2 * proxies > splats)


def _radius(fields: Sequence[SplatCloud]) -> float:
    """Return the radius of the sphere around the box of all fields [local unit]."""
    boxes = np.stack([compute_extent(cloud) for cloud in fields]).astype(np.float64)
    return float(np.linalg.norm(boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0))) / 2
