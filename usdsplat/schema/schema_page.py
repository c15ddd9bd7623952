"""Write docs/reference/schema.md, the page of all prim types and API schemas, from their sources.

python -m usdsplat.schema.schema_page [--check]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence

from pxr import Sdf

from usdsplat.core.generated_page import REFERENCE, keep_page, table_text
from usdsplat.schema.generate import SOURCES

TARGET = REFERENCE / "schema.md"

_HEAD = """# Schema

The prim types and API schemas of usdsplat. They are codeless: `plugInfo/` has the definitions
that USD reads, and no code. [What is on the stage](../stage.md) and [Simulate](../simulate.md)
show how they are used. A property with `:NAME:` belongs to a schema that is applied once for each
NAME.

This page is generated from `usdsplat/schema/schema.usda` and `simulation.usda` by `python -m
usdsplat.schema.schema_page`.
"""
_KIND, _CLASS = "apiSchemaType", Sdf.SpecifierClass


def page() -> str:
    """Return the text of the page."""
    layers = [Sdf.Layer.FindOrOpen(str(path)) for path in SOURCES]
    specs = [spec for layer in layers for spec in layer.rootPrims if spec.specifier == _CLASS]
    return _HEAD + "".join(part for spec in specs for part in _section(spec))


def _section(spec: Sdf.PrimSpec) -> Iterator[str]:
    """Yield the description of a schema and the table of its properties."""
    kind = spec.customData.get(_KIND)
    yield f"\n## {spec.name}\n\n{_kind(spec, kind)}\n\n{_paragraphs(spec.documentation)}\n"
    if built_in := spec.GetInfo("apiSchemas").GetAddedOrExplicitItems():
        yield f"\nBuilt in: {', '.join(f'`{name}`' for name in built_in)}.\n"
    prefix = spec.customData.get("propertyNamespacePrefix", "")
    if spec.properties:
        yield "\n| property | type, default | meaning |\n|---|---|---|\n"
    for each in spec.properties:
        name = f"{prefix}:NAME:{each.name}" if kind == "multipleApply" else each.name
        yield f"| `{name}` | {_type(each)} | {_meaning(each)} |\n"


def _kind(spec: Sdf.PrimSpec, kind: str | None) -> str:
    """Return what a schema is, in a sentence."""
    if kind is None:
        (base,) = spec.inheritPathList.GetAddedOrExplicitItems()
        return f"A prim type, derived from `{base.name}`."
    several = ", any number of times, each with a NAME" if kind == "multipleApply" else ""
    on = spec.customData.get("apiSchemaCanOnlyApplyTo")
    where = f" to {', '.join(f'`{name}`' for name in on)}" if on else ""
    return f"An API schema, applied{where}{several}."


def _type(spec: Sdf.PropertySpec) -> str:
    """Return type and default of a property."""
    if isinstance(spec, Sdf.RelationshipSpec):
        return "`rel`"
    uniform = "uniform " if spec.variability == Sdf.VariabilityUniform else ""
    default = "" if spec.default is None else f" = {_value(spec.default)}"
    return f"`{table_text(f'{uniform}{spec.typeName}{default}')}`"


def _value(value: object) -> str:
    """Return a default, nearly as it is written in a .usda file."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    return f'"{value}"' if isinstance(value, str) else f"{value}"


def _meaning(spec: Sdf.PropertySpec) -> str:
    """Return the text of the column "meaning" of a property, with its allowed values."""
    text = "<br>".join(table_text(part) for part in spec.documentation.split("\n\n"))
    allowed = getattr(spec, "allowedTokens", None)
    return f"{text}<br>One of {', '.join(f'`{each}`' for each in allowed)}." if allowed else text


def _paragraphs(text: str) -> str:
    """Return documentation as paragraphs of one line each."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def main(arguments: Sequence[str]) -> int:
    """Write the page, or with --check return 1 if the stored one differs."""
    return keep_page(TARGET, page(), arguments)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
