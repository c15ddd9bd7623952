"""Author values from a command line on a stage's session layer."""

from __future__ import annotations

import re
from typing import Any, get_args, get_origin

from pxr import Sdf, Usd

from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.knobs import Knob
from usdsplat.sim.stage.authoring import author, find
from usdsplat.sim.stage.collections import find_simulations, is_affector
from usdsplat.sim.stage.parameters import instances

_ASSIGNMENT = re.compile(r"(?:(/[^.=]+)\.)?([A-Za-z]\w*(?::\w+)+)=(.*)")
_BOOLS = {"1": True, "true": True, "on": True, "0": False, "false": False, "off": False}


def override(
    stage: Usd.Stage, text: str, *, layer: Sdf.Layer | None = None, where: str = "--set"
) -> None:
    """Author one value for all times.

    Args:
        stage: None of its files is saved.
        text: `[/PRIM.]group:name=value`. Without a prim it applies to every SplatSim prim, or for
            `affector:name` to every affector; deformers and drivers are `deform:<name>:angle=90`.
        layer: Layer of the stage; None is its session layer.
        where: The flag, for messages.

    Raises:
        UsageError: If it cannot be parsed, or the parameter cannot have that value.
        StageError: If the stage has no prim that it applies to.
    """
    match = _ASSIGNMENT.fullmatch(text.strip())
    if not match:
        raise UsageError(where, repr(text), "[/PRIM.]group:name=value, such as rd:preset=coral")
    path, name, typed = match.groups()
    group, instance, item = find(name)
    value = _value(item, typed, f"{where} {text}")
    prims = _prims(stage, path, group, where)
    for prim in prims:
        known = instances(prim, group) if instance else []
        if instance and instance not in known:
            found = f"no {group} {instance!r}"
            raise StageError(str(prim.GetPath()), found, f"one of {', '.join(known) or 'none'}")
    with Usd.EditContext(stage, layer or stage.GetSessionLayer()):
        for prim in prims:
            author(prim, {name: value})


def _value(item: Knob, typed: str, where: str) -> Any:
    """Parse a value as the parameter's type."""
    try:
        return _parsed(item.type, typed)
    except (KeyError, ValueError):
        raise UsageError(where, repr(typed), item.expected) from None


def _parsed(kind: Any, typed: str) -> Any:
    if get_origin(kind) is tuple:
        first = get_args(kind)[0]
        parts = [part for part in typed.split(",") if part]
        if get_origin(first) is tuple:  # numbers of all vectors, one after another
            size = len(get_args(first))
            rows = range(0, len(parts), size)
            return tuple(_parsed(first, ",".join(parts[row : row + size])) for row in rows)
        return tuple(_parsed(first, part) for part in parts)
    if kind is bool:
        return _BOOLS[typed.lower()]
    return kind(typed) if kind in (int, float) else typed


def _prims(stage: Usd.Stage, path: str | None, group: str, where: str) -> list[Usd.Prim]:
    """Return the prims that an override applies to."""
    is_about_affectors = group == "affector"
    found = find_simulations(stage)
    if is_about_affectors:
        found = [prim for prim in stage.Traverse() if is_affector(prim)]
    if path is not None:
        found = [prim for prim in found if str(prim.GetPath()) == path]
    if not found:
        kind = "affector" if is_about_affectors else "SplatSim prim"
        raise StageError(where, f"no {kind} {path or ''}".rstrip(), "one on the stage")
    return found
