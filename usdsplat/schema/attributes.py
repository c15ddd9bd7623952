"""Read and write the array attributes of one splat prim at one time."""

from __future__ import annotations

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
"""A time code; None is the default value or, where a prim has only samples, the first of them."""


@dataclass(frozen=True, slots=True)
class Bracket:
    """The samples of an attribute around a time."""

    lower: Usd.TimeCode
    upper: Usd.TimeCode
    fraction: float
    """Where the time lies between them [0..1); 0 on a sample, and where values are held."""


def time_code(prim: Usd.Prim, time: Time) -> Usd.TimeCode:
    """The time at which to ask the prim for its arrays.

    Values that change hands may not be mixed: between two samples whose ids differ the earlier
    sample's own time is returned, so that nothing is interpolated.
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
    """The samples around `code`, or `code` itself twice where there are none to mix."""
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
    """Time codes at which any of these attributes has a sample, ascending."""
    found = [prim.GetAttribute(name) for name in names]
    return sorted({time for item in found if item for time in item.GetTimeSamples()})


def array(prim: Usd.Prim, name: str, code: Usd.TimeCode) -> Array | None:
    """The value of an array attribute, in place where possible; None when there is none."""
    attribute = prim.GetAttribute(name)
    value = attribute.Get(code) if attribute else None
    return from_vt(value) if _is_array(value) else None


def length(prim: Usd.Prim, name: str, code: Usd.TimeCode) -> int:
    """Number of values of an array attribute; 0 where it has none, or is no array."""
    attribute = prim.GetAttribute(name)
    value: Any = attribute.Get(code) if attribute else None
    return len(value) if _is_array(value) else 0


def rows(values: Array | None, count: int) -> Array | None:
    """The stock schema's rule for per-splat arrays: too long is cut, too short is ignored."""
    return None if values is None or len(values) < count else values[:count]


def ids(prim: Usd.Prim, code: Usd.TimeCode, count: int) -> I64 | None:
    """Identities of the splats, or None."""
    values = rows(array(prim, tokens.IDS, code), count)
    return values if values is not None and count and values.dtype == np.int64 else None


def velocities(prim: Usd.Prim, code: Usd.TimeCode, count: int) -> F32 | None:
    """Velocities of the splats [scene unit / s], or None."""
    values = rows(array(prim, tokens.VELOCITIES, code), count)
    return as_float32(values) if values is not None and count else None


def degree(prim: Usd.Prim, code: Usd.TimeCode) -> int:
    """Degree of the harmonics as the prim says it, legal or not."""
    attribute = prim.GetAttribute(tokens.SH_DEGREE)
    value = attribute.Get(code) if attribute else None
    return tokens.SCHEMA_FALLBACK_DEGREE if value is None else int(value)


def set_array(
    prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName, value: Any, code: Usd.TimeCode
) -> Usd.Attribute:
    """Author a varying attribute; a default value replaces the samples that would hide it."""
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
    """Take away what the edit target says about attributes; weaker layers keep their say."""
    for name in names:
        if prim.HasProperty(name):
            prim.RemoveProperty(name)


def silence(prim: Usd.Prim, names: Iterable[str]) -> None:
    """Leave attributes without a value: `forget` them and block what weaker layers say."""
    forget(prim, names)
    for name in names:
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasAuthoredValue():
            attribute.Block()


def _default_or_earliest(prim: Usd.Prim) -> Usd.TimeCode:
    """The default time, unless the centres have nothing there."""
    for name in (tokens.POSITIONS, tokens.POSITIONS_HALF):
        attribute = prim.GetAttribute(name)
        if attribute and attribute.Get() is not None:
            return Usd.TimeCode.Default()
    return Usd.TimeCode.EarliestTime()


def _is_array(value: Any) -> bool:
    """Whether a value of USD's is an array; text and None are not."""
    return hasattr(value, "__len__") and not isinstance(value, str)


def _same(first: Any, second: Any) -> bool:
    """Whether two samples of ids are equal, None included."""
    if first is None or second is None:
        return first is second
    return np.array_equal(np.asarray(first), np.asarray(second))
