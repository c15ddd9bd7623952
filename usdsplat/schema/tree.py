"""Read splat trees: the table of nodes on the prim, and rows of its chunks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.edit import take
from usdsplat.core.errors import StageError
from usdsplat.core.node_table import NodeTable, check_nodes
from usdsplat.schema import hints, tokens
from usdsplat.schema.field import fetch

TREE = "ParticleFieldSplatTree"
CHUNKS = "splat:chunks"
COLUMNS = {
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

ATTRIBUTES = frozenset({CHUNKS, *(name for name, _ in COLUMNS.values())})
"""Attributes from which a tree is read, besides those that fields have too."""


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


def read_tree(prim: Usd.Prim) -> Tree:
    """Read the table of a splat tree.

    Raises:
        StageError: If the table is not that of a tree.
    """
    where = str(prim.GetPath())
    columns: dict[str, Any] = {}
    for column, (name, kind) in COLUMNS.items():
        attribute = prim.GetAttribute(name)
        value = attribute.Get() if attribute else None
        columns[column] = np.array([] if value is None else value, kind)
    for column in ("low", "high"):
        columns[column] = columns[column].reshape(-1, 3)
    table = NodeTable(**columns)
    attribute = prim.GetAttribute(CHUNKS)
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
