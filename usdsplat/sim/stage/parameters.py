"""Parameters as a prim has them, by the names of its attributes: the schema need not be known.

What a prim does not author has the knob's default. Real numbers of single precision are taken for
the shortest decimal that they can mean: a limit of 0.1 is met by what USD stores of it.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
from pxr import Sdf, Usd

from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.knobs import Knob, knobs
from usdsplat.schema.values import value
from usdsplat.sim.parameters import GROUPS, INSTANCED, NAMESPACE, Parameters, camel, legal_value

T = TypeVar("T")

RELATIONSHIPS = ("relax:surface", "conform:target", "skin:skeleton", "skin:mesh")
"""Those of a simulation, after the namespace."""
FRAME = "frame"
"""The relationship of a deformer."""
DOUBLE = (Sdf.ValueTypeNames.Double, Sdf.ValueTypeNames.TimeCode)


def read_all(prim: Usd.Prim, time: Usd.TimeCode) -> Parameters:
    """All groups of a SplatSim prim at one time.

    Raises:
        StageError: If a value is none that its parameter can have.
    """
    return Parameters(
        **{name: read(prim, cls, f"{NAMESPACE}:{name}", time) for name, cls in GROUPS.items()}
    )


def read(prim: Usd.Prim, cls: type[T], lead: str, time: Usd.TimeCode) -> T:
    """One group of parameters at one time.

    Args:
        prim: Where they are.
        cls: The dataclass of the group.
        lead: What their names begin with, such as "splatSim:rd".
        time: When; uniform ones have one value for all times.

    Raises:
        StageError: If a value is none that its parameter can have.
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
    """What a prim says of one parameter at one time; None where it says nothing.

    Args:
        prim: Where it is.
        item: Its knob.
        name: Of the attribute.
        time: When; a uniform one has one value for all times.

    Raises:
        StageError: If it is no value that the parameter can have.
    """
    attribute = prim.GetAttribute(name)
    if not attribute or not attribute.HasAuthoredValue():
        return None
    found = value(attribute, Usd.TimeCode.Default() if item.uniform else time)
    return None if found is None else _taken(attribute, item, found)


def instances(prim: Usd.Prim, group: str) -> list[str]:
    """Names of a prim's deformers or drivers, sorted: those applied and those with attributes."""
    schema = {"deform": "SplatDeformerAPI", "driver": "SplatDriverAPI"}[group]
    applied = prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    names = {each.partition(":")[2] for each in applied if each.startswith(f"{schema}:")}
    lead = f"{NAMESPACE}:{group}:"
    for name in prim.GetAuthoredPropertyNames():
        if name.startswith(lead) and ":" in name[len(lead) :]:
            names.add(name[len(lead) :].rpartition(":")[0])
    return sorted(names)


def unread(prim: Usd.Prim, groups: Iterable[str]) -> list[StageError]:
    """Each property of ours that nobody reads, with the name it may be meant for; and samples over
    time of what holds for all times.

    Args:
        prim: A simulation or an affector.
        groups: Those that such a prim has.
    """
    known = _known(prim, groups)
    said = []
    for name in prim.GetAuthoredPropertyNames():
        if not name.startswith(f"{NAMESPACE}:"):
            continue
        where = f"{prim.GetPath()}.{name}"
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            meant = f"such as {near[0]}" if near else f"one of {NAMESPACE}:{{{','.join(groups)}}}:"
            said.append(StageError(where, "a property that nobody reads", meant))
        elif known[name] and prim.GetAttribute(name).GetNumTimeSamples():
            said.append(StageError(where, "samples over time", "one value for all times"))
    return said


def _known(prim: Usd.Prim, groups: Iterable[str]) -> dict[str, bool]:
    """Names that count on a prim -> whether they are uniform attributes."""
    known = {}
    for group in groups:
        cls = {**GROUPS, **INSTANCED}[group]
        leads = [f"{NAMESPACE}:{group}"]
        if group in ("deform", "driver"):
            leads = [f"{leads[0]}:{name}" for name in instances(prim, group)]
        for lead in leads:
            known.update({f"{lead}:{camel(item.name)}": item.uniform for item in knobs(cls)})
            if group == "deform":
                known[f"{lead}:{FRAME}"] = False
    known.update(
        {f"{NAMESPACE}:{name}": False for name in RELATIONSHIPS if name.split(":")[0] in groups}
    )
    return known


def _taken(attribute: Usd.Attribute, item: Knob, found: Any) -> Any:
    """A value of USD's as the knob's."""
    is_double = attribute.GetTypeName().scalarType in DOUBLE
    plain = _plain(found, single=not is_double)
    try:
        return legal_value("", item, plain)
    except UsageError as error:
        where = f"{attribute.GetPrim().GetPath()}.{attribute.GetName()}"
        raise StageError(where, error.found, error.expected) from None


def _plain(found: Any, *, single: bool) -> Any:
    """What USD holds in Python's own words."""
    if isinstance(found, (bool, int, str)) or found is None:
        return found
    if isinstance(found, Sdf.TimeCode):
        return float(found.GetValue())
    if isinstance(found, float):
        # Not by str(), which is anybody's to change: see numpy.set_printoptions.
        return float(np.format_float_scientific(np.float32(found))) if single else found
    try:
        return tuple(_plain(part, single=single) for part in found)
    except TypeError:
        return found
