"""Write LOD roots of coarse fields, for renderers without our types.

The schemas of UsdLod are written by name, so they need not be in USD's registry.

Source: `pxr/usd/usdLod/schema.usda` of OpenUSD 26.11.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.schema import tokens
from usdsplat.schema.extent import compute_extent
from usdsplat.schema.field import author
from usdsplat.schema.hints import DrawingHints
from usdsplat.schema.lod_roots import DEFAULT_INDEX, HEURISTICS, IMAGING, ROOT_API, SCREEN_SIZE
from usdsplat.schema.vt import to_vt

_Type = Sdf.ValueTypeNames


def author_lod_root(
    stage: Usd.Stage,
    path: str | Sdf.Path,
    fields: Sequence[SplatCloud],
    *,
    thresholds: Sequence[float],
    default: int = 0,
    drawing: DrawingHints,
    color_space: str | None = None,
    tree: Usd.Prim | None = None,
) -> Usd.Prim:
    """Write coarse stock fields as items of an LOD root, for renderers without our types.

    The default item is visible, the others are not, because renderers without UsdLod draw every
    visible child. The heuristic is beside the root, as `NAME_heuristic`: children are items.

    Args:
        stage: The stage; its edit target is written.
        path: Absolute path of the root.
        fields: The items, the finest first.
        thresholds: For each item but the last, the fraction of the picture's area above which it is
            drawn, descending.
        default: Index of the item that is visible.
        drawing: Rendering hints of all fields.
        color_space: Colour space of all fields, see `author`.
        tree: A splat tree, which we draw instead of the items; it must not be below the root.

    Returns:
        The root.

    Raises:
        UsageError: If there is no field, thresholds do not fit, or the tree is below the root.
        StageError: If a prim cannot be written.
    """
    root_path = Sdf.Path(str(path))
    _check(root_path, fields, thresholds, default, tree)
    root = UsdGeom.Xform.Define(stage, root_path).GetPrim()
    root.AddAppliedSchema(ROOT_API)
    for number, cloud in enumerate(fields):
        item = root_path.AppendChild(f"lod{number}")
        prim = author(stage, item, cloud, drawing=drawing, color_space=color_space)
        own = UsdGeom.Imageable(prim).CreateVisibilityAttr()
        own.Set(UsdGeom.Tokens.inherited if number == default else UsdGeom.Tokens.invisible)
    root.CreateAttribute(DEFAULT_INDEX, _Type.Int, custom=False).Set(default)
    beside = root_path.ReplaceName(f"{root_path.name}_heuristic")
    heuristic = stage.DefinePrim(beside, SCREEN_SIZE)
    boxes = np.stack([compute_extent(cloud) for cloud in fields])
    box = np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    for name, kind, uniform, value in (
        ("lod:domain", _Type.Token, True, IMAGING),
        ("extent", _Type.Float3Array, False, to_vt(box, _Type.Float3Array.type.pythonClass)),
        ("projectionMethod", _Type.Token, True, "projectedSphere"),
        ("thresholds", _Type.FloatArray, True, list(map(float, thresholds))),
    ):
        variability = Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying
        attribute = heuristic.CreateAttribute(name, kind, custom=False, variability=variability)
        attribute.Set(value)
    root.CreateRelationship(HEURISTICS, custom=False).SetTargets([beside])
    if tree is not None:
        name_lod_root(tree, root_path)
    return root


def name_lod_root(tree: Usd.Prim, root: Sdf.Path) -> None:
    """Make a splat tree the one that we draw instead of the items of an LOD root."""
    tree.CreateRelationship(tokens.LOD_ROOT, custom=False).SetTargets([root])


def _check(
    root: Sdf.Path,
    fields: Sequence[SplatCloud],
    thresholds: Sequence[float],
    default: int,
    tree: Usd.Prim | None,
) -> None:
    """Raise an error for arguments of `author_lod_root` that do not fit, before it writes."""
    if not fields:
        raise UsageError("fields", "none", "at least one")
    if len(thresholds) != len(fields) - 1 or any(
        not 0 < low < high for high, low in zip((math.inf, *thresholds), thresholds, strict=False)
    ):
        expected = f"{len(fields) - 1} descending fractions above 0"
        raise UsageError("thresholds", str(list(thresholds)), expected)
    if not 0 <= default < len(fields):
        raise UsageError("default", str(default), f"0 to {len(fields) - 1}")
    if tree is not None and tree.GetPath().HasPrefix(root):
        raise UsageError("tree", f"{tree.GetPath()}, below the root", "a prim beside it")
