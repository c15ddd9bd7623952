"""Read and write the grade of a splat field (SplatGradeAPI).

A field inherits each value that it does not have from its nearest ancestor that has it, so that an
asset can be graded on its model prim.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd

from usdsplat.core.errors import StageError
from usdsplat.core.grade import Grade
from usdsplat.schema import tokens
from usdsplat.schema.attributes import Time, set_array

_Type = Sdf.ValueTypeNames
_PREFIX = "splat:grade:"
_ATTRIBUTES = {
    "exposure": (tokens.GRADE_EXPOSURE, _Type.Float),
    "temperature": (tokens.GRADE_TEMPERATURE, _Type.Float),
    "tint": (tokens.GRADE_TINT, _Type.Float),
    "gain": (tokens.GRADE_GAIN, _Type.Color3f),
    "saturation": (tokens.GRADE_SATURATION, _Type.Float),
    "matrix": (tokens.GRADE_MATRIX, _Type.Matrix3d),
}
"""Field of `Grade` -> (attribute name, type)."""


def grade(prim: Usd.Prim, time: Time = None) -> Grade:
    """Return the grade of a field: each value is its own, or else that of its nearest ancestor.

    Args:
        prim: A splat field.
        time: Time code; None is the default value or, without one, the first sample.

    Raises:
        StageError: If a value is out of range, not finite or of the wrong type; it names the prim
            that has the value.
    """
    values: dict[str, Any] = {}
    for field, (name, kind) in _ATTRIBUTES.items():
        attribute = _nearest(prim, name)
        if attribute is None:
            continue
        value = _value(attribute, time)
        if value is None:
            continue
        try:
            values[field] = _numbers(field, value)
        except (TypeError, ValueError) as error:
            found = f"a value of type {attribute.GetTypeName()}"
            where = f"{attribute.GetPrim().GetPath()} {name}"
            raise StageError(where, found, str(kind)) from error
        where = f"{attribute.GetPrim().GetPath()} {_PREFIX}"
        Grade(**{field: values[field]}).check(where, error=StageError)
    return Grade(**values)


def author_grade(prim: Usd.Prim, *, time: Time = None, **values: Any) -> None:
    """Apply SplatGradeAPI and write its attributes on the stage's edit target.

    Args:
        prim: A splat field, or a prim above fields.
        time: Time code of a sample; None writes default values and removes samples.
        values: Fields of `Grade`; omitted ones stay unchanged.

    Raises:
        UsageError: If a value is out of range or not finite.
    """
    Grade(**values).check(f"{prim.GetPath()} {_PREFIX}")
    code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    prim.AddAppliedSchema(tokens.GRADE_API)
    for field, value in values.items():
        name, kind = _ATTRIBUTES[field]
        if field == "matrix":
            value = Gf.Matrix3d(*np.reshape(value, (3, 3)).T.ravel().tolist())
        elif field == "gain":
            value = Gf.Vec3f(*(float(each) for each in value))
        set_array(prim, name, kind, value, code)


def is_grade_varying(prim: Usd.Prim) -> bool:
    """Return whether `grade` may return different values at different times."""
    found = (_nearest(prim, name) for name in tokens.GRADE_ATTRIBUTES)
    return any(attribute and attribute.ValueMightBeTimeVarying() for attribute in found)


def has_grade(prim: Usd.Prim) -> bool:
    """Return whether a prim has an own opinion on a grade, for itself or the fields below it."""
    return bool(prim.GetAuthoredPropertiesInNamespace(_PREFIX.rstrip(":")))


def _nearest(prim: Usd.Prim, name: str) -> Usd.Attribute | None:
    """Return the attribute of a prim or its nearest ancestor that is authored, or None."""
    while prim and not prim.IsPseudoRoot():
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasAuthoredValue():
            return attribute
        prim = prim.GetParent()
    return None


def _value(attribute: Usd.Attribute, time: Time) -> Any:
    if time is not None:
        return attribute.Get(Usd.TimeCode(time))
    value = attribute.Get()
    return attribute.Get(Usd.TimeCode.EarliestTime()) if value is None else value


def _numbers(field: str, value: Any) -> float | tuple[float, ...]:
    """Convert a USD value to the type of the field of `Grade`."""
    if field == "matrix":
        return tuple(np.array(value, np.float64).reshape(3, 3).T.ravel().tolist())
    if field == "gain":
        return tuple(np.array(value, np.float64).reshape(3).tolist())
    return float(value)
