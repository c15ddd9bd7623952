"""The layer of refined captures: static opinions between a capture and the results.

Its values are defaults, which win over the capture's own defaults and samples. It is self-contained
for a field: it holds all arrays of the field, ids, the parents of children, the extent, and all
primvars that have a value for each splat. While a stage is simulated it is a sublayer of a session
layer; in a bake, a file below the results.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from usdsplat import schema
from usdsplat.core.cloud import I64, SplatCloud
from usdsplat.schema import stock, tokens
from usdsplat.schema.tree_cuts import TreeReading
from usdsplat.schema.vt import to_vt
from usdsplat.sim.stage.bake_dense import KINDS, stored
from usdsplat.sim.stage.plan import ARRAYS, attribute_of
from usdsplat.sim.stage.sample_layer import SampleLayer
from usdsplat.sim.stage.trees import author_replacement, replaced_root

_KEY = ("usdsplat", "refinement")
"""Key of the record in a layer's data, "usdsplat:refinement" in USD's spelling."""
_Type = Sdf.ValueTypeNames


def new_layer(stage: Usd.Stage) -> Sdf.Layer:
    """Return an empty layer for the captures of a stage, in memory."""
    layer = Sdf.Layer.CreateAnonymous("refined.usdc")
    layer.timeCodesPerSecond = stage.GetTimeCodesPerSecond()
    return layer


def author(
    layer: Sdf.Layer,
    field: Usd.Prim,
    rest: SplatCloud,
    cloud: SplatCloud,
    rows: I64,
    cut: TreeReading | None,
) -> None:
    """Write a refined field.

    Args:
        layer: From `new_layer`.
        field: The field, or the splat tree, on the stage without the layer.
        rest: Its splats as captured.
        cloud: Its splats after refinement, with ids.
        rows: Row of the captured splat that each is or replaces, shape (m,).
        cut: The cut of a tree.

    Raises:
        UsageError: If a number is out of the range of half precision, which the field has.
    """
    part, path = SampleLayer(layer), str(field.GetPath())
    is_stock = schema.form_of(field) != "packed" and cut is None
    part.prim(path, "" if is_stock else tokens.STOCK_TYPE)
    degree = part.attribute(path, tokens.SH_DEGREE, _Type.Int, uniform=True)
    degree.default = cloud.sh_degree
    if cut is not None:
        author_replacement(part, path, cut.rasterize_mode, replaced_root(field))
    is_half = False
    for array in ARRAYS:
        name = attribute_of(field, array, "dense") if is_stock else ARRAYS[array]
        kind, vt = KINDS[name]
        value = stored(name, getattr(cloud, array))
        is_half |= name in tokens.HALF_OF.values()
        spec = part.attribute(path, name, kind)
        spec.default = to_vt(value.reshape(-1, 3) if value.ndim == 3 else value, vt)
        if value.ndim == 3:
            spec.SetInfo("elementSize", value.shape[1])
            spec.SetInfo("interpolation", UsdGeom.Tokens.vertex)
    box = schema.compute_extent(cloud, slack=stock.HALF_SLACK if is_half else 0.0)
    part.attribute(path, tokens.EXTENT, _Type.Float3Array).default = to_vt(box, Vt.Vec3fArray)
    assert cloud.ids is not None  # refined clouds have ids
    ids = {tokens.IDS: cloud.ids, tokens.PARENTS: _parents(rest, cloud, rows)}
    for name, numbers in ids.items():
        part.attribute(path, name, _Type.Int64Array).default = to_vt(numbers, Vt.Int64Array)
    speeds = part.attribute(path, tokens.VELOCITIES, _Type.Vector3fArray)
    speeds.default = (
        Sdf.ValueBlock() if cloud.velocities is None else to_vt(cloud.velocities, Vt.Vec3fArray)
    )
    for attribute, size in _per_splat(field, len(rest)):
        _author_rows(part, path, attribute, rows, size, len(rest))


def parents(field: Usd.Prim, count: int) -> I64 | None:
    """Return the ids of the parents of a refined field's splats, shape (count,); None if it is not
    refined."""
    attribute = field.GetAttribute(tokens.PARENTS)
    found = attribute.Get() if attribute else None
    if found is None or len(found) != count:
        return None
    return np.array(found, np.int64)


def find(stage: Usd.Stage) -> Sdf.Layer | None:
    """Return the layer of refined captures that a stage has in memory, or None."""
    session = stage.GetSessionLayer()
    for path in session.subLayerPaths if session else ():
        layer = Sdf.Layer.Find(path)
        if layer and layer.anonymous and records(layer):
            return layer
    return None


def record(layer: Sdf.Layer, path: str, facts: Mapping[str, float]) -> None:
    """Store numbers about the refinement of a field."""
    known = dict(records(layer))
    known[path] = dict(facts)
    layer.customLayerData = {**layer.customLayerData, _KEY[0]: {_KEY[1]: known}}


def records(layer: Sdf.Layer) -> Mapping[str, Mapping[str, float]]:
    """Return the numbers that `record` stored, by the path of the field."""
    entry: Any = layer.customLayerData
    for key in _KEY:
        entry = entry.get(key) if isinstance(entry, Mapping) else None
    return entry if isinstance(entry, Mapping) else {}


def _parents(rest: SplatCloud, cloud: SplatCloud, rows: I64) -> I64:
    """Return the ids of the captured splats that children replace, -1 for other splats."""
    captured = np.arange(len(rest)) if rest.ids is None else rest.ids
    return np.where(cloud.ids == captured[rows], -1, captured[rows]).astype(np.int64)


def _per_splat(field: Usd.Prim, count: int) -> Iterator[tuple[Usd.Attribute, int]]:
    """Yield the primvars' attributes with a value for each of `count` splats, and the number of
    elements of a value.

    Primvars of that many values count whatever their interpolation is: `fields.per_splat` reads
    them too.
    """
    for primvar in UsdGeom.PrimvarsAPI(field).GetPrimvarsWithAuthoredValues():
        is_indexed = primvar.IsIndexed()
        attribute = primvar.GetIndicesAttr() if is_indexed else primvar.GetAttr()
        size = 1 if is_indexed else max(1, primvar.GetElementSize())
        varies = primvar.GetInterpolation() in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying)
        lengths = {len(value) for _, value in _values(attribute) if hasattr(value, "__len__")}
        if count * size in lengths and (count > 1 or varies):
            yield attribute, size


def _values(attribute: Usd.Attribute) -> Iterator[tuple[float | None, Any]]:
    """Yield all times of an attribute with their values; None is the default."""
    times = attribute.GetTimeSamples()
    if not times:
        yield None, attribute.Get()
    for time in times:
        yield time, attribute.Get(time)


def _author_rows(
    part: SampleLayer, path: str, attribute: Usd.Attribute, rows: I64, size: int, count: int
) -> None:
    """Write some rows of an attribute, at all times at which it has one for each splat."""
    wide = (rows[:, None] * size + np.arange(size)).reshape(-1)
    for time, value in _values(attribute):
        if len(value) != count * size:
            continue
        numbers = np.asarray(value)
        if numbers.dtype.kind in "biuf":
            taken = type(value).FromNumpy(np.ascontiguousarray(numbers[wide]))
        else:
            taken = type(value)([value[row] for row in wide.tolist()])
        kind = attribute.GetTypeName()
        if time is None:
            part.attribute(path, attribute.GetName(), kind).default = taken
        else:
            part.sample(path, attribute.GetName(), kind, taken, time)
