"""Read point instancers."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom, Vt

from usdsplat.core.errors import StageError
from usdsplat.delegate.instancing import NO_INSTANCES, InstancerSpec


def read_instancer(prim: Usd.Prim, time: Usd.TimeCode) -> InstancerSpec:
    """Read the instances of `prim` at `time`, extrapolated by velocities as USD specifies.

    Raises:
        StageError: If its arrays are inconsistent.
    """
    instancer = UsdGeom.PointInstancer(prim)
    prototypes = instancer.GetProtoIndicesAttr().Get(time)
    positions = instancer.GetPositionsAttr().Get(time)
    if not prototypes and not positions:
        return NO_INSTANCES
    for attribute, value, kind in (
        (instancer.GetProtoIndicesAttr(), prototypes, Vt.IntArray),
        (instancer.GetPositionsAttr(), positions, Vt.Vec3fArray),
    ):
        if value is not None and not isinstance(value, kind):
            found = f"a value of type {type(value).__name__}"
            raise StageError(str(attribute.GetPath()), found, kind.__name__)
    count = len(prototypes or ())
    _check(prim, "positions", len(positions or ()), count)
    mask = instancer.ComputeMaskAtTime(time)
    if mask:
        _check(prim, "ids", len(mask), count)
    matrices = instancer.ComputeInstanceTransformsAtTime(
        time, time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
    )
    _check(prim, "instances with a complete transform", len(matrices), count)
    return InstancerSpec(
        transforms=np.array(matrices, np.float64).reshape(-1, 4, 4).transpose(0, 2, 1),
        prototypes=np.array(prototypes, np.int64),
        shown=np.array(mask, np.bool_) if mask else np.ones(count, np.bool_),
    )


def _check(prim: Usd.Prim, what: str, found: int, expected: int) -> None:
    if found != expected:
        where = str(prim.GetPath())
        raise StageError(where, f"{found} {what}", f"{expected}, one for each of its protoIndices")
