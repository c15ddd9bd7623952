"""Compare the types of values with those of the schemas; USD lets them differ.

An attribute reports the schema's type regardless of its layers, so values are examined.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

from pxr import Sdf, Usd

from usdsplat.schema import tokens


def fits(name: str, value: Any) -> bool:
    """Return whether a value has its attribute's type, or either is unknown.

    Half and float are different types; point3f and float3 are not.
    """
    expected = expected_type(name)
    return value is None or expected is None or bool(actual_type(value).type == expected.type)


def actual_type(value: Any) -> Sdf.ValueTypeName:
    """Return the type of a value of an attribute."""
    return Sdf.GetValueTypeNameForValue(value)


def expected_type(name: str) -> Sdf.ValueTypeName | None:
    """Return the schema's type of an array or the degree; None for other attributes."""
    return _schema_types().get(name)


@functools.cache
def _schema_types() -> Mapping[str, Sdf.ValueTypeName]:
    """Return the type by attribute. Tokens are omitted: in Python they are plain strings."""
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
        if definition  # ours are unknown if USD built its registry before
        for name in names & set(definition.GetPropertyNames())
    }
