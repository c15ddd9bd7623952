"""Read parameters from a prim's attributes by name, so that USD need not know the schema.

Attributes without a value have the knob's default. Single-precision numbers are read as their
shortest decimal, so that a limit of 0.1 includes what USD stores for 0.1.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
from pxr import Sdf, Usd

from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.findings import Finding, finding
from usdsplat.core.knobs import Knob, knobs
from usdsplat.schema.values import value
from usdsplat.sim.parameters import (
    GROUPS,
    INSTANCED,
    MASK,
    NAMED,
    NAMESPACE,
    Parameters,
    camel,
    legal_value,
)

T = TypeVar("T")

RELATIONSHIPS = ("relax:surface", "conform:target", "skin:skeleton", "skin:mesh")
"""Relationships of a simulation, without the namespace."""
FRAME, REGION = "frame", "region"
"""Relationships of deformers and masks."""
NAMED_RELATIONSHIPS = {"deform": (FRAME,), "driver": (), "mask": (FRAME, REGION)}
"""Group whose instances have names -> their relationships, without the name."""
APIS = {"deform": "SplatDeformerAPI", "driver": "SplatDriverAPI", "mask": "SplatSimMaskAPI"}
"""Group whose instances have names -> their API schema."""
DOUBLE = (Sdf.ValueTypeNames.Double, Sdf.ValueTypeNames.TimeCode)


def read_all(prim: Usd.Prim, time: Usd.TimeCode) -> Parameters:
    """Return all groups of a SplatSim prim at one time.

    Raises:
        StageError: If a value is out of range.
    """
    return Parameters(
        **{name: read(prim, cls, f"{NAMESPACE}:{name}", time) for name, cls in GROUPS.items()}
    )


def read(prim: Usd.Prim, cls: type[T], lead: str, time: Usd.TimeCode) -> T:
    """Return one group of parameters at one time.

    Args:
        prim: Prim with the attributes.
        cls: The dataclass of the group.
        lead: Prefix of their names, such as "splatSim:rd".
        time: Time code; uniform ones have one value for all times.

    Raises:
        StageError: If a value is out of range.
    """
    taken = {}
    authored = set(prim.GetAuthoredPropertyNames())
    for item in knobs(cls) if authored else ():
        name = f"{lead}:{camel(item.name)}"
        found = read_one(prim, item, name, time) if name in authored else None
        if found is not None:
            taken[item.name] = found
    return cls(**taken)


def read_one(prim: Usd.Prim, item: Knob, name: str, time: Usd.TimeCode) -> Any:
    """Return the authored value of one parameter at one time; None where there is none.

    Args:
        prim: Prim with the attribute.
        item: Its knob.
        name: Name of the attribute.
        time: Time code; a uniform one has one value for all times.

    Raises:
        StageError: If the value is out of range.
    """
    attribute = prim.GetAttribute(name)
    if not attribute or not attribute.HasAuthoredValue():
        return None
    found = value(attribute, Usd.TimeCode.Default() if item.uniform else time)
    return None if found is None else _taken(attribute, item, found)


def instances(prim: Usd.Prim, group: str) -> list[str]:
    """Return the names of a prim's deformers, drivers or masks, sorted: those applied and those
    with attributes."""
    schema = APIS[group]
    applied = prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    names = {each.partition(":")[2] for each in applied if each.startswith(f"{schema}:")}
    lead = f"{NAMESPACE}:{group}:"
    for name in prim.GetAuthoredPropertyNames():
        if name.startswith(lead) and ":" in name[len(lead) :]:
            rest = unbound(group, name[len(lead) :])
            names.add(rest.rpartition(":")[0])
    return sorted(names)


def unbound(group: str, rest: str) -> str:
    """Return the name of a parameter, for that of the attribute that names its mask, whether it can
    take one or not; other names as they are.

    Args:
        group: Parameter group.
        rest: Name without the group, such as "bend:weight:mask" or "rate:mask".
    """
    before, _, last = rest.rpartition(":")
    instance, _, name = before.rpartition(":")
    if last != MASK or bool(instance) != (group in NAMED):
        return rest
    known = {camel(item.name) for item in knobs({**GROUPS, **INSTANCED}[group])}
    return before if name in known else rest


def unread(prim: Usd.Prim, groups: Iterable[str]) -> list[Finding]:
    """Return a finding on each property in our namespace that is unknown, with the name that may be
    meant, and on each uniform attribute with time samples.

    Args:
        prim: A simulation or an affector.
        groups: Parameter groups of such a prim.
    """
    known = _known(prim, groups)
    said = []
    for name in prim.GetAuthoredPropertyNames():
        if not name.startswith(f"{NAMESPACE}:"):
            continue
        where = f"{prim.GetPath()}.{name}"
        if name not in known and name.removesuffix(f":{MASK}") in known:
            found = f"a mask of {name.removesuffix(f':{MASK}').removeprefix(f'{NAMESPACE}:')}"
            said.append(finding("not-masked", where, found, "a mask of a parameter that takes one"))
        elif name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            meant = f"such as {near[0]}" if near else f"one of {NAMESPACE}:{{{','.join(groups)}}}:"
            said.append(finding("unknown-name", where, "an unknown property", meant))
        elif known[name] and prim.GetAttribute(name).GetNumTimeSamples():
            said.append(finding("unused", where, "samples over time", "one value for all times"))
    return said


def _known(prim: Usd.Prim, groups: Iterable[str]) -> dict[str, bool]:
    """Return the known names on a prim -> whether they are uniform attributes."""
    known = {}
    for group in groups:
        cls = {**GROUPS, **INSTANCED}[group]
        leads = [f"{NAMESPACE}:{group}"]
        if group in NAMED:
            leads = [f"{leads[0]}:{name}" for name in instances(prim, group)]
        for lead in leads:
            for item in knobs(cls):
                known[f"{lead}:{camel(item.name)}"] = item.uniform
                if item.takes_mask:
                    known[f"{lead}:{camel(item.name)}:{MASK}"] = True
            for name in NAMED_RELATIONSHIPS.get(group, ()):
                known[f"{lead}:{name}"] = False
    known.update(
        {f"{NAMESPACE}:{name}": False for name in RELATIONSHIPS if name.split(":")[0] in groups}
    )
    return known


def _taken(attribute: Usd.Attribute, item: Knob, found: Any) -> Any:
    """Convert a USD value to the knob's type."""
    is_double = attribute.GetTypeName().scalarType in DOUBLE
    plain = _plain(found, single=not is_double)
    try:
        return legal_value("", item, plain)
    except UsageError as error:
        where = f"{attribute.GetPrim().GetPath()}.{attribute.GetName()}"
        raise StageError(where, error.found, error.expected) from None


def _plain(found: Any, *, single: bool) -> Any:
    """Convert a USD value to plain Python."""
    if isinstance(found, (bool, int, str)) or found is None:
        return found
    if isinstance(found, Sdf.TimeCode):
        return float(found.GetValue())
    if isinstance(found, Sdf.AssetPath):
        return str(found.path)
    if isinstance(found, float):
        # str() depends on numpy.set_printoptions
        return float(np.format_float_scientific(np.float32(found))) if single else found
    try:
        return tuple(_plain(part, single=single) for part in found)
    except TypeError:
        return found
