"""Values of a stage that its schemas do not restrict: up axis, transforms, bounds.

USD raises `Tf.ErrorException` for a transform op that it does not know, and returns any word as the
up axis, and any number as the unit. These functions are the only ones that ask USD for them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, Literal, cast

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, Vt

from usdsplat.core.errors import StageError

UpAxis = Literal["Y", "Z"]
UP_AXES = ("Y", "Z")
"""Values of `upAxis`."""
ASSUMED: UpAxis = "Y"
"""Up axis of a stage with another value, as USD has it for a stage without one."""
ASSUMED_UNIT = 0.01
"""Unit of a stage with an impossible one [m], as USD has it for a stage without one."""

_OPS = {UsdGeom.XformOp.GetOpTypeToken(each) for each in UsdGeom.XformOp.Type.allValues} - {""}
EXPECTED_OPS = "transform ops of UsdGeomXformable"
"""Words for what `xformOpOrder` may have, in findings and errors."""
_INVERSE = "!invert!"
_RESET = "!resetXformStack!"


def in_world(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Yield the prims of a stage as they are seen in the world, what is in equal instances once."""
    seen: set[Sdf.Path] = set()
    prims = iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
    for prim in prims:
        yield prim
        if prim.IsInstance():
            prototype = prim.GetPrototype().GetPath()
            if prototype in seen:
                prims.PruneChildren()
            seen.add(prototype)


def up_axis(stage: Usd.Stage) -> UpAxis:
    """Return the stage's up axis; `ASSUMED` if its value is no axis that USD allows."""
    found = str(UsdGeom.GetStageUpAxis(stage))
    return cast(UpAxis, found) if found in UP_AXES else ASSUMED


def stage_unit(stage: Usd.Stage) -> float:
    """Return the length of the stage's unit [m]; `ASSUMED_UNIT` if its value is no length."""
    found = float(UsdGeom.GetStageMetersPerUnit(stage))
    return found if 0 < found < math.inf else ASSUMED_UNIT


def metadata_problems(stage: Usd.Stage) -> Iterator[tuple[str, StageError]]:
    """Yield what is wrong with the stage's up axis and unit: the code of a finding, the error."""
    axis, unit = str(UsdGeom.GetStageUpAxis(stage)), UsdGeom.GetStageMetersPerUnit(stage)
    if axis not in UP_AXES:
        yield (
            "bad-up-axis",
            StageError("stage upAxis", repr(axis), f"Y or Z; {ASSUMED} is assumed"),
        )
    if unit != stage_unit(stage):
        expected = f"a positive number; {ASSUMED_UNIT:g} is assumed"
        yield "bad-meters-per-unit", StageError("stage metersPerUnit", f"{unit:g}", expected)


def local_to_world(prim: Usd.Prim, cache: UsdGeom.XformCache) -> Gf.Matrix4d:
    """Return the transform from a prim to the world.

    Raises:
        StageError: If the prim or an ancestor has a transform op that USD does not know.
    """
    try:
        return cache.GetLocalToWorldTransform(prim)
    except Tf.ErrorException:
        cache.Clear()  # it would leave out the op, without an error, when asked again
        raise _bad_op(prim) from None


def parent_to_world(prim: Usd.Prim, cache: UsdGeom.XformCache) -> Gf.Matrix4d:
    """Return the transform from a prim's parent to the world.

    Raises:
        StageError: As `local_to_world`.
    """
    try:
        return cache.GetParentToWorldTransform(prim)
    except Tf.ErrorException:
        cache.Clear()  # it would leave out the op, without an error, when asked again
        raise _bad_op(prim) from None


def local_to_ancestor(prim: Usd.Prim, ancestor: Usd.Prim, cache: UsdGeom.XformCache) -> Gf.Matrix4d:
    """Return the transform from a prim to one of its ancestors, or to the world if a prim between
    them resets the transform.

    Raises:
        StageError: As `local_to_world`.
    """
    try:
        matrix, _ = cache.ComputeRelativeTransform(prim, ancestor)
    except Tf.ErrorException:
        cache.Clear()  # it would leave out the op, without an error, when asked again
        raise _bad_op(prim) from None
    return matrix


def world_bound(prim: Usd.Prim, cache: UsdGeom.BBoxCache) -> Gf.BBox3d:
    """Return the bounding box of a prim and everything below it.

    Raises:
        StageError: If a transform op on the way is unknown to USD.
    """
    try:
        return cache.ComputeWorldBound(prim)
    except Tf.ErrorException:
        cache.Clear()  # it would leave out the op, without an error, when asked again
        raise _bad_op(prim, below=True) from None


def local_transform(prim: Usd.Prim, time: Usd.TimeCode) -> Gf.Matrix4d:
    """Return the transform from a prim to its parent.

    Raises:
        StageError: If the prim has a transform op that USD does not know.
    """
    try:
        return UsdGeom.Xformable(prim).GetLocalTransformation(time)
    except Tf.ErrorException:
        raise _bad_op(prim) from None


def ordered_ops(prim: Usd.Prim) -> list[UsdGeom.XformOp]:
    """Return the transform ops of a prim.

    Raises:
        StageError: If it has one that USD does not know.
    """
    try:
        return list(UsdGeom.Xformable(prim).GetOrderedXformOps())
    except Tf.ErrorException:
        raise _bad_op(prim) from None


def op_names(prim: Usd.Prim) -> list[str]:
    """Return the names in the transform order of a prim; none if it is not an array of tokens."""
    attribute = prim.GetAttribute(UsdGeom.Tokens.xformOpOrder)
    order = attribute.Get() if attribute else None
    return [str(op) for op in order] if isinstance(order, Vt.TokenArray) else []


def may_move(prim: Usd.Prim) -> bool:
    """Return whether the own transform of a prim may vary over time; False if USD cannot tell."""
    xformable = UsdGeom.Xformable(prim)
    try:
        return bool(xformable) and bool(xformable.TransformMightBeTimeVarying())
    except Tf.ErrorException:
        return False


def extents_hint(model: UsdGeom.ModelAPI, cache: UsdGeom.BBoxCache) -> Vt.Vec3fArray:
    """Return the bounds of a model for each purpose, see UsdGeomModelAPI.

    Raises:
        StageError: If a prim at or below the model has a transform op that USD does not know.
    """
    try:
        return model.ComputeExtentsHint(cache)
    except Tf.ErrorException:
        cache.Clear()
        raise _bad_op(model.GetPrim(), below=True) from None


def unknown_ops(prim: Usd.Prim) -> Iterator[str]:
    """Yield the transform ops of a prim that USD does not know, so that it has no transform."""
    for op in op_names(prim):
        if op != _RESET and not _is_known(op):
            yield op


def missing_ops(prim: Usd.Prim) -> Iterator[str]:
    """Yield the transform ops of a prim that have no attribute, which USD leaves out."""
    for op in op_names(prim):
        if op != _RESET and _is_known(op) and not prim.HasAttribute(op.removeprefix(_INVERSE)):
            yield op


def _is_known(op: str) -> bool:
    name = op.removeprefix(_INVERSE)
    return name.startswith("xformOp:") and name.split(":")[1] in _OPS


def are_finite(value: Any) -> bool:
    """Return whether all numbers of a value are finite: a number, a vector or a matrix."""
    if isinstance(value, int | float):
        return math.isfinite(value)
    return bool(np.isfinite(np.array(value, np.float64)).all())


def _bad_op(prim: Usd.Prim, *, below: bool = False) -> StageError:
    """Return the error for the nearest prim with an op that USD does not know."""
    for each in _lineage(prim, below):
        for op in unknown_ops(each):
            return StageError(f"{each.GetPath()}.xformOpOrder", repr(op), EXPECTED_OPS)
    return StageError(str(prim.GetPath()), "transform ops that USD cannot evaluate", EXPECTED_OPS)


def _lineage(prim: Usd.Prim, below: bool) -> Iterable[Usd.Prim]:
    each = prim
    while each and not each.IsPseudoRoot():
        yield each
        each = each.GetParent()
    if below:
        yield from Usd.PrimRange(prim, Usd.TraverseInstanceProxies())
