"""Read and write the stock type, ParticleField3DGaussianSplat.

The rules for reading are usdVol's. The number of centres is the number of splats. Another array is
truncated if it is too long and ignored if it is too short, which leaves no rotation, unit scale,
full opacity or grey. Float arrays take precedence over half ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdGeom, Vt

from usdsplat.core import quaternion
from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.core.encoding import HALF_MAX
from usdsplat.core.errors import UsageError
from usdsplat.core.sh import MAX_DEGREE, coefficient_count
from usdsplat.schema import attributes, tokens
from usdsplat.schema.attributes import set_array, set_uniform
from usdsplat.schema.vt import as_float32, to_vt

HALF_SLACK = 2e-3
"""Upper bound of how much half precision enlarges a splat, relative to its largest scale."""
HALF_BOUNDS = {
    "rotations": "0.06 degrees",
    "scales": "0.05 % (3e-8 units below 6e-5)",
    "opacities": "0.00025",
    "sh": "0.05 %",
}
"""Field of the cloud -> error that half precision adds."""
HALF_TINY = 2.0**-24

_UNIT_TOLERANCE = 1e-5  # of the squared length; above it, quaternions are normalised

_Type = Sdf.ValueTypeNames
_FLOAT = {
    tokens.ORIENTATIONS: (_Type.QuatfArray, Vt.QuatfArray),
    tokens.SCALES: (_Type.Float3Array, Vt.Vec3fArray),
    tokens.OPACITIES: (_Type.FloatArray, Vt.FloatArray),
    tokens.SH_COEFFICIENTS: (_Type.Float3Array, Vt.Vec3fArray),
}
_HALF = {
    tokens.ORIENTATIONS: (_Type.QuathArray, Vt.QuathArray),
    tokens.SCALES: (_Type.Half3Array, Vt.Vec3hArray),
    tokens.OPACITIES: (_Type.HalfArray, Vt.HalfArray),
    tokens.SH_COEFFICIENTS: (_Type.Half3Array, Vt.Vec3hArray),
}


def author(prim: Usd.Prim, cloud: SplatCloud, *, half: bool, code: Usd.TimeCode) -> None:
    """Write the arrays of a stock prim and remove those of the other precision.

    Args:
        prim: Of the stock type.
        cloud: The splats.
        half: Write everything but the centres as half: 124 bytes a splat instead of 236 at degree
            3. Half centres cost up to 27 dB, so they stay float.
        code: Default, or the time code of a sample.
    """
    attributes.forget(prim, (*tokens.PACKED_ARRAYS, tokens.PACKING))
    stale = [name if half else tokens.HALF_OF[name] for name in _FLOAT]
    attributes.silence(prim, (tokens.POSITIONS_HALF, *stale))
    positions = to_vt(cloud.positions, Vt.Vec3fArray)
    set_array(prim, tokens.POSITIONS, _Type.Point3fArray, positions, code)
    values: dict[str, F32] = {
        tokens.ORIENTATIONS: cloud.rotations,
        tokens.SCALES: cloud.scales,
        tokens.OPACITIES: cloud.opacities,
        tokens.SH_COEFFICIENTS: cloud.sh.reshape(-1, 3),
    }
    for name, value in values.items():
        kind, vt_kind = (_HALF if half else _FLOAT)[name]
        target = tokens.HALF_OF[name] if half else name
        # The temporary array for half precision is freed before the next one is made.
        exact = _positive_half(value) if half and name == tokens.SCALES else value
        written = set_array(prim, target, kind, to_vt(exact, vt_kind), code)
        if name == tokens.SH_COEFFICIENTS:
            _set_primvar_metadata(written, cloud.sh.shape[1])
    set_uniform(prim, tokens.SH_DEGREE, _Type.Int, cloud.sh_degree)


def author_harmonics(prim: Usd.Prim, cloud: SplatCloud, *, half: bool, code: Usd.TimeCode) -> None:
    """Write the harmonics of a stock prim alone, with their degree: the prim may have none.

    Raises:
        UsageError: If `half`, and a number exceeds the range of half precision.
    """
    if half:
        check_half(cloud)
    name = tokens.SH_COEFFICIENTS
    kind, vt_kind = (_HALF if half else _FLOAT)[name]
    target = tokens.HALF_OF[name] if half else name
    written = set_array(prim, target, kind, to_vt(cloud.sh.reshape(-1, 3), vt_kind), code)
    if len(cloud):  # an empty sample says nothing about the degree of others
        _set_primvar_metadata(written, cloud.sh.shape[1])
        set_uniform(prim, tokens.SH_DEGREE, _Type.Int, cloud.sh_degree)


def check_half(cloud: SplatCloud) -> None:
    """Raise an error for numbers that half precision would make infinite.

    Raises:
        UsageError: If a number exceeds the range of half precision.
    """
    for name in ("scales", "sh"):
        values = getattr(cloud, name)
        peak = max(np.max(values, initial=0), -np.min(values, initial=0))
        if peak > HALF_MAX:
            raise UsageError(
                f"half form, {name}", f"the magnitude {peak:g}", f"at most {HALF_MAX:g}, or float"
            )


def fetch(prim: Usd.Prim, code: Usd.TimeCode, time: attributes.Time) -> SplatCloud:
    """Read a stock prim; float arrays are views of USD's own memory.

    Args:
        prim: Of the stock type.
        code: Result of `attributes.time_code` for `time`.
        time: Requested time, to which velocities extrapolate the centres.

    Returns:
        The cloud, with quaternions normalised and degrees above 4 truncated to 4. Other values are
        returned unchecked: `validate` reports invalid ones.
    """
    name = source_name(prim, tokens.POSITIONS)
    positions, velocities = attributes.centres(prim, name, code, time)
    n = len(positions)
    rotations = attributes.rows(_array(prim, tokens.ORIENTATIONS, code), n)
    scales = attributes.rows(_array(prim, tokens.SCALES, code), n)
    opacities = attributes.rows(_array(prim, tokens.OPACITIES, code), n)
    return SplatCloud(
        positions=positions,
        rotations=_identities(n) if rotations is None else unit(as_float32(rotations)),
        scales=np.ones((n, 3), np.float32) if scales is None else as_float32(scales),
        opacities=np.ones(n, np.float32) if opacities is None else as_float32(opacities),
        sh=_harmonics(prim, code, n),
        ids=attributes.ids(prim, code, n),
        velocities=velocities,
    )


def source_name(prim: Usd.Prim, name: str) -> str:
    """Return the attribute that applies: float, unless only half has values at the beginning.

    Source: the rule of usdVol's `UsesFloat...()`, which has no Python binding: float if it has
    values at its earliest time. In addition, float applies if half has no value at all: a field
    that grows from nothing has an empty first sample.
    """
    twin = prim.GetAttribute(tokens.HALF_OF[name])
    has_twin = bool(twin) and twin.HasAuthoredValue()
    return tokens.HALF_OF[name] if has_twin and begins_empty(prim, name) else name


def begins_empty(prim: Usd.Prim, name: str) -> bool:
    """Return whether an array has no values at its earliest time."""
    return attributes.length(prim, name, Usd.TimeCode.EarliestTime()) == 0


def _array(prim: Usd.Prim, name: str, code: Usd.TimeCode) -> npt.NDArray[Any] | None:
    """Return the value of a stock array in the precision that applies."""
    return attributes.array(prim, source_name(prim, name), code)


def _harmonics(prim: Usd.Prim, code: Usd.TimeCode, n: int) -> F32:
    """Return coefficients, shape (n, k, 3); grey of degree 0 if the prim has too few."""
    degree = attributes.degree(prim, code)
    count = coefficient_count(max(degree, 0))
    flat = attributes.rows(_array(prim, tokens.SH_COEFFICIENTS, code), n * count)
    if flat is None or degree < 0:
        return np.zeros((n, 1, 3), np.float32)
    kept = coefficient_count(min(degree, MAX_DEGREE))
    return as_float32(flat.reshape(n, count, 3)[:, :kept])


def unit(rotations: F32) -> F32:
    """Return quaternions of length 1; the same array if they are already."""
    squared = np.einsum("ni,ni->n", rotations, rotations)
    if np.all(np.abs(squared - 1) <= _UNIT_TOLERANCE):
        return rotations
    return as_float32(quaternion.normalize(rotations))


def _identities(n: int) -> F32:
    """Return n identity rotations."""
    rotations = np.zeros((n, 4), np.float32)
    rotations[:, 0] = 1
    return rotations


def _positive_half(scales: F32) -> F32:
    """Return scales raised to the smallest positive half, except for zeros."""
    return np.where((scales > 0) & (scales < HALF_TINY), np.float32(HALF_TINY), scales)


def _set_primvar_metadata(attribute: Usd.Attribute, element_size: int) -> None:
    """Set metadata that other importers and validators expect: coefficients per splat."""
    primvar = UsdGeom.Primvar(attribute)
    primvar.SetElementSize(element_size)
    primvar.SetInterpolation(UsdGeom.Tokens.vertex)
