"""Write schema/simulation.usda from the parameters: `python -m usdsplat.sim.schema_source`.

With --check it only compares. Parameters are declared once, in `sim.parameters`; their USD
declarations are derived here, in plain text. Then run `python -m usdsplat.schema.generate`, which
makes plugInfo/ from the schema folder.
"""

from __future__ import annotations

import argparse
import math
import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usdsplat.core.knobs import Knob, knobs
from usdsplat.sim.parameters import GROUPS, INSTANCED, NAMESPACE, binding_of, camel

TARGET = Path(__file__).resolve().parents[1] / "schema" / "simulation.usda"

USD_TYPES = {bool: "bool", int: "int", float: "float", str: "string"}
"""Python type of a knob -> Sdf type of its attribute, unless the knob names one; choices are
tokens."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SchemaClass:
    """One schema class: its documentation and the parameter groups it holds."""

    name: str
    doc: str
    groups: tuple[str, ...]
    relationships: tuple[tuple[str, str], ...] = ()
    """Name after the namespace -> documentation."""
    applies_to: tuple[str, ...] = ("SplatSim",)
    """Prim types that an API schema applies to."""


AFFECTOR_TYPES = ("Sphere", "Capsule", "Capsule_1", "Cube", "Plane", "Mesh", "Skeleton")

SIMULATION = SchemaClass(
    name="SplatSim",
    doc="A simulation of splat fields. It is run by 'usdsplat simulate', never by a renderer. Its "
    "result is a layer of opinions over the fields. The collection 'splats' contains the fields; "
    "if it is empty, all fields of the stage are simulated. The collection 'affectors' contains "
    "the prims that act on them; if it is empty, these are all prims with SplatAffectorAPI. The "
    "API schemas applied to this prim select what is simulated. Lengths are in units of the "
    "simulation's space.",
    groups=("sim", "neighbors", "carriers"),
)

SINGLE = (
    SchemaClass(
        name="SplatSimRefineAPI",
        doc="Refinement: splats that are too large for what happens to them are divided into "
        "children that look like them, before the first frame and where they are stretched. The "
        "refined capture is a layer of its own, between the capture and the results.",
        groups=("refine",),
    ),
    SchemaClass(
        name="SplatSimGrowthAPI",
        doc="A pattern on the splats, and growth, births and deaths that depend on it.",
        groups=("rd", "relax", "growth", "accretion"),
        relationships=(
            ("relax:surface", "Mesh that splats stay on while they are redistributed evenly."),
        ),
    ),
    SchemaClass(
        name="SplatSimSettleAPI",
        doc="Return of splats to their target positions after a push.",
        groups=("settle",),
    ),
    SchemaClass(
        name="SplatSimMatterAPI",
        doc="Cohesion of splats: they move as matter that bends, stretches, flows and tears.",
        groups=("matter",),
    ),
    SchemaClass(
        name="SplatSimConformAPI",
        doc="Motion of splats onto another shape.",
        groups=("conform",),
        relationships=(("conform:target", "Mesh that splats move onto; it may be animated."),),
    ),
    SchemaClass(
        name="SplatSimDeformAPI",
        doc="Skinning of splats by a skeleton. Deformers are instances of SplatDeformerAPI.",
        groups=("skin",),
        relationships=(
            ("skin:skeleton", "Skeleton that splats follow."),
            (
                "skin:mesh",
                "Mesh bound to the skeleton, from which splats take their joint weights, or "
                "whose triangles they follow. Without it the field itself must have the primvars "
                "skel:jointIndices and skel:jointWeights.",
            ),
        ),
    ),
    SchemaClass(
        name="SplatSimParticlesAPI",
        doc="Free flight of splats.",
        groups=("particles", "dissolve"),
    ),
    SchemaClass(
        name="SplatSimAppearanceAPI",
        doc="How shapes and colours of splats follow a deformation. Other changes of appearance "
        "are instances of SplatDriverAPI.",
        groups=("appearance",),
    ),
    SchemaClass(
        name="SplatSimBakeAPI",
        doc="Contents of the layer of results.",
        groups=("bake",),
    ),
    SchemaClass(
        name="SplatAffectorAPI",
        doc="A shape that acts on splats: it pushes them out, or changes the simulation inside and "
        "around it. Its visibility has no effect.",
        groups=("affector",),
        applies_to=AFFECTOR_TYPES,
    ),
)

MULTIPLE = (
    SchemaClass(
        name="SplatDeformerAPI",
        doc="A named deformer of a simulation's stack.",
        groups=("deform",),
        relationships=(
            ("frame", "Prim in whose space it acts; without it, the field's own space."),
        ),
    ),
    SchemaClass(
        name="SplatDriverAPI",
        doc="A named driver: controls an output by a value of the simulation.",
        groups=("driver",),
    ),
    SchemaClass(
        name="SplatSimMaskAPI",
        doc="A named mask: a number for each splat. It multiplies the parameters whose attribute "
        "'mask' names it, such as splatSim:growth:rate:mask.",
        groups=("mask",),
        relationships=(
            ("region", "Affectors of source affector, or curves of source curves."),
            (
                "frame",
                "Prim in whose space noise, axis, texture and volume lie; without it, the field's "
                "own space. The camera of projection camera.",
            ),
        ),
    ),
)

_HEADER = '''#usda 1.0
(
    """The simulation's schemas, generated from usdsplat/sim/parameters by
    `python -m usdsplat.sim.schema_source`; edit those instead."""
    subLayers = [
        @usd/schema.usda@
    ]
)
'''


def usd_type(item: Knob) -> str:
    """Return the Sdf value type name of a knob's attribute."""
    if item.usd_type is not None:
        return item.usd_type
    return "token" if item.choices is not None else USD_TYPES[item.type]


def spelled(text: str) -> str:
    """Return a text with parameter names in USD's spelling."""
    return re.sub(r"\b[a-z]+(?:_[a-z]+)+\b", lambda found: camel(found.group()), text)


def documentation(item: Knob) -> str:
    """Return the documentation of an attribute: meaning, unit and limits."""
    text = spelled(item.text)
    text = text[0].upper() + text[1:]
    limits = _limits(*item.range) if item.range else ""
    unit = f"[{item.unit}]" if item.unit else ""
    if limits:
        return f"{text}. Range: {' '.join(filter(None, (limits, unit)))}."
    return f"{text} {unit}." if unit and unit not in text else f"{text}."


def source() -> str:
    """Return the text of simulation.usda."""
    parts = [_HEADER]
    collections = '["CollectionAPI:splats", "CollectionAPI:affectors"]'
    parts.append(
        f'class {SIMULATION.name} "{SIMULATION.name}" (\n    inherits = </Typed>\n'
        f"    prepend apiSchemas = {collections}\n    {_doc(SIMULATION.doc)}\n)\n"
        + _body(SIMULATION, f"{NAMESPACE}:")
    )
    for each in SINGLE:
        parts.append(_api(each, "singleApply") + _body(each, f"{NAMESPACE}:"))
    for each in MULTIPLE:
        prefix = f"{NAMESPACE}:{each.groups[0]}"
        parts.append(_api(each, "multipleApply", prefix) + _body(each, ""))
    return "\n".join(parts)


def main(argv: Sequence[str] | None = None) -> int:
    """Write the file, or with --check compare it; status 1 if it is stale."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    check = parser.parse_args(argv).check
    text = source()
    if TARGET.is_file() and TARGET.read_text(encoding="utf-8") == text:
        return 0
    if not check:
        TARGET.write_text(text, encoding="utf-8")
    print(f"{TARGET}: {'stale' if check else 'written'}")
    return 1 if check else 0


def _limits(lower: float, upper: float) -> str:
    """Describe an interval, without open ends."""
    low, high = (f"{end:.10g}" for end in (lower, upper))
    if math.isinf(upper):
        return "" if math.isinf(lower) else f"{low} or more"
    return f"{high} or less" if math.isinf(lower) else f"{low} to {high}"


def _api(each: SchemaClass, kind: str, prefix: str = "") -> str:
    """Return the head of an API schema."""
    names = ", ".join(f'"{name}"' for name in each.applies_to)
    lines = [f'token apiSchemaType = "{kind}"']
    lines += [f'token propertyNamespacePrefix = "{prefix}"'] if prefix else []
    lines += _folded(f"token[] apiSchemaCanOnlyApplyTo = [{names}]")
    data = "".join(f"        {line}\n" for line in lines)
    return (
        f'class "{each.name}" (\n    inherits = </APISchemaBase>\n    {_doc(each.doc)}\n'
        f"    customData = {{\n{data}    }}\n)\n"
    )


def _body(each: SchemaClass, namespace: str) -> str:
    """Return the properties of a schema."""
    lines = []
    for group in each.groups:
        lead = f"{namespace}{group}:" if namespace else ""
        for item in knobs({**GROUPS, **INSTANCED}[group]):
            lines.append(_attribute(lead, item))
            if item.takes_mask:
                lines.append(_attribute(lead, binding_of(item)))
    for name, doc in each.relationships:
        lines.append(f"    rel {namespace}{name} (\n        {_doc(doc, 8)}\n    )\n")
    return "{\n" + "".join(lines) + "}\n"


def _attribute(lead: str, item: Knob) -> str:
    """Return the declaration of one knob."""
    uniform = "uniform " if item.uniform else ""
    name = f"{lead}{camel(item.name)}"
    line = f"    {uniform}{usd_type(item)} {name} = {_literal(item.default, usd_type(item))} (\n"
    lines = [line if len(line) <= 100 else line.replace(" = [", " = [\n        ")]
    if item.choices is not None:
        tokens = ", ".join(f'"{choice}"' for choice in item.choices)
        lines += [f"        {line}\n" for line in _folded(f"allowedTokens = [{tokens}]")]
    return "".join(lines) + f"        {_doc(documentation(item), 8)}\n    )\n"


def _doc(text: str, indent: int = 4) -> str:
    """Return documentation, folded."""
    lines = textwrap.wrap(f'doc = """{text}', 100 - indent - 3, break_long_words=False)
    return f"\n{' ' * indent}".join(lines) + '"""'


def _folded(text: str) -> Iterator[str]:
    """Return a list over as many lines as it needs."""
    for number, line in enumerate(textwrap.wrap(text, 84, break_on_hyphens=False)):
        yield line if number == 0 else f"    {line}"


def _literal(value: Any, type_name: str = "") -> str:
    """Return a value as a USD text file spells it."""
    if type_name == "asset":
        return f"@{value}@"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return f"{value:.9g}" if isinstance(value, float) else str(value)
    if isinstance(value, str):
        return f'"{value}"'
    inner = ", ".join(_literal(part) for part in value)
    is_array = not value or isinstance(value[0], tuple)
    return f"[{inner}]" if is_array else f"({inner})"


if __name__ == "__main__":
    raise SystemExit(main())
