"""The types that the schemas give to attributes, and those that values have: USD lets them differ.

An attribute of a schema claims the schema's type whatever layers say, so values are looked at.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

from pxr import Sdf, Usd

from usdsplat.schema import tokens


def fits(name: str, value: Any) -> bool:
    """Whether a value has the type that its attribute should have, or neither is known.

    Half and float differ, point3f and float3 do not.
    """
    expected = expected_type(name)
    return value is None or expected is None or bool(actual_type(value).type == expected.type)


def actual_type(value: Any) -> Sdf.ValueTypeName:
    """Type of a value that an attribute returned."""
    return Sdf.GetValueTypeNameForValue(value)


def expected_type(name: str) -> Sdf.ValueTypeName | None:
    """Type of an array, or of the degree, in the schemas; None for any other attribute."""
    return _schema_types().get(name)


@functools.cache
def _schema_types() -> Mapping[str, Sdf.ValueTypeName]:
    """Attribute -> type. Tokens are left out: Python does not tell them from text."""
    registry = Usd.SchemaRegistry()
    definitions = (
        registry.FindConcretePrimDefinition(tokens.STOCK_TYPE),
        registry.FindConcretePrimDefinition(tokens.PACKED_TYPE),
        registry.FindAppliedAPIPrimDefinition(tokens.FIELD_API),
    )
    names = tokens.DATA_ATTRIBUTES - {tokens.PACKING} | {tokens.EXTENT}
    return {
        name: definition.GetAttributeDefinition(name).GetTypeName()
        for definition in definitions
        if definition  # ours are unknown where USD's registry came first
        for name in names & set(definition.GetPropertyNames())
    }
