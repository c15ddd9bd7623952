"""Read and write our splat tree, ParticleFieldSplatTree: a table of nodes, and chunks of splats.

The splats are in layers of their own, see `chunks`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, Vt

from usdsplat.core.cloud import F32
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.node_table import NodeTable, check_nodes
from usdsplat.core.sh import MAX_DEGREE
from usdsplat.schema import attributes, hints, registration, tokens
from usdsplat.schema.attributes import Array, set_array, set_uniform
from usdsplat.schema.chunk_layers import PackedChunk
from usdsplat.schema.chunks import (
    ChunkReader,
    chunk_shape,
    read_chunk,
    read_packed_chunk,
)
from usdsplat.schema.crate_arrays import check_arrays
from usdsplat.schema.defining import author_color_space, author_fallback_type, define
from usdsplat.schema.hints import DrawingHints
from usdsplat.schema.vt import to_vt

__all__ = [
    "TREE",
    "PackedChunk",
    "Tree",
    "author_digests",
    "author_tree",
    "chunk_files",
    "chunk_shape",
    "is_tree",
    "read_chunk",
    "read_packed_chunk",
    "read_tree",
]

TREE = tokens.TREE_TYPE

_Type = Sdf.ValueTypeNames
_MOST = 3.4e38
"""Limit of an extent, which single precision can hold."""
_COLUMNS: dict[str, tuple[Sdf.ValueTypeName, type, type, tuple[int, ...]]] = {
    tokens.NODE_LOW: (_Type.Float3Array, Vt.Vec3fArray, np.float32, (3,)),
    tokens.NODE_HIGH: (_Type.Float3Array, Vt.Vec3fArray, np.float32, (3,)),
    tokens.NODE_ERRORS: (_Type.FloatArray, Vt.FloatArray, np.float32, ()),
    tokens.NODE_FIRST_CHILD: (_Type.IntArray, Vt.IntArray, np.int32, ()),
    tokens.NODE_CHILD_COUNT: (_Type.IntArray, Vt.IntArray, np.int32, ()),
    tokens.NODE_CHUNK: (_Type.IntArray, Vt.IntArray, np.int32, ()),
    tokens.NODE_FIRST_ROW: (_Type.Int64Array, Vt.Int64Array, np.int64, ()),
    tokens.NODE_PROXIES: (_Type.Int64Array, Vt.Int64Array, np.int64, ()),
    tokens.NODE_RESIDENTS: (_Type.Int64Array, Vt.Int64Array, np.int64, ()),
}
"""Attribute -> its type, its array class, and dtype and shape of a row."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Tree:
    """A splat tree as read from its prim; no chunk has been opened."""

    table: NodeTable
    chunks: tuple[str, ...]
    """Resolved paths of the layers with the splats; "" for one that does not exist."""
    chunk_names: tuple[str, ...]
    """The same as authored."""
    digests: tuple[str, ...] = ()
    """Digest that each of these layers must state, "" for any; empty for none."""
    degree: int
    """Degree of the harmonics of all chunks, 0 to 4."""
    color_space: str
    drawing: DrawingHints
    """Rendering hints; each has a value, but the footprint may be None."""
    pixel: float
    """Size of the pixel for which the low-pass filter is part of the proxies [local unit]; 0 if it
    is not."""

    def digest(self, chunk: int) -> str:
        """Return the digest that a chunk must state; "" for any."""
        return self.digests[chunk] if self.digests else ""

    def reader(self) -> ChunkReader:
        """Return a reader of the chunks."""
        return ChunkReader(self.chunks, self.degree, self.digests)


def is_tree(prim: Usd.Prim) -> bool:
    """Return whether the prim is a splat tree, whether USD knows the type or not."""
    return bool(prim) and bool(prim.GetTypeName() == TREE)


def author_tree(
    stage: Usd.Stage,
    path: str | Sdf.Path,
    table: NodeTable,
    chunks: Sequence[str],
    *,
    degree: int,
    color_space: str | None = None,
    drawing: DrawingHints,
    pixel: float = 0.0,
) -> Usd.Prim:
    """Write a splat tree on the stage's edit target, without digests of its chunks.

    Args:
        stage: The stage; its edit target is written.
        path: Absolute path of the prim.
        table: The nodes.
        chunks: Asset paths of the layers with the splats, written as they are.
        degree: Degree of the harmonics of all chunks.
        color_space: Colour space of the harmonics; None keeps the authored or inherited one, or
            writes srgb_rec709_scene if there is none.
        drawing: Rendering hints; rasterize mode and footprint are those of the leaves.
        pixel: Size of the pixel for which the low-pass filter is part of the proxies [local unit];
            0 if it is not.

    Returns:
        The prim.

    Raises:
        StageError: If the table is not that of a tree, or the prim cannot be written.
        UsageError: If an option has an invalid value.
        SchemaUnavailableError: If USD does not know the type.
    """
    registration.require(str(path))
    check_nodes(table, str(path), chunks=len(chunks))
    if not 0 <= degree <= MAX_DEGREE:
        raise UsageError("degree", str(degree), f"0 to {MAX_DEGREE}")
    if not 0 <= pixel < math.inf:
        raise UsageError("pixel", f"{pixel:g}", "a finite number, at least 0")
    if color_space is not None and not hints.is_known_color_space(color_space):
        expected = f"a Gf name such as {tokens.DEFAULT_COLOR_SPACE}"
        raise UsageError("color_space", repr(color_space), expected)
    prim = define(stage, path, TREE)
    default = Usd.TimeCode.Default()
    for name, (kind, vt_kind, dtype, _) in _COLUMNS.items():
        column: Array = np.asarray(getattr(table, tokens.NODE_COLUMNS[name]), dtype)
        set_array(prim, name, kind, to_vt(column, vt_kind), default)
    assets = Sdf.AssetPathArray([Sdf.AssetPath(chunk) for chunk in chunks])
    set_array(prim, tokens.CHUNKS, _Type.AssetArray, assets, default)
    attributes.silence(prim, [tokens.CHUNK_DIGESTS])  # of an earlier tree at this path
    box = to_vt(_extent(table), Vt.Vec3fArray)
    set_array(prim, tokens.EXTENT, _Type.Float3Array, box, default)
    set_uniform(prim, tokens.LOD_PIXEL, _Type.Float, pixel)
    set_uniform(prim, tokens.SH_DEGREE, _Type.Int, degree)
    author_fallback_type(stage, TREE)
    author_color_space(prim, color_space)
    drawing.author(prim)
    return prim


def author_digests(prim: Usd.Prim, digests: Sequence[str]) -> None:
    """Write the digests of the chunks of a tree: a chunk that states another one is not read.

    Args:
        prim: Result of `author_tree`.
        digests: One for each chunk, from `chunk_layers.state_digest`; "" for any.

    Raises:
        UsageError: If there is another number of chunks.
    """
    if len(digests) != (chunks := len(_assets(prim))):
        raise UsageError("digests", str(len(digests)), f"{chunks}, one for each chunk")
    values, default = Vt.StringArray(digests), Usd.TimeCode.Default()
    set_array(prim, tokens.CHUNK_DIGESTS, _Type.StringArray, values, default)


def read_tree(prim: Usd.Prim) -> Tree:
    """Read the table of a splat tree and the paths of its chunks.

    Raises:
        StageError: If the prim is no splat tree, or an attribute has a type or a value that no tree
            has. A chunk that does not exist is no error.
        SchemaUnavailableError: If USD does not know the type.
    """
    if not is_tree(prim):
        found = f"a prim of type {prim.GetTypeName()!s}" if prim else "no prim"
        raise StageError(str(prim.GetPath()) if prim else "prim", found, TREE)
    where = str(prim.GetPath())
    registration.require(where)
    _check_layers(prim)
    columns = {tokens.NODE_COLUMNS[name]: _column(prim, name) for name in _COLUMNS}
    assets = _assets(prim)
    table = NodeTable(**columns)
    check_nodes(table, where, chunks=len(assets))
    chunks = chunk_files(prim)
    _check_distinct(chunks, f"{where}.{tokens.CHUNKS}")
    return Tree(
        table=table,
        chunks=chunks,
        chunk_names=tuple(asset.path for asset in assets),
        digests=_digests(prim, len(assets)),
        degree=_degree(prim),
        color_space=hints.color_space(prim),
        drawing=DrawingHints(
            rasterize_mode=hints.rasterize_mode(prim),
            projection_mode=hints.projection_mode(prim),
            sorting_mode=hints.sorting_mode(prim),
            footprint=hints.footprint(prim),
        ),
        pixel=_pixel(prim),
    )


def chunk_files(prim: Usd.Prim) -> tuple[str, ...]:
    """Return what `Tree.chunks` of the prim would be now, without reading its table.

    Raises:
        StageError: If the attribute has another type than the schema's.
    """
    return tuple(_resolved(asset) for asset in _assets(prim))


def _check_layers(prim: Usd.Prim) -> None:
    """Raise an error if a layer with node arrays asks for much more memory than it has bytes.

    Raises:
        StageError: If one does.
    """
    stacks = (prim.GetAttribute(name).GetPropertyStack(Usd.TimeCode.Default()) for name in _COLUMNS)
    for path in {spec.layer.realPath for stack in stacks for spec in stack} - {""}:
        check_arrays(path, is_chunk=False)


def _column(prim: Usd.Prim, name: str) -> Array:
    """Return a copy of a node array; empty without a value.

    Raises:
        StageError: If it has another type than the schema's.
    """
    kind, _, dtype, row = _COLUMNS[name]
    found = prim.GetAttribute(name).Get()
    if found is None:
        return np.empty((0, *row), dtype)
    array = attributes.as_array(found)
    if array is None or array.dtype != dtype or array.shape[1:] != row:
        what = f"a value of type {type(found).__name__}"
        raise StageError(f"{prim.GetPath()}.{name}", what, str(kind))
    return np.array(array)


def _assets(prim: Usd.Prim) -> list[Sdf.AssetPath]:
    """Return the asset paths of the chunks.

    Raises:
        StageError: If the attribute has another type.
    """
    attribute = prim.GetAttribute(tokens.CHUNKS)
    found = attribute.Get() if attribute else None
    if found is None:
        return []
    if not isinstance(found, Sdf.AssetPathArray):
        what = f"a value of type {type(found).__name__}"
        raise StageError(f"{prim.GetPath()}.{tokens.CHUNKS}", what, str(_Type.AssetArray))
    return list(found)


def _digests(prim: Usd.Prim, chunks: int) -> tuple[str, ...]:
    """Return the digests of the chunks; empty without a value.

    Raises:
        StageError: If the attribute has another type, or another number of values than chunks.
    """
    attribute = prim.GetAttribute(tokens.CHUNK_DIGESTS)
    found = attribute.Get() if attribute else None
    if found is None:
        return ()
    where = f"{prim.GetPath()}.{tokens.CHUNK_DIGESTS}"
    if not isinstance(found, Vt.StringArray):
        raise StageError(where, f"a value of type {type(found).__name__}", str(_Type.StringArray))
    if len(found) not in (0, chunks):
        raise StageError(where, f"{len(found)} values", f"{chunks}, one for each chunk")
    return tuple(found)


def _resolved(asset: Sdf.AssetPath) -> str:
    """Return the file of a chunk, or its identifier if it is in memory; "" if it is missing."""
    if Sdf.Layer.IsAnonymousLayerIdentifier(asset.path):
        return str(asset.path) if Sdf.Layer.Find(asset.path) else ""
    return str(asset.resolvedPath)


def _check_distinct(chunks: Sequence[str], where: str) -> None:
    """Raise an error if two chunks are the same layer, of which nodes would share rows."""
    seen: dict[str, int] = {}
    for number, path in enumerate(chunks):
        first = seen.setdefault(path, number) if path else number
        if first != number:
            found = f"chunk {number} in the same layer as chunk {first}"
            raise StageError(where, found, "a layer for each")


def _degree(prim: Usd.Prim) -> int:
    """Return the degree of the harmonics.

    Raises:
        StageError: If it is not 0 to 4.
    """
    attribute = prim.GetAttribute(tokens.SH_DEGREE)
    found = attribute.Get() if attribute else None
    degree = tokens.SCHEMA_FALLBACK_DEGREE if found is None else found
    if not isinstance(degree, int) or not 0 <= degree <= MAX_DEGREE:
        where = f"{prim.GetPath()}.{tokens.SH_DEGREE}"
        raise StageError(where, repr(degree), f"0 to {MAX_DEGREE}")
    return degree


def _pixel(prim: Usd.Prim) -> float:
    """Return the size of the pixel for which proxies are filtered.

    Raises:
        StageError: If it is not a finite number of at least 0.
    """
    attribute = prim.GetAttribute(tokens.LOD_PIXEL)
    found = attribute.Get() if attribute else None
    pixel = 0.0 if found is None else found
    if not isinstance(pixel, float) or not 0 <= pixel < math.inf:
        where = f"{prim.GetPath()}.{tokens.LOD_PIXEL}"
        raise StageError(where, repr(pixel), "a finite number, at least 0")
    return pixel


def _extent(table: NodeTable) -> F32:
    """Return the box of the root, with corners that an extent can have."""
    return np.clip(np.stack([table.low[0], table.high[0]]), -_MOST, _MOST).astype(np.float32)
