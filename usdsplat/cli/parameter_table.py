"""Print the parameters of a simulation as a table, or return them for JSON."""

from __future__ import annotations

import inspect
import math
import shutil
import textwrap
from typing import Any

from usdsplat.cli import console
from usdsplat.core.knobs import Knob, knobs
from usdsplat.sim.parameters import GROUPS, INSTANCED, NAMED, camel
from usdsplat.sim.schema_source import MULTIPLE, SIMULATION, SINGLE, spelled

PLACES = {group: f"{group}:<name>" for group in NAMED}
"""Group -> prefix of the parameters of a schema that can be applied several times."""
COLLECTIONS = (
    (
        "collection:splats:includes",
        "rel",
        "the splat fields that are simulated; default: all of the stage",
    ),
    (
        "collection:affectors:includes",
        "rel",
        "the affectors that act on them; default: all of the stage",
    ),
    (
        "primvars:splatSim:weight",
        "float[]",
        "selection of each splat, 0 to 1, a primvar of the field: it multiplies settling, growth, "
        "births and conforming; affectors do not push splats of weight 0, and those below one "
        "half neither dissolve nor are seeded by seedMode selection",
    ),
)
"""Name, type and meaning of what else a simulation reads."""


def rows() -> list[dict[str, Any]]:
    """Return one entry for each parameter and relationship: name, group, type, default, range,
    unit, uniform, mask, text."""
    return [row for group in {**GROUPS, **INSTANCED} for row in _rows(group)]


def show() -> None:
    """Print the table to stdout by groups: for each parameter a line with its values, then its
    meaning."""
    width = max(min(shutil.get_terminal_size((100, 24)).columns, 120), 60)
    console.say(f"{'PARAMETER':<30} {'TYPE':<11} {'DEFAULT':<12} RANGE")
    for group, cls in {**GROUPS, **INSTANCED}.items():
        title = " ".join((inspect.getdoc(cls) or "").split())
        (schema,) = (each.name for each in (SIMULATION, *SINGLE, *MULTIPLE) if group in each.groups)
        console.say("\n" + textwrap.fill(f"{group.upper()}, of {schema}: {title}", width))
        for row in _rows(group):
            _show(row, width)
    console.say(
        "\nU: uniform, the same at all times; other parameters may be animated. M: takes a mask, a "
        "number for\neach splat that multiplies it: splatSim:PARAMETER:mask names an instance of "
        "SplatSimMaskAPI. On the\nstage, a parameter is the attribute splatSim:PARAMETER of the "
        "SplatSim prim, or of the affector."
    )


def type_name(item: Knob) -> str:
    """Return the type of a parameter as USD names it."""
    if item.usd_type is not None:
        return item.usd_type
    if item.choices is not None:
        return "token"
    return {bool: "bool", int: "int", float: "float", str: "string"}.get(item.type, str(item.type))


def _rows(group: str) -> list[dict[str, Any]]:
    """Return the entries of a group."""
    lead = PLACES.get(group, group)
    found = [_row(group, lead, item) for item in knobs({**GROUPS, **INSTANCED}[group])]
    others = [*COLLECTIONS] if group == "sim" else []
    for each in (SIMULATION, *SINGLE, *MULTIPLE):
        if group in each.groups:
            for name, text in each.relationships:
                own = f"{lead}:{name}" if each in MULTIPLE else name
                if own.startswith(f"{lead}:"):
                    others.append((own, "rel", text[0].lower() + text[1:].rstrip(".")))
    nothing = {**dict.fromkeys(("default", "range", "choices")), "mask": False}
    for name, kind, text in others:
        about = {"name": name, "group": group, "type": kind, "unit": "", "uniform": True}
        found.append({**about, **nothing, "text": text})
    return found


def _row(group: str, lead: str, item: Knob) -> dict[str, Any]:
    """Return the entry of one parameter."""
    return {
        "name": f"{lead}:{camel(item.name)}",
        "group": group,
        "type": type_name(item),
        "default": _plain(item.default),
        "range": None if item.range is None else [_plain(x) for x in item.range],
        "choices": None if item.choices is None else list(item.choices),
        "unit": item.unit,
        "uniform": item.uniform,
        "mask": item.takes_mask,
        "text": spelled(item.text),
    }


def _show(row: dict[str, Any], width: int) -> None:
    """Print the lines of an entry."""
    limits = "" if row["range"] is None else f"{row['range'][0]} to {row['range'][1]}"
    numbers = " ".join(filter(None, (limits or "|".join(row["choices"] or ()), row["unit"])))
    is_other = row["default"] is None  # a relationship, or a primvar
    marks = "" if is_other else " U" * row["uniform"] + " M" * row["mask"]
    kind = row["type"] + marks
    default = "" if is_other else _shown(row["default"])
    console.say(f"{row['name']:<30} {kind:<11} {default:<12} {numbers}".rstrip())
    console.say(textwrap.fill(row["text"], width, initial_indent="    ", subsequent_indent="    "))


def _plain(value: Any) -> Any:
    """Return a value that JSON can hold."""
    if isinstance(value, float) and math.isinf(value):
        return "inf" if value > 0 else "-inf"
    return int(value) if isinstance(value, float) and value == int(value) else value


def _shown(value: Any) -> str:
    """Return a default value as it is written on the command line."""
    if isinstance(value, tuple):
        return ",".join(f"{part:g}" if isinstance(part, float) else str(part) for part in value)
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)
