"""Read and write the array attributes of one splat prim at one time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd

from usdsplat.core.cloud import F32, I64
from usdsplat.schema import tokens
from usdsplat.schema.vt import as_float32, from_vt

Array = npt.NDArray[Any]
Time: TypeAlias = float | Usd.TimeCode | None
"""A time code; None is the default value or, if the prim has only samples, the first of them."""


_TOGETHER = 1e-6
"""Tolerance for equal sample times [time code]: layer offsets introduce rounding."""


@dataclass(frozen=True, slots=True)
class Bracket:
    """The samples of an attribute around a time."""

    lower: Usd.TimeCode
    upper: Usd.TimeCode
    fraction: float
    """Position of the time between them [0..1); 0 on a sample, and where values are held."""


def time_code(prim: Usd.Prim, time: Time) -> Usd.TimeCode:
    """Return the time at which to read the arrays of a prim.

    Values of different splats must not be interpolated. Between two samples with different ids, the
    time of the earlier sample is returned.
    """
    if time is None:
        return _default_or_earliest(prim)
    code = Usd.TimeCode(time)
    if not code.IsNumeric():
        return code
    ids = prim.GetAttribute(tokens.IDS)
    around = bracket(ids, code) if ids and ids.ValueMightBeTimeVarying() else None
    if around and around.fraction and not _same(ids.Get(around.lower), ids.Get(around.upper)):
        return around.lower
    return code


def bracket(attribute: Usd.Attribute, code: Usd.TimeCode) -> Bracket:
    """Return the samples around `code`, or `code` twice if there are none to interpolate."""
    stage = attribute.GetStage()
    found = attribute.GetBracketingTimeSamples(code.GetValue()) if code.IsNumeric() else ()
    if not found:
        return Bracket(code, code, 0.0)
    lower, upper = found
    is_linear = stage.GetInterpolationType() == Usd.InterpolationTypeLinear
    inside = is_linear and lower < code.GetValue() < upper
    fraction = (code.GetValue() - lower) / (upper - lower) if inside else 0.0
    return Bracket(Usd.TimeCode(lower), Usd.TimeCode(upper), fraction)


def sample_times(prim: Usd.Prim, names: Iterable[str]) -> list[float]:
    """Return the sample times of these attributes, ascending, without tokens.LONG_AGO."""
    found = [prim.GetAttribute(name) for name in names]
    times = {time for item in found if item for time in item.GetTimeSamples()}
    return sorted(times - {tokens.LONG_AGO})


def array(prim: Usd.Prim, name: str, code: Usd.TimeCode) -> Array | None:
    """Return the value of an array attribute, without a copy where possible, or None."""
    attribute = prim.GetAttribute(name)
    return as_array(attribute.Get(code)) if attribute else None


def as_array(value: Any) -> Array | None:
    """Return a value of USD as an array, without a copy where possible; None if it is not one."""
    return from_vt(value) if _is_array(value) else None


def length(prim: Usd.Prim, name: str, code: Usd.TimeCode) -> int:
    """Return the number of values of an array attribute; 0 if it has none or is not an array."""
    attribute = prim.GetAttribute(name)
    value: Any = attribute.Get(code) if attribute else None
    return len(value) if _is_array(value) else 0


def rows(values: Array | None, count: int) -> Array | None:
    """Apply the stock schema's rule for per-splat arrays: truncate long ones, ignore short ones."""
    return None if values is None or len(values) < count else values[:count]


def ids(prim: Usd.Prim, code: Usd.TimeCode, count: int) -> I64 | None:
    """Return the ids of the splats, or None."""
    values = rows(array(prim, tokens.IDS, code), count)
    return values if values is not None and count and values.dtype == np.int64 else None


def velocities(prim: Usd.Prim, code: Usd.TimeCode, count: int) -> F32 | None:
    """Return the velocities of the splats [scene unit / s], or None."""
    values = rows(array(prim, tokens.VELOCITIES, code), count)
    return as_float32(values) if values is not None and count else None


def centres(prim: Usd.Prim, name: str, code: Usd.TimeCode, time: Time) -> tuple[F32, F32 | None]:
    """Return centres [scene unit] and velocities [scene unit / s], or None for the latter.

    Splats with velocities are extrapolated from the sample before, regardless of the next one.
    Between samples of different counts this is the only source of motion.

    Args:
        prim: The field.
        name: Name of the attribute of its centres.
        code: Result of `time_code` for `time`; centres without velocities are read there.
        time: The requested time.

    Source: the rule of UsdGeomPointBased's ComputePointsAtTime: velocities apply if they have the
    same number of values and the same sample time as the centres.
    """
    sample = _moving_since(prim, name, time)
    values = array(prim, name, code if sample is None else sample)
    positions = np.empty((0, 3), np.float32) if values is None else as_float32(values)
    if sample is None:
        return positions, velocities(prim, code, len(positions))
    speeds = as_float32(np.asarray(prim.GetAttribute(tokens.VELOCITIES).Get(sample)))
    ticks = Usd.TimeCode(time).GetValue() - sample.GetValue()
    if ticks:
        seconds = np.float32(ticks / prim.GetStage().GetTimeCodesPerSecond())
        positions = positions + speeds * seconds
    return positions, speeds


def have_velocities(prim: Usd.Prim) -> bool:
    """Return whether samples of velocities may move the splats."""
    attribute = prim.GetAttribute(tokens.VELOCITIES)
    return bool(attribute) and attribute.GetNumTimeSamples() > 0


def degree(prim: Usd.Prim, code: Usd.TimeCode) -> int:
    """Return the authored degree of the harmonics, legal or not."""
    attribute = prim.GetAttribute(tokens.SH_DEGREE)
    value = attribute.Get(code) if attribute else None
    return tokens.SCHEMA_FALLBACK_DEGREE if value is None else int(value)


def set_array(
    prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName, value: Any, code: Usd.TimeCode
) -> Usd.Attribute:
    """Author a varying attribute; a default value replaces existing samples, which would hide
    it."""
    attribute = prim.CreateAttribute(name, kind, custom=False)
    if code.IsDefault() and attribute.GetNumTimeSamples():
        attribute.Clear()
    attribute.Set(value, code)
    return attribute


def set_uniform(prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName, value: Any) -> None:
    """Author an attribute that does not change over time."""
    attribute = prim.CreateAttribute(name, kind, custom=False, variability=Sdf.VariabilityUniform)
    attribute.Set(value)


def forget(prim: Usd.Prim, names: Iterable[str]) -> None:
    """Remove the opinions of the edit target on attributes; weaker layers keep theirs."""
    for name in names:
        if prim.HasProperty(name):
            prim.RemoveProperty(name)


def silence(prim: Usd.Prim, names: Iterable[str]) -> None:
    """Leave attributes without a value: `forget` them and block opinions of weaker layers."""
    forget(prim, names)
    for name in names:
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasAuthoredValue():
            attribute.Block()


def _moving_since(prim: Usd.Prim, name: str, time: Time) -> Usd.TimeCode | None:
    """Return the sample that velocities extrapolate centres from, or None if they do not apply."""
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    if not code.IsNumeric():
        return None
    around: list[tuple[float, ...]] = [
        attribute.GetBracketingTimeSamples(code.GetValue()) if attribute else ()
        for attribute in (prim.GetAttribute(name), prim.GetAttribute(tokens.VELOCITIES))
    ]
    if not all(around) or not math.isclose(around[0][0], around[1][0], abs_tol=_TOGETHER):
        return None
    sample = Usd.TimeCode(around[0][0])
    count = length(prim, tokens.VELOCITIES, sample)
    return sample if count and count == length(prim, name, sample) else None


def _default_or_earliest(prim: Usd.Prim) -> Usd.TimeCode:
    """Return the default time, or the earliest if the centres have no default value."""
    for name in (tokens.POSITIONS, tokens.POSITIONS_HALF):
        attribute = prim.GetAttribute(name)
        if attribute and attribute.Get() is not None:
            return Usd.TimeCode.Default()
    return Usd.TimeCode.EarliestTime()


def _is_array(value: Any) -> bool:
    """Return whether a value of USD is an array; strings and None are not."""
    return hasattr(value, "__len__") and not isinstance(value, str)


def _same(first: Any, second: Any) -> bool:
    """Return whether two samples of ids are equal; None equals None."""
    if first is None or second is None:
        return first is second
    return np.array_equal(np.asarray(first), np.asarray(second))
