"""Write the prim of a splat tree."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pxr import Sdf, Usd, Vt

from usdsplat.core.node_table import NodeTable
from usdsplat.schema import DrawingHints, tokens
from usdsplat.schema.attributes import set_array, set_uniform
from usdsplat.schema.vt import to_vt

TREE = "ParticleFieldSplatTree"

_Type = Sdf.ValueTypeNames


def author_tree(
    stage: Usd.Stage,
    path: str | Sdf.Path,
    table: NodeTable,
    chunks: Sequence[str],
    *,
    degree: int,
    color_space: str,
    drawing: DrawingHints,
    pixel: float,
) -> Usd.Prim:
    """Write a tree on the stage's edit target.

    Args:
        stage: The stage.
        path: Absolute path of the prim.
        table: Valid nodes.
        chunks: Asset paths of the chunks.
        degree: Degree of the harmonics of all chunks.
        color_space: Colour space of all chunks.
        drawing: Rendering hints.
        pixel: Size of the pixel of the low-pass that is baked into inner nodes [local unit]; 0 for
            none.

    Returns:
        The prim.
    """
    prim = stage.DefinePrim(path, TREE)
    prim.AddAppliedSchema(tokens.FIELD_API)
    code = Usd.TimeCode.Default()
    for name, kind, vt_kind, value in (
        ("splat:nodeLow", _Type.Float3Array, Vt.Vec3fArray, table.low),
        ("splat:nodeHigh", _Type.Float3Array, Vt.Vec3fArray, table.high),
        ("splat:nodeErrors", _Type.FloatArray, Vt.FloatArray, table.errors),
        ("splat:nodeFirstChild", _Type.IntArray, Vt.IntArray, table.first_child),
        ("splat:nodeChildCount", _Type.IntArray, Vt.IntArray, table.child_count),
        ("splat:nodeChunk", _Type.IntArray, Vt.IntArray, table.chunk),
        ("splat:nodeFirstRow", _Type.Int64Array, Vt.Int64Array, table.first_row),
        ("splat:nodeProxies", _Type.Int64Array, Vt.Int64Array, table.proxies),
        ("splat:nodeResidents", _Type.Int64Array, Vt.Int64Array, table.residents),
        (tokens.EXTENT, _Type.Float3Array, Vt.Vec3fArray, np.stack([table.low[0], table.high[0]])),
    ):
        set_array(prim, name, kind, to_vt(np.ascontiguousarray(value), vt_kind), code)
    assets = Sdf.AssetPathArray([Sdf.AssetPath(each) for each in chunks])
    set_array(prim, "splat:chunks", _Type.AssetArray, assets, code)
    set_uniform(prim, "splat:lod:pixel", _Type.Float, pixel)
    set_uniform(prim, tokens.SH_DEGREE, _Type.Int, degree)
    Usd.ColorSpaceAPI.Apply(prim).CreateColorSpaceNameAttr(color_space)
    drawing.author(prim)
    root = stage.GetEditTarget().GetLayer().pseudoRoot
    known = dict(root.GetInfo("fallbackPrimTypes") or {})
    known[TREE] = Vt.TokenArray([tokens.BASE_TYPE])
    root.SetInfo("fallbackPrimTypes", known)
    return prim
