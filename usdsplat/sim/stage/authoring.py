"""Author parameters on prims, by the names of command line and schema."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from typing import Any

from pxr import Gf, Sdf, Usd

from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import Knob, knobs
from usdsplat.sim.parameters import (
    GROUPS,
    INSTANCED,
    NAMESPACE,
    binding_of,
    camel,
    legal_value,
)
from usdsplat.sim.schema_source import MULTIPLE, SINGLE, usd_type
from usdsplat.sim.stage.parameters import unbound

SINGLE_APIS = {group: each.name for each in SINGLE for group in each.groups}
"""Group -> the API schema that has it; `sim` and `neighbors` belong to the type itself."""
MULTIPLE_APIS = {group: each.name for each in MULTIPLE for group in each.groups}


def author(prim: Usd.Prim, values: Mapping[str, Any], *, time: float | None = None) -> None:
    """Author parameters, and apply their API schemas, on the edit target.

    Args:
        prim: A SplatSim prim, or an affector.
        values: Value by name without the namespace, such as "rd:patternScale" or
            "deform:bend:angle".
        time: Time code of a sample; None writes default values.

    Raises:
        UsageError: If a name is unknown, a value is out of range, or a uniform parameter gets a
            sample.
    """
    for name, value in values.items():
        _, _, item = find(name)
        taken = legal_value(name, item, value)
        if time is not None and item.uniform:
            raise UsageError(name, f"a value at {time:g}", "one value for all times")
        attribute = declare(prim, name)
        code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
        attribute.Set(_of_usd(item, taken), code)


def declare(prim: Usd.Prim, name: str) -> Usd.Attribute:
    """Create the attribute of a parameter without a value, and apply its API schema, on the edit
    target.

    Raises:
        UsageError: If there is no such parameter.
    """
    group, instance, item = find(name)
    _apply(prim, group, instance)
    return prim.CreateAttribute(
        f"{NAMESPACE}:{name}",
        Sdf.ValueTypeNames.Find(usd_type(item)),
        custom=False,
        variability=Sdf.VariabilityUniform if item.uniform else Sdf.VariabilityVarying,
    )


def relate(prim: Usd.Prim, name: str, target: Usd.Prim) -> None:
    """Set the target of a relationship such as "conform:target"."""
    group, _, rest = name.partition(":")
    _apply(prim, group, rest.rpartition(":")[0])
    prim.CreateRelationship(f"{NAMESPACE}:{name}", custom=False).SetTargets([target.GetPath()])


def find(name: str) -> tuple[str, str, Knob]:
    """Return group, instance and knob of a parameter, or of the mask of a parameter.

    Raises:
        UsageError: If there is no such parameter.
    """
    group, _, rest = name.partition(":")
    known = {**GROUPS, **INSTANCED}
    bound = unbound(group, rest) if group in known else rest
    instance, _, last = bound.rpartition(":")
    if (group in MULTIPLE_APIS) == bool(instance):
        for item in knobs(known[group]) if group in known else ():
            if camel(item.name) == last:
                if bound == rest:
                    return group, instance, item
                if item.takes_mask:
                    return group, instance, binding_of(item)
                expected = "a parameter that takes one, M in --list-parameters"
                raise UsageError("parameter", f"a mask of {group}:{bound}", expected)
    near = difflib.get_close_matches(name, list(_names(instance or "NAME")), n=1, cutoff=0.5)
    expected = f"such as {near[0]}" if near else f"a name in {', '.join(GROUPS)}"
    raise UsageError("parameter", repr(name), expected)


def usd_value(name: str, value: Any) -> Any:
    """Convert a value of a parameter to USD.

    Raises:
        UsageError: If there is no such parameter, or the value is out of range.
    """
    _, _, item = find(name)
    return _of_usd(item, legal_value(name, item, value))


def _names(instance: str) -> Iterator[str]:
    """Return the names of all parameters."""
    for group, cls in {**GROUPS, **INSTANCED}.items():
        lead = f"{group}:{instance}:" if group in MULTIPLE_APIS else f"{group}:"
        yield from (f"{lead}{camel(item.name)}" for item in knobs(cls))


def _apply(prim: Usd.Prim, group: str, instance: str) -> None:
    """Apply the schema of a group, even if USD does not know it."""
    name = SINGLE_APIS.get(group) or MULTIPLE_APIS.get(group)
    if name is None:
        return
    name = f"{name}:{instance}" if instance else name
    if name not in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
        prim.AddAppliedSchema(name)


def _of_usd(item: Knob, value: Any) -> Any:
    """Convert a checked value to USD."""
    if item.usd_type == "int3":
        return Gf.Vec3i(*value)
    if item.usd_type == "timecode":
        return Sdf.TimeCode(value)
    if item.usd_type == "asset":
        return Sdf.AssetPath(value)
    return list(value) if (item.usd_type or "").endswith("[]") else value
