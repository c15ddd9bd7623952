"""Author proxy points beside a packed field, for renderers without its type.

The proxy of `/Scan/splats` is `/Scan/splats_proxy`. It is not below the field, because USD does not
allow a Gprim below another, and because applications without our type do not look below a prim of
purpose "render" for its bounds. It has the field's transform, so it must be placed again when the
field's own transform changes. A field at the root of a stage gets no proxy: a reference to the
field would not include it.

Files of 0.6 have the proxy below the field, as `proxy`.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.sh import dc_to_rgb
from usdsplat.schema import tokens
from usdsplat.schema.attributes import set_array, set_uniform
from usdsplat.schema.stage_values import op_names
from usdsplat.schema.vt import to_vt

MAX_POINTS = 10_000

_POINTS = "Points"
_PROXY = UsdGeom.Tokens.proxy
_Type = Sdf.ValueTypeNames


def path_of(prim: Usd.Prim) -> Sdf.Path | None:
    """Return the path of a field's proxy, which may not exist yet; None for a field at the root.

    This is the sibling that `proxyPrim` names, or else a free name.
    """
    path = prim.GetPath()
    if path.IsRootPrimPath():
        return None
    stage = prim.GetStage()
    for target in prim.GetRelationship(tokens.PROXY_PRIM).GetTargets():
        if target.GetParentPath() == path.GetParentPath() and _is_proxy(
            stage.GetPrimAtPath(target)
        ):
            return target
    free = beside = path.ReplaceName(f"{path.name}_proxy")
    number = 1
    while (found := stage.GetPrimAtPath(free)) and found.IsDefined():
        free, number = beside.ReplaceName(f"{beside.name}_{number}"), number + 1
    return free


def author(prim: Usd.Prim, path: Sdf.Path, cloud: SplatCloud, *, code: Usd.TimeCode) -> Usd.Prim:
    """Write at most MAX_POINTS splats as UsdGeomPoints of purpose "proxy".

    The field gets purpose "render", unless it has or inherits another, and its `proxyPrim` names
    the points, so that a viewer shows one of the two. Fewer points get larger widths.

    Args:
        prim: The packed prim.
        path: Path of the points, from `path_of`.
        cloud: Its splats.
        code: Default, or the time code of a sample.

    Returns:
        The prim of the points.
    """
    step = max(1, -(-len(cloud) // MAX_POINTS))
    centres = cloud.positions[::step]
    widths = (2 * step**0.5 * cloud.scales[::step].mean(axis=1)).astype(np.float32)
    colors = np.clip(dc_to_rgb(cloud.sh[::step, 0]), 0, 1).astype(np.float32)
    found = prim.GetStage().OverridePrim(path)
    found.SetSpecifier(Sdf.SpecifierDef)
    found.SetTypeName(_POINTS)
    points = UsdGeom.Points(found)
    points.CreatePurposeAttr(UsdGeom.Tokens.proxy)
    points.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
    for name, kind, vt_kind, value in (
        ("points", _Type.Point3fArray, Vt.Vec3fArray, centres),
        ("widths", _Type.FloatArray, Vt.FloatArray, widths),
        ("primvars:displayColor", _Type.Color3fArray, Vt.Vec3fArray, colors),
        (tokens.EXTENT, _Type.Float3Array, Vt.Vec3fArray, _extent(centres, widths)),
    ):
        set_array(found, name, kind, to_vt(value, vt_kind), code)
    if UsdGeom.Imageable(prim).ComputePurpose() == UsdGeom.Tokens.default_:
        set_uniform(prim, tokens.PURPOSE, _Type.Token, UsdGeom.Tokens.render)
    prim.CreateRelationship(tokens.PROXY_PRIM, custom=False).SetTargets([path])
    return found


def author_colors(points: Usd.Prim, cloud: SplatCloud, *, code: Usd.TimeCode) -> None:
    """Write the colours of a proxy again."""
    step = max(1, -(-len(cloud) // MAX_POINTS))
    colors = np.clip(dc_to_rgb(cloud.sh[::step, 0]), 0, 1).astype(np.float32)
    value = to_vt(colors, Vt.Vec3fArray)
    set_array(points, "primvars:displayColor", _Type.Color3fArray, value, code)


def place(field: Usd.Prim, points: Usd.Prim | None = None) -> None:
    """Give the proxy of a field the field's own transform and visibility, with all time samples.

    Args:
        field: The field. Without a proxy beside it, nothing is done.
        points: Its proxy, which may be on another stage; None for the one that `proxyPrim` names.
    """
    if points is None:
        path = path_of(field) if field.HasRelationship(tokens.PROXY_PRIM) else None
        points = field.GetStage().GetPrimAtPath(path) if path else None
    if not points:
        return
    xformable = UsdGeom.Xformable(field)
    names = (name.removeprefix("!invert!") for name in op_names(field))
    copied = {name: field.GetAttribute(name) for name in names if name and field.HasAttribute(name)}
    for attribute in (xformable.GetXformOpOrderAttr(), xformable.GetVisibilityAttr()):
        if attribute.HasAuthoredValue():
            copied[attribute.GetName()] = attribute
    for name in points.GetAuthoredPropertyNames():
        is_placing = name.startswith("xformOp:") or name in _PLACING
        if is_placing and name not in copied:
            points.RemoveProperty(name)
    for name, attribute in copied.items():
        _copy(attribute, points, name)


def remove(prim: Usd.Prim) -> None:
    """Remove what `author` wrote on the edit target, also that of 0.6."""
    stage = prim.GetStage()
    for path in {path_of(prim), prim.GetPath().AppendChild(tokens.PROXY_CHILD)} - {None}:
        spec = stage.GetEditTarget().GetPrimSpecForScenePath(path)
        if spec and spec.typeName == _POINTS and _is_proxy(stage.GetPrimAtPath(path)):
            stage.RemovePrim(path)
            prim.RemoveProperty(tokens.PROXY_PRIM)
            if prim.GetAttribute(tokens.PURPOSE).Get() == UsdGeom.Tokens.render:
                prim.RemoveProperty(tokens.PURPOSE)


def settle(prim: Usd.Prim) -> None:
    """Bring the proxy of a packed field on the edit target to today's layout.

    One that 0.6 wrote below the field moves beside it. The proxy of a field that is only an `over`,
    such as a prototype of point instances, is removed: beside the field, it would be drawn.
    """
    if prim.GetSpecifier() != Sdf.SpecifierDef or prim.GetPath().IsRootPrimPath():
        remove(prim)
        return
    child, path = child_of(prim), path_of(prim)
    if child is None or path is None:
        return
    stage, target = prim.GetStage(), prim.GetStage().GetEditTarget()
    layer = target.GetLayer()
    source, copy = target.MapToSpecPath(child.GetPath()), target.MapToSpecPath(path)
    if layer.GetPrimAtPath(source) and Sdf.CopySpec(layer, source, layer, copy):
        stage.RemovePrim(child.GetPath())
        prim.GetRelationship(tokens.PROXY_PRIM).SetTargets([path])
        place(prim)


def child_of(prim: Usd.Prim) -> Usd.Prim | None:
    """Return the proxy that 0.6 wrote below a field, or None."""
    child = prim.GetChild(tokens.PROXY_CHILD)
    return child if _is_proxy(child) else None


def existing(prim: Usd.Prim) -> list[Usd.Prim]:
    """Return the proxies that a packed field has: that beside it, and that of 0.6 below it."""
    path = path_of(prim)
    beside = prim.GetStage().GetPrimAtPath(path) if path else None
    return [each for each in (beside, child_of(prim)) if each and _is_proxy(each)]


def points_of(prims: Iterable[Usd.Prim]) -> list[Usd.Prim]:
    """Return the points among prims, without proxies."""
    found = [prim for prim in prims if prim.IsA(UsdGeom.Points)]
    return [each for each in found if UsdGeom.Imageable(each).ComputePurpose() != _PROXY]


def _is_proxy(prim: Usd.Prim) -> bool:
    """Return whether a prim is points of purpose proxy."""
    if not prim or prim.GetTypeName() != _POINTS:
        return False
    return bool(UsdGeom.Imageable(prim).GetPurposeAttr().Get() == UsdGeom.Tokens.proxy)


_PLACING = ("xformOpOrder", "visibility")


def _copy(source: Usd.Attribute, prim: Usd.Prim, name: str) -> None:
    """Copy default value and time samples of an attribute, replacing those on the edit target."""
    copy = prim.CreateAttribute(
        name, source.GetTypeName(), custom=False, variability=source.GetVariability()
    )
    copy.Clear()
    for code in (Usd.TimeCode.Default(), *map(Usd.TimeCode, source.GetTimeSamples())):
        value = source.Get(code)
        if value is not None:
            copy.Set(value, code)


def _extent(centres: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Return the bounding box of all points with their widths."""
    if not len(centres):
        return np.zeros((2, 3), np.float32)
    radii = widths[:, None] / 2
    return np.stack([(centres - radii).min(axis=0), (centres + radii).max(axis=0)])
