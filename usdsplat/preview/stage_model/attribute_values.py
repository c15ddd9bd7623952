"""Convert attribute values to the values of editors and back: bool, number, text, small vector."""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import Knob
from usdsplat.preview.knob_model import Editor, Kind, kind_of, label, soft_range, step
from usdsplat.preview.knob_model import editor_of as knob_editor
from usdsplat.schema.values import value as value_at
from usdsplat.sim.parameters import NAMESPACE
from usdsplat.sim.stage.authoring import find

_WHOLE = {
    "uchar": (0, 2**8 - 1),
    "int": (-(2**31), 2**31 - 1),
    "uint": (0, 2**32 - 1),
    "int64": (-(2**63), 2**63 - 1),
    "uint64": (0, 2**64 - 1),
}
_REAL = {
    "half": 65504.0,
    "float": float(np.finfo(np.float32).max),
    "double": float(np.finfo(np.float64).max),
    "timecode": float(np.finfo(np.float64).max),
}
"""Largest finite value of each type."""
_TEXT = ("string", "token", "asset")
_LETTERS = {"i": "int", "h": "half", "f": "float", "d": "double"}
_FEW = 3
"""Number of elements of an array that are shown."""
_LONGEST = 200
"""Number of characters of a text that are shown."""
_NO_CHOICES: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """The scalar type, the size and the kind of an attribute's value."""

    kind: Kind
    scalar: str
    """Scalar type of its elements, such as "float"."""
    size: int = 1


def form_of(attribute: Usd.Attribute) -> Form | None:
    """Return the form of an attribute's value; None where no simple editor exists, as for
    arrays."""
    name = attribute.GetTypeName()
    if name.isArray or not name:
        return None
    text = str(name)
    if text == "bool":
        return Form(kind="bool", scalar=text)
    if text in _WHOLE:
        return Form(kind="int", scalar=text)
    if text in _REAL:
        return Form(kind="float", scalar=text)
    if text in _TEXT:
        is_choice = text == "token" and bool(choices_of(attribute))
        return Form(kind="choice" if is_choice else "text", scalar=text)
    held = str(name.type.typeName)  # "GfVec3f" whatever the role
    if held.startswith("GfVec") and held[-1] in _LETTERS:
        kind: Kind = "color" if text.startswith("color3") else "vector"
        return Form(kind=kind, scalar=_LETTERS[held[-1]], size=int(held[5]))
    return None


def choices_of(attribute: Usd.Attribute) -> tuple[str, ...]:
    """Return the allowed tokens of an attribute; () if any is allowed."""
    return tuple(map(str, attribute.GetMetadata("allowedTokens") or _NO_CHOICES))


def editor_of(attribute: Usd.Attribute, time: Usd.TimeCode) -> Editor | None:
    """Return the editor of an attribute; None where no simple editor exists.

    Parameters of simulations have the editors of their knobs.
    """
    form, item = form_of(attribute), parameter_of(attribute)
    if form is None:
        return None
    is_single = form.scalar in ("float", "half")
    found = value_at(attribute, time)
    held = plain(found, is_single=is_single)
    if item is not None and kind_of(item) == form.kind:
        known = item.default if found is None else _as_knob(item, found, held)
        made = knob_editor(item, known, name=attribute.GetName())
    else:
        definition = attribute.GetPrim().GetPrimDefinition()
        fallback = definition.GetAttributeFallbackValue(attribute.GetName())
        made = _editor(attribute, form, held, plain(fallback, is_single=is_single))
    return replace(
        made,
        label=label(attribute.GetBaseName()),
        is_animated=attribute.GetNumTimeSamples() > 0,
        is_authored=attribute.HasAuthoredValue(),
    )


def _editor(attribute: Usd.Attribute, form: Form, held: Any, fallback: Any) -> Editor:
    """Return the editor of an attribute that is not one of our parameters."""
    is_whole = form.scalar in _WHOLE
    low, high = _WHOLE.get(form.scalar, (-math.inf, math.inf))
    span = (0.0, 1.0)
    if form.kind in ("int", "float", "vector"):
        parts = held if isinstance(held, tuple) else (held,)
        numbers_held = tuple(part for part in parts if isinstance(part, (int, float)))
        is_size = isinstance(fallback, (int, float)) and fallback > 0
        least = max(low, 0.0) if is_size else low
        scale = numbers_held or fallback
        span = soft_range(least, high, scale, numbers_held, is_whole=is_whole)
    return Editor(
        name=attribute.GetName(),
        label="",
        kind=form.kind,
        value=_empty(form) if held is None else held,
        default=fallback,
        minimum=low if form.kind == "int" else None,
        maximum=high if form.kind == "int" else None,
        soft_range=span,
        step=1.0 if is_whole else step(span),
        is_whole=is_whole,
        choices=choices_of(attribute),
        help=attribute.GetDocumentation(),
    )


def _as_knob(item: Knob, found: Any, held: Any) -> Any:
    """Return the value for a knob. `plain` has no infinite numbers; knobs do."""
    if held is None and isinstance(item.default, float):
        return float(found.GetValue() if isinstance(found, Sdf.TimeCode) else found)
    return held


def parameter_of(attribute: Usd.Attribute) -> Knob | None:
    """Return the knob of a simulation parameter; None for any other attribute."""
    lead, _, name = attribute.GetName().partition(":")
    if lead != NAMESPACE:
        return None
    try:
        return find(name)[2]
    except UsageError:
        return None


def plain(found: Any, *, is_single: bool = False) -> Any:
    """Convert a USD value to plain Python; vectors become tuples, non-finite numbers None.

    Args:
        found: A scalar or a vector.
        is_single: Whether numbers have single precision or less. They are rounded to the shortest
            decimal that identifies the number.
    """
    if isinstance(found, Sdf.TimeCode):
        found = found.GetValue()
    if isinstance(found, Sdf.AssetPath):
        return str(found.path)
    if isinstance(found, bool) or found is None:
        return found
    if isinstance(found, str):
        return str(found)
    if isinstance(found, numbers.Real):
        if isinstance(found, int) or not math.isfinite(found):
            return found if isinstance(found, int) else None
        return float(np.format_float_scientific(np.float32(found))) if is_single else float(found)
    return tuple(plain(part, is_single=is_single) for part in found)


def text_of(found: Any) -> str:
    """Return a value as short text: the count and first elements of an array, the beginning of a
    long text."""
    if found is None:
        return ""
    if (
        isinstance(found, (list, tuple))
        or hasattr(found, "__array_interface__")
        or _is_array(found)
    ):
        few = ", ".join(text_of(found[number]) for number in range(min(len(found), _FEW)))
        dots = ", …" if len(found) > _FEW else ""
        return f"[{few}{dots}]" if len(found) <= _FEW else f"{len(found):,} × [{few}{dots}]"
    if hasattr(found, "GetAppliedItems"):  # a list edit
        return ", ".join(map(str, found.GetAppliedItems()))
    if isinstance(found, dict):
        return _short("{" + ", ".join(f"{key}: {text_of(found[key])}" for key in found) + "}")
    if isinstance(found, float):
        return f"{found:.7g}"
    if hasattr(found, "displayName"):  # an enum value
        return str(found.displayName)
    if isinstance(found, str):
        return _short(found)
    if isinstance(found, bool) or not hasattr(found, "__len__"):
        return _short(str(getattr(found, "path", found)))
    return "(" + ", ".join(text_of(part) for part in found) + ")"


def taken(where: str, attribute: Usd.Attribute, value: Any) -> Any:
    """Convert an editor's value to the attribute's type.

    Args:
        where: Name for error messages.

    Raises:
        UsageError: If the attribute cannot have that value.
    """
    form = form_of(attribute)
    if form is None:
        raise UsageError(where, f"a {attribute.GetTypeName()}", "an attribute of a simple type")
    if form.kind in ("vector", "color"):
        return _vector(where, attribute, form, value)
    choices = choices_of(attribute)
    if choices and form.kind == "choice" and value not in choices:
        raise UsageError(where, repr(value), f"one of {', '.join(choices)}")
    return _scalar(where, form.scalar, value)


def _vector(where: str, attribute: Usd.Attribute, form: Form, value: Any) -> Any:
    is_sequence = isinstance(value, (tuple, list, np.ndarray))
    if not is_sequence or len(value) != form.size:
        raise UsageError(where, repr(value), f"{form.size} numbers")
    return attribute.GetTypeName().type.pythonClass(
        *(_scalar(where, form.scalar, part) for part in value)
    )


def _scalar(where: str, scalar: str, value: Any) -> Any:
    """Return a value converted to a scalar type, checked."""
    if scalar == "bool":
        if not isinstance(value, bool):
            raise UsageError(where, repr(value), "true or false")
        return value
    if scalar in _TEXT:
        if not isinstance(value, str) or "\0" in value:
            raise UsageError(where, repr(value), "a text")
        return Sdf.AssetPath(value) if scalar == "asset" else value
    is_number = isinstance(value, numbers.Real) and not isinstance(value, bool)
    if scalar in _WHOLE:
        low, high = _WHOLE[scalar]
        if not is_number or not isinstance(value, numbers.Integral):
            raise UsageError(where, repr(value), "a whole number")
        if not low <= int(value) <= high:
            raise UsageError(where, repr(value), f"{low} to {high}")
        return int(value)
    most = _REAL[scalar]
    if not is_number or not -most <= value <= most:
        raise UsageError(where, repr(value), "a finite number")
    return Sdf.TimeCode(float(value)) if scalar == "timecode" else float(value)


def _is_array(found: Any) -> bool:
    return type(found).__module__ == "pxr.Vt" and hasattr(found, "__getitem__")


def _short(text: str) -> str:
    """Return the first line of a text, cut to the length a row can show."""
    line = text[: _LONGEST + 1].partition("\n")[0]
    return text if line == text and len(text) <= _LONGEST else f"{line[:_LONGEST]}…"


def _empty(form: Form) -> Any:
    """Return the initial value of an editor where no value is authored."""
    if form.kind in ("vector", "color"):
        return (0,) * form.size
    return {"bool": False, "int": 0, "float": 0.0}.get(form.kind, "")
