"""Every knob once: a dataclass field that carries its help, unit, range and choices.

Command-line flags, schema properties and panels are derived from `knobs(cls)`; values from any of
them come back through `checked`, so a limit is written in one place and holds everywhere.
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
    """One parameter of a frozen dataclass, as a flag or a panel needs to see it."""

    name: str
    type: Any
    """The resolved annotation: bool, int, float, str, Literal[...], tuple[...], or such | None."""
    default: Any
    text: str
    """What it does, one sentence."""
    unit: str = ""
    """Such as "pixel" or "s"; empty for numbers without one."""
    range: tuple[float, float] | None = None
    """Lowest and highest legal value, both included; of each element when it is a tuple."""
    choices: tuple[Any, ...] | None = None
    usd_type: str | None = None
    """Sdf value type name where it does not follow from `type`."""
    uniform: bool = False
    """Whether it holds for all times; on a stage others may have time samples."""

    @property
    def expected(self) -> str:
        """What a legal value is, in the words of an error message."""
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
) -> Any:
    """Declare a dataclass field with its help; see `Knob` for what the arguments mean.

    A field annotated `Literal[...]` has its choices from there.
    """
    metadata = {
        "text": text,
        "unit": unit,
        "range": range,
        "choices": None if choices is None else tuple(choices),
        "usd_type": usd_type,
        "uniform": uniform,
    }
    return field(default=default, metadata={"knob": metadata})


def knobs(cls: type) -> tuple[Knob, ...]:
    """List the knobs of a dataclass in order of declaration; other fields are left out."""
    return _declared(cls)


@cache  # annotations take long to resolve, and do not change
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
    """Make a `cls` from named values; knobs that are not named keep their defaults.

    Whole numbers are taken for real ones and sequences for tuples, because command lines, JSON and
    USD spell them so; nothing else is converted.

    Args:
        where: What the user would recognise, such as a prim path or "render settings".

    Raises:
        UsageError: If a name is not a knob of `cls`, or a value has another type or lies outside
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
        UsageError: If it has another type, or lies outside the knob's range or choices.
    """
    try:
        return _taken(item, value)
    except (TypeError, ValueError):
        raise UsageError(where, repr(value), item.expected) from None


def _taken(item: Knob, value: Any) -> Any:
    """`value` as the knob's type; ValueError or TypeError when it is not a legal one."""
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
    """`value` as what the annotation says, or TypeError."""
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
    """Each element as its own annotation; `tuple[x, ...]` takes any number."""
    if isinstance(value, str):
        raise TypeError
    parts = tuple(value)
    if len(hints) == 2 and hints[1] is Ellipsis:
        hints = (hints[0],) * len(parts)
    return tuple(_as_type(hint, part) for hint, part in zip(hints, parts, strict=True))


def _options(hint: Any) -> tuple[Any, ...]:
    """The members of `a | b`; of anything else, itself."""
    is_union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    return typing.get_args(hint) if is_union else (hint,)


def _literals(hint: Any) -> tuple[Any, ...] | None:
    """The values of a Literal, also inside `Literal[...] | None`."""
    for option in _options(hint):
        if typing.get_origin(option) is Literal:
            return typing.get_args(option)
    return None


def _limits(lower: float, upper: float) -> str:
    """Words for an interval, open ends left out."""
    if math.isinf(lower) and math.isinf(upper):
        return "a number"
    if math.isinf(upper):
        return f"{lower:g} or more"
    if math.isinf(lower):
        return f"{upper:g} or less"
    return f"{lower:g} to {upper:g}"


def _type_name(hint: Any) -> str:
    """An annotation as a user reads it."""
    parts = typing.get_args(hint)
    if typing.get_origin(hint) is tuple and set(parts) <= {int, float}:
        return f"{len(parts)} numbers"
    return hint.__name__ if isinstance(hint, type) and not typing.get_args(hint) else str(hint)
