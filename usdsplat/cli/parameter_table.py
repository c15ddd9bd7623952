"""The parameters of a simulation as a table, and as JSON."""

from __future__ import annotations

import math
import shutil
import textwrap
from typing import Any

from usdsplat.core.knobs import Knob, knobs
from usdsplat.sim.parameters import GROUPS, INSTANCED, camel

PLACES = {"deform": "deform:<name>", "driver": "driver:<name>"}
"""What stands before the name of a parameter of which there may be several."""


def rows() -> list[dict[str, Any]]:
    """One entry for each parameter: name, type, default, range, unit, uniform, text."""
    found = []
    for group, cls in (*GROUPS.items(), *INSTANCED.items()):
        for item in knobs(cls):
            found.append(
                {
                    "name": f"{PLACES.get(group, group)}:{camel(item.name)}",
                    "type": type_name(item),
                    "default": _plain(item.default),
                    "range": None if item.range is None else [_plain(x) for x in item.range],
                    "choices": None if item.choices is None else list(item.choices),
                    "unit": item.unit,
                    "uniform": item.uniform,
                    "text": item.text,
                }
            )
    return found


def show() -> None:
    """Print the table to stdout: a line with the numbers, then what it does."""
    width = max(min(shutil.get_terminal_size((100, 24)).columns, 120), 60)
    print(f"{'PARAMETER':<30} {'TYPE':<11} {'DEFAULT':<12} RANGE")
    for row in rows():
        limits = "" if row["range"] is None else f"{row['range'][0]} to {row['range'][1]}"
        numbers = " ".join(filter(None, (limits or "|".join(row["choices"] or ()), row["unit"])))
        kind = row["type"] + (" U" if row["uniform"] else "")
        line = f"{row['name']:<30} {kind:<11} {_shown(row['default']):<12} {numbers}"
        print(line.rstrip())
        print(textwrap.fill(row["text"], width, initial_indent="    ", subsequent_indent="    "))
    print("\nU: uniform, the same at all times; all others may be animated.")


def type_name(item: Knob) -> str:
    """The type as a user reads it."""
    if item.usd_type is not None:
        return item.usd_type
    if item.choices is not None:
        return "token"
    return {bool: "bool", int: "int", float: "float", str: "string"}.get(item.type, str(item.type))


def _plain(value: Any) -> Any:
    """A value that JSON can hold."""
    if isinstance(value, float) and math.isinf(value):
        return "inf" if value > 0 else "-inf"
    return int(value) if isinstance(value, float) and value == int(value) else value


def _shown(value: Any) -> str:
    """A default as it would be typed."""
    if isinstance(value, tuple):
        return ",".join(f"{part:g}" if isinstance(part, float) else str(part) for part in value)
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)
