"""Read and write splat trees: the table of nodes on the prim, and rows of its chunks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Sdf, Usd, Vt

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.edit import take
from usdsplat.core.errors import StageError
from usdsplat.core.node_table import NodeTable, check_nodes
from usdsplat.schema import hints, tokens
from usdsplat.schema.attributes import set_uniform
from usdsplat.schema.field import fetch

TREE = "ParticleFieldSplatTree"
_CHUNKS = "splat:chunks"
_PIXEL = "splat:lod:pixel"
_COLUMNS = {
    "low": ("splat:nodeLow", np.float32),
    "high": ("splat:nodeHigh", np.float32),
    "errors": ("splat:nodeErrors", np.float32),
    "first_child": ("splat:nodeFirstChild", np.int32),
    "child_count": ("splat:nodeChildCount", np.int32),
    "chunk": ("splat:nodeChunk", np.int32),
    "first_row": ("splat:nodeFirstRow", np.int64),
    "proxies": ("splat:nodeProxies", np.int64),
    "residents": ("splat:nodeResidents", np.int64),
}
"""Column of the table -> attribute and type."""
_TYPES = {
    "low": (Sdf.ValueTypeNames.Float3Array, Vt.Vec3fArray),
    "high": (Sdf.ValueTypeNames.Float3Array, Vt.Vec3fArray),
    "errors": (Sdf.ValueTypeNames.FloatArray, Vt.FloatArray),
    "first_row": (Sdf.ValueTypeNames.Int64Array, Vt.Int64Array),
    "proxies": (Sdf.ValueTypeNames.Int64Array, Vt.Int64Array),
    "residents": (Sdf.ValueTypeNames.Int64Array, Vt.Int64Array),
}
"""Column -> types of its attribute; others are integers."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Tree:
    """A splat tree of a stage."""

    table: NodeTable
    chunks: tuple[str, ...]
    """Resolved path of each chunk's layer; "" for one that is missing."""
    degree: int
    color_space: str


def is_tree(prim: Usd.Prim) -> bool:
    """Return whether the prim is a splat tree."""
    return bool(prim) and prim.GetTypeName() == TREE


def author_tree(
    stage: Usd.Stage,
    path: str,
    table: NodeTable,
    chunks: Sequence[str],
    *,
    degree: int,
    color_space: str,
    drawing: hints.DrawingHints,
    pixel: float,
) -> Usd.Prim:
    """Write a splat tree.

    Args:
        chunks: Asset paths of the layers.
        drawing: Hints of the leaves.
        pixel: Size of the pixel at which the low-pass was baked into inner nodes [local unit].
    """
    prim = stage.DefinePrim(path, TREE)
    for column, (name, _) in _COLUMNS.items():
        kind, vt_kind = _TYPES.get(column, (Sdf.ValueTypeNames.IntArray, Vt.IntArray))
        array = np.ascontiguousarray(getattr(table, column))
        prim.CreateAttribute(name, kind, custom=False).Set(vt_kind.FromNumpy(array))
    assets = prim.CreateAttribute(_CHUNKS, Sdf.ValueTypeNames.AssetArray, custom=False)
    assets.Set([Sdf.AssetPath(each) for each in chunks])
    set_uniform(prim, tokens.SH_DEGREE, Sdf.ValueTypeNames.Int, degree)
    set_uniform(prim, _PIXEL, Sdf.ValueTypeNames.Float, pixel)
    Usd.ColorSpaceAPI.Apply(prim).CreateColorSpaceNameAttr(color_space)
    drawing.author(prim)
    return prim


def read_tree(prim: Usd.Prim) -> Tree:
    """Read the table of a splat tree.

    Raises:
        StageError: If the table is not that of a tree.
    """
    where = str(prim.GetPath())
    columns: dict[str, Any] = {}
    for column, (name, kind) in _COLUMNS.items():
        attribute = prim.GetAttribute(name)
        value = attribute.Get() if attribute else None
        columns[column] = np.array([] if value is None else value, kind)
    for column in ("low", "high"):
        columns[column] = columns[column].reshape(-1, 3)
    table = NodeTable(**columns)
    attribute = prim.GetAttribute(_CHUNKS)
    assets = attribute.Get() if attribute else None
    chunks = tuple(each.resolvedPath for each in assets or ())
    check_nodes(table, where, chunks=len(chunks))
    degree = prim.GetAttribute(tokens.SH_DEGREE)
    return Tree(
        table=table,
        chunks=chunks,
        degree=int(degree.Get() or 0) if degree else 0,
        color_space=hints.color_space(prim),
    )


def read_chunk(path: str, first: int, count: int) -> SplatCloud:
    """Read rows of a chunk.

    Args:
        path: Path of the layer, whose default prim is a splat field.

    Raises:
        UsdSplatError: If there are no such rows.
    """
    layer = Sdf.Layer.FindOrOpen(path)
    if layer is None:
        raise StageError(path, "no layer", "a chunk of a splat tree")
    stage = Usd.Stage.Open(layer, load=Usd.Stage.LoadAll)
    cloud = fetch(stage.GetDefaultPrim())
    if first + count > len(cloud):
        raise StageError(path, f"{len(cloud)} splats", f"at least {first + count}")
    return take(cloud, np.arange(first, first + count))
