"""Author proxy points below a packed field, for renderers without its type."""

from __future__ import annotations

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.sh import dc_to_rgb
from usdsplat.schema import tokens
from usdsplat.schema.attributes import set_array, set_uniform
from usdsplat.schema.vt import to_vt

MAX_POINTS = 10_000

_Type = Sdf.ValueTypeNames


def author(prim: Usd.Prim, cloud: SplatCloud, *, code: Usd.TimeCode) -> None:
    """Write at most MAX_POINTS splats as a UsdGeomPoints child of purpose "proxy".

    The field gets purpose "render", unless it has or inherits another, and its `proxyPrim` names
    the child, so that a viewer shows one of the two. Fewer points get larger widths.

    Args:
        prim: The packed prim.
        cloud: Its splats.
        code: Default, or the time code of a sample.
    """
    step = max(1, -(-len(cloud) // MAX_POINTS))
    centres = cloud.positions[::step]
    widths = (2 * step**0.5 * cloud.scales[::step].mean(axis=1)).astype(np.float32)
    colors = np.clip(dc_to_rgb(cloud.sh[::step, 0]), 0, 1).astype(np.float32)
    stage = prim.GetStage()
    points = UsdGeom.Points.Define(stage, prim.GetPath().AppendChild(tokens.PROXY_CHILD))
    points.CreatePurposeAttr(UsdGeom.Tokens.proxy)
    points.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
    child = points.GetPrim()
    for name, kind, vt_kind, value in (
        ("points", _Type.Point3fArray, Vt.Vec3fArray, centres),
        ("widths", _Type.FloatArray, Vt.FloatArray, widths),
        ("primvars:displayColor", _Type.Color3fArray, Vt.Vec3fArray, colors),
        (tokens.EXTENT, _Type.Float3Array, Vt.Vec3fArray, _extent(centres, widths)),
    ):
        set_array(child, name, kind, to_vt(value, vt_kind), code)
    if UsdGeom.Imageable(prim).ComputePurpose() == UsdGeom.Tokens.default_:
        set_uniform(prim, tokens.PURPOSE, _Type.Token, UsdGeom.Tokens.render)
    prim.CreateRelationship(tokens.PROXY_PRIM, custom=False).SetTargets([child.GetPath()])


def remove(prim: Usd.Prim) -> None:
    """Remove what `author` wrote on the edit target."""
    stage, path = prim.GetStage(), prim.GetPath().AppendChild(tokens.PROXY_CHILD)
    child = stage.GetEditTarget().GetPrimSpecForScenePath(path)
    if child and child.typeName == "Points":
        stage.RemovePrim(path)
        prim.RemoveProperty(tokens.PROXY_PRIM)
        if prim.GetAttribute(tokens.PURPOSE).Get() == UsdGeom.Tokens.render:
            prim.RemoveProperty(tokens.PURPOSE)


def _extent(centres: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Return the bounding box of all points with their widths."""
    if not len(centres):
        return np.zeros((2, 3), np.float32)
    radii = widths[:, None] / 2
    return np.stack([(centres - radii).min(axis=0), (centres + radii).max(axis=0)])
