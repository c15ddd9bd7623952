"""Knobs: dataclass fields that carry help text, unit, range and choices.

Command-line flags, schema properties and panels are derived from `knobs(cls)`. Values from any of
them are validated by `checked`, so a range is declared once and applies everywhere.
"""

from __future__ import annotations

import math
import numbers
import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Any, Literal, TypeVar

from usdsplat.core.errors import UsageError

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Knob:
    """A knob: one parameter of a frozen dataclass, as flags and panels need it."""

    name: str
    type: Any
    """The resolved annotation: bool, int, float, str, Literal[...], tuple[...], or one of these |
    None."""
    default: Any
    text: str
    """Help text, one sentence."""
    unit: str = ""
    """Unit such as "pixel" or "s"; "" for numbers without one."""
    range: tuple[float, float] | None = None
    """Lowest and highest legal value, inclusive; for a tuple, of each element."""
    choices: tuple[Any, ...] | None = None
    usd_type: str | None = None
    """Sdf value type name, if it does not follow from `type`."""
    uniform: bool = False
    """Whether the value is constant over time; others may have time samples on a stage."""
    takes_mask: bool = False
    """Whether the value may differ from splat to splat, by a mask that multiplies it."""

    @property
    def expected(self) -> str:
        """Description of a legal value for error messages."""
        unit = f" [{self.unit}]" if self.unit else ""
        if self.choices is not None:
            return f"one of {', '.join(map(str, self.choices))}"
        if self.range is not None:
            return f"{_limits(*self.range)}{unit}"
        return f"{_type_name(self.type)}{unit}"


def knob(
    default: Any,
    text: str,
    *,
    unit: str = "",
    range: tuple[float, float] | None = None,
    choices: Iterable[Any] | None = None,
    usd_type: str | None = None,
    uniform: bool = False,
    takes_mask: bool = False,
) -> Any:
    """Declare a dataclass field as a knob; see `Knob` for the arguments.

    The choices of a field annotated `Literal[...]` are taken from there.
    """
    metadata = {
        "text": text,
        "unit": unit,
        "range": range,
        "choices": None if choices is None else tuple(choices),
        "usd_type": usd_type,
        "uniform": uniform,
        "takes_mask": takes_mask,
    }
    return field(default=default, metadata={"knob": metadata})


def knobs(cls: type) -> tuple[Knob, ...]:
    """List the knobs of a dataclass in order of declaration; other fields are left out."""
    return _declared(cls)


@cache  # resolving annotations is slow
def _declared(cls: Any) -> tuple[Knob, ...]:
    hints = typing.get_type_hints(cls)
    found = []
    for item in fields(cls):
        if "knob" not in item.metadata:
            continue
        metadata = dict(item.metadata["knob"])
        if metadata["choices"] is None:
            metadata["choices"] = _literals(hints[item.name])
        found.append(Knob(name=item.name, type=hints[item.name], default=item.default, **metadata))
    return tuple(found)


def checked(where: str, cls: type[T], values: Mapping[str, Any]) -> T:
    """Create a `cls` from named values; other knobs keep their defaults.

    Integers are converted to float and sequences to tuples, because command lines, JSON and USD
    provide them; nothing else is converted.

    Args:
        where: Origin of the values in error messages, such as a prim path or "render settings".

    Raises:
        UsageError: If a name is not a knob of `cls`, or a value has the wrong type or lies outside
            its range or choices; NaN lies outside every range.
    """
    known = {item.name: item for item in knobs(cls)}
    taken = {}
    for name, value in values.items():
        if name not in known:
            raise UsageError(where, f"unknown setting {name!r}", f"one of {', '.join(known)}")
        taken[name] = checked_value(f"{where} {name}", known[name], value)
    return cls(**taken)


def checked_value(where: str, item: Knob, value: Any) -> Any:
    """Return one value as its knob's type, as `checked` does.

    Raises:
        UsageError: If it has the wrong type, or lies outside the knob's range or choices.
    """
    try:
        return _taken(item, value)
    except (TypeError, ValueError):
        raise UsageError(where, repr(value), item.expected) from None


def _taken(item: Knob, value: Any) -> Any:
    """Return `value` as the knob's type; raise ValueError or TypeError if it is not legal."""
    result = _as_type(item.type, value)
    parts = result if isinstance(result, tuple) else (result,)
    for part in parts:
        if part is None:
            continue
        if item.choices is not None and part not in item.choices:
            raise ValueError
        if item.range is not None and not item.range[0] <= part <= item.range[1]:
            raise ValueError
        if isinstance(part, float) and math.isnan(part):
            raise ValueError
    return result


def _as_type(hint: Any, value: Any) -> Any:
    """Return `value` converted to the annotated type, or raise TypeError."""
    options = _options(hint)
    if value is None and type(None) in options:
        return None
    kind = next(option for option in options if option is not type(None))
    if typing.get_origin(kind) is tuple:
        return _as_tuple(typing.get_args(kind), value)
    if kind is float and isinstance(value, numbers.Real) and not isinstance(value, bool):
        return float(value)
    if kind is int and isinstance(value, numbers.Integral) and not isinstance(value, bool):
        return int(value)
    if typing.get_origin(kind) is Literal or (kind not in (int, float) and isinstance(value, kind)):
        return value
    raise TypeError


def _as_tuple(hints: tuple[Any, ...], value: Any) -> tuple[Any, ...]:
    """Convert each element to its own annotation; `tuple[x, ...]` takes any number."""
    if isinstance(value, str):
        raise TypeError
    parts = tuple(value)
    if len(hints) == 2 and hints[1] is Ellipsis:
        hints = (hints[0],) * len(parts)
    return tuple(_as_type(hint, part) for hint, part in zip(hints, parts, strict=True))


def _options(hint: Any) -> tuple[Any, ...]:
    """Return the members of a union `a | b`, or the annotation itself."""
    is_union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    return typing.get_args(hint) if is_union else (hint,)


def _literals(hint: Any) -> tuple[Any, ...] | None:
    """Return the values of a Literal, also inside `Literal[...] | None`."""
    for option in _options(hint):
        if typing.get_origin(option) is Literal:
            return typing.get_args(option)
    return None


def _limits(lower: float, upper: float) -> str:
    """Describe an interval for error messages, without infinite ends."""
    if math.isinf(lower) and math.isinf(upper):
        return "a number"
    if math.isinf(upper):
        return f"{lower:g} or more"
    if math.isinf(lower):
        return f"{upper:g} or less"
    return f"{lower:g} to {upper:g}"


def _type_name(hint: Any) -> str:
    """Describe an annotation for error messages."""
    parts = typing.get_args(hint)
    if typing.get_origin(hint) is tuple and set(parts) <= {int, float}:
        return f"{len(parts)} numbers"
    return hint.__name__ if isinstance(hint, type) and not typing.get_args(hint) else str(hint)
