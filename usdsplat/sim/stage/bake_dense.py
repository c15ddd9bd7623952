"""Author samples as arrays of the stock type, all splats at each time."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, UsdGeom, Vt

from usdsplat.core.encoding import HALF_MAX
from usdsplat.core.errors import UsageError
from usdsplat.schema import stock, tokens
from usdsplat.schema.vt import to_vt
from usdsplat.sim.stage.epochs import Sample
from usdsplat.sim.stage.plan import Plan
from usdsplat.sim.stage.sample_layer import SampleLayer
from usdsplat.sim.stage.trees import author_replacement

Array = npt.NDArray[Any]

_Type = Sdf.ValueTypeNames
KINDS = {
    tokens.POSITIONS: (_Type.Point3fArray, Vt.Vec3fArray),
    tokens.POSITIONS_HALF: (_Type.Point3hArray, Vt.Vec3hArray),
    tokens.ORIENTATIONS: (_Type.QuatfArray, Vt.QuatfArray),
    tokens.ORIENTATIONS_HALF: (_Type.QuathArray, Vt.QuathArray),
    tokens.SCALES: (_Type.Float3Array, Vt.Vec3fArray),
    tokens.SCALES_HALF: (_Type.Half3Array, Vt.Vec3hArray),
    tokens.OPACITIES: (_Type.FloatArray, Vt.FloatArray),
    tokens.OPACITIES_HALF: (_Type.HalfArray, Vt.HalfArray),
    tokens.SH_COEFFICIENTS: (_Type.Float3Array, Vt.Vec3fArray),
    tokens.SH_COEFFICIENTS_HALF: (_Type.Half3Array, Vt.Vec3hArray),
}
"""Attribute -> its USD type, and the class of its values."""
U, V = "primvars:splatSim:u", "primvars:splatSim:v"


class DenseAuthor:
    """Author of one field."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    def write(self, part: SampleLayer, sample: Sample) -> None:
        """Add a sample to a part."""
        plan = self._plan
        part.prim(plan.path, plan.retype)
        for array, name in plan.names.items():
            value = getattr(sample, array)
            if value is not None:
                self._array(part, name, value, sample.time)
        if plan.degree >= 0:
            degree = part.attribute(plan.path, tokens.SH_DEGREE, _Type.Int, uniform=True)
            degree.default = plan.degree
        common(part, plan, sample)

    def _array(self, part: SampleLayer, name: str, value: Array, time: float) -> None:
        kind, vt = KINDS[name]
        value = stored(name, value)
        if name in (tokens.SH_COEFFICIENTS, tokens.SH_COEFFICIENTS_HALF):
            spec = part.sample(self._plan.path, name, kind, to_vt(value.reshape(-1, 3), vt), time)
            if not spec.HasInfo("interpolation"):
                spec.SetInfo("elementSize", value.shape[1])
                spec.SetInfo("interpolation", UsdGeom.Tokens.vertex)
        else:
            part.sample(self._plan.path, name, kind, to_vt(value, vt), time)


def stored(name: str, value: Array) -> Array:
    """Return scales that do not underflow to zero in half, unless they are zero; other arrays as
    they are.

    Raises:
        UsageError: If a number is out of half's range.
    """
    if name not in tokens.HALF_OF.values():
        return value
    peak = max(np.max(value, initial=0), -np.min(value, initial=0))
    if peak > HALF_MAX:
        raise UsageError(f"bake, {name}", f"the magnitude {peak:g}", f"at most {HALF_MAX:g}")
    if name != tokens.SCALES_HALF:
        return value
    tiny = np.float32(stock.HALF_TINY)
    return np.where((value > 0) & (value < tiny), tiny, value)


def stop(part: SampleLayer, path: str, time: float) -> None:
    """End extrapolation by velocities at a time: after the last frame, or before the first. Frames
    of the shot that are not baked then show the nearest baked frame."""
    none = Vt.Vec3fArray()
    part.sample(path, tokens.VELOCITIES, _Type.Vector3fArray, none, time)


def common(part: SampleLayer, plan: Plan, sample: Sample) -> None:
    """Author what all modes have: extent, velocities, ids, pattern, and what replaces a tree."""
    path, time = plan.path, sample.time
    if plan.rasterize_mode:
        author_replacement(part, path, plan.rasterize_mode, plan.lod_root)
    if plan.moves:
        box = to_vt(sample.box, Vt.Vec3fArray)
        part.sample(path, tokens.EXTENT, _Type.Float3Array, box, time)
    if sample.velocities is not None:
        speeds = to_vt(sample.velocities, Vt.Vec3fArray)
        part.sample(path, tokens.VELOCITIES, _Type.Vector3fArray, speeds, time)
    elif plan.block_velocities:
        part.attribute(path, tokens.VELOCITIES, _Type.Vector3fArray).default = Sdf.ValueBlock()
    ids = np.arange(len(plan.rest)) if plan.ids and sample.is_new else sample.ids
    if ids is not None:
        part.sample(path, tokens.IDS, _Type.Int64Array, to_vt(ids, Vt.Int64Array), time)
    if sample.uv is not None:
        for name, column in ((U, 0), (V, 1)):
            value = to_vt(np.ascontiguousarray(sample.uv[:, column]), Vt.FloatArray)
            spec = part.sample(path, name, _Type.FloatArray, value, time)
            spec.SetInfo("interpolation", UsdGeom.Tokens.vertex)
