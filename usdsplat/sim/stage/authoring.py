"""Write parameters on prims, by the names that command lines and the schema use for them."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from typing import Any

from pxr import Gf, Sdf, Usd

from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import Knob, knobs
from usdsplat.sim.parameters import GROUPS, INSTANCED, NAMESPACE, camel, legal
from usdsplat.sim.schema_source import MULTIPLE, SINGLE, usd_type

SINGLE_APIS = {group: each.name for each in SINGLE for group in each.groups}
"""Group -> the API schema that has it; `sim` and `neighbors` are the type's own."""
MULTIPLE_APIS = {group: each.name for each in MULTIPLE for group in each.groups}


def author(prim: Usd.Prim, values: Mapping[str, Any], *, time: float | None = None) -> None:
    """Write parameters, and apply the API schemas that they belong to, on the edit target.

    Args:
        prim: A SplatSim prim, or an affector.
        values: Name after the namespace, such as "rd:patternScale" or "deform:bend:angle" -> value.
        time: Time code of a sample; None writes default values.

    Raises:
        UsageError: If a name is no parameter's, a value is none that it can have, or one that
            holds for all times is to be a sample.
    """
    for name, value in values.items():
        group, _, item = find(name)
        taken = _legal(name, group, item, value)
        if time is not None and item.uniform:
            raise UsageError(name, f"a value at {time:g}", "one value for all times")
        attribute = declare(prim, name)
        code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
        attribute.Set(_of_usd(item, taken), code)


def declare(prim: Usd.Prim, name: str) -> Usd.Attribute:
    """The attribute of a parameter, without a value, and the API schema that it belongs to, on the
    edit target.

    Raises:
        UsageError: If there is none of that name.
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
    """Name the one prim that a relationship such as "conform:target" is to lead to."""
    group, _, rest = name.partition(":")
    _apply(prim, group, rest.rpartition(":")[0])
    prim.CreateRelationship(f"{NAMESPACE}:{name}", custom=False).SetTargets([target.GetPath()])


def find(name: str) -> tuple[str, str, Knob]:
    """Group, instance and knob of a parameter.

    Raises:
        UsageError: If there is none of that name.
    """
    group, _, rest = name.partition(":")
    instance, _, last = rest.rpartition(":")
    if (group in MULTIPLE_APIS) == bool(instance):
        for item in knobs(_class(group)) if group in {**GROUPS, **INSTANCED} else ():
            if camel(item.name) == last:
                return group, instance, item
    near = difflib.get_close_matches(name, list(_names(instance or "NAME")), n=1, cutoff=0.5)
    expected = f"such as {near[0]}" if near else f"a name in {', '.join(GROUPS)}"
    raise UsageError("parameter", repr(name), expected)


def usd_value(name: str, value: Any) -> Any:
    """A value of a parameter as USD takes it.

    Raises:
        UsageError: If there is none of that name, or it cannot have that value.
    """
    group, _, item = find(name)
    return _of_usd(item, _legal(name, group, item, value))


def _names(instance: str) -> Iterator[str]:
    """Every name that there is."""
    for group, cls in {**GROUPS, **INSTANCED}.items():
        lead = f"{group}:{instance}:" if group in MULTIPLE_APIS else f"{group}:"
        yield from (f"{lead}{camel(item.name)}" for item in knobs(cls))


def _legal(name: str, group: str, item: Knob, value: Any) -> Any:
    """A value as its knob's type, refused by the name that the user knows."""
    try:
        return getattr(legal("", _class(group), {item.name: value}), item.name)
    except UsageError as error:
        raise UsageError(name, error.found, error.expected) from None


def _class(group: str) -> type:
    return {**GROUPS, **INSTANCED}[group]


def _apply(prim: Usd.Prim, group: str, instance: str) -> None:
    """Apply the schema that a group belongs to; USD need not know it."""
    name = SINGLE_APIS.get(group) or MULTIPLE_APIS.get(group)
    if name is None:
        return
    name = f"{name}:{instance}" if instance else name
    if name not in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
        prim.AddAppliedSchema(name)


def _of_usd(item: Knob, value: Any) -> Any:
    """A checked value as USD takes it."""
    if item.usd_type == "int3":
        return Gf.Vec3i(*value)
    if item.usd_type == "timecode":
        return Sdf.TimeCode(value)
    return list(value) if (item.usd_type or "").endswith("[]") else value
