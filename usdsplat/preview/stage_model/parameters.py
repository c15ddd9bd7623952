"""List and set the parameters of a stage's simulations and affectors, for panels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from pxr import Usd

from usdsplat.core.errors import StageError, UsageError, UsdSplatError
from usdsplat.core.knobs import Knob, knobs
from usdsplat.preview.knob_model import Editor, editor_of, kind_of, typed
from usdsplat.preview.stage_model.edits import Edits
from usdsplat.preview.stage_model.main_parameters import MAIN
from usdsplat.preview.stage_model.placing import code_of
from usdsplat.sim.parameters import (
    GROUPS,
    INSTANCED,
    MASK,
    NAMED,
    NAMESPACE,
    binding_of,
    camel,
)
from usdsplat.sim.stage.authoring import SINGLE_APIS, find
from usdsplat.sim.stage.collections import SIMULATION_TYPE, is_affector
from usdsplat.sim.stage.parameters import instances, read_one

_HEADINGS = {
    "sim": "Simulation",
    "neighbors": "Neighbours",
    "refine": "Refinement",
    "carriers": "Carriers",
    "rd": "Reaction",
    "relax": "Even spacing",
    "growth": "Growth",
    "accretion": "New matter",
    "settle": "Settling",
    "matter": "Matter",
    "conform": "Conforming",
    "skin": "Skinning",
    "particles": "Flight",
    "dissolve": "Dissolving",
    "appearance": "Appearance",
    "bake": "Bake",
    "affector": "Affector",
    "deform": "Deformer",
    "driver": "Driver",
    "mask": "Mask",
}
_ALWAYS = ("sim", "neighbors", "carriers")
"""Parameter groups that need no applied schema."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterPrim:
    """A prim with parameters."""

    path: str
    type_name: str
    """ "SplatSim", or the affector's shape."""
    is_simulation: bool
    editors: tuple[Editor, ...]
    """One per parameter, named as on the command line, such as "rd:patternScale"; of applied groups
    only."""


def editors(
    stage: Usd.Stage, *, time: float | None = None, paths: Iterable[str] | None = None
) -> tuple[ParameterPrim, ...]:
    """Return every simulation and affector of a stage, in stage order.

    An invalid value is shown as the default, with its `problem`. Prims in instances are read-only.

    Args:
        stage: The stage.
        time: Time code of animated parameters; None is USD's default time.
        paths: Prims to read, in any order; finding them among ten thousand prims takes a tenth of a
            second. Missing prims and prims without parameters are left out.
    """
    code = code_of(time)
    found = []
    prims: Iterable[Usd.Prim] = Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())
    if paths is not None:
        prims = filter(None, (stage.GetPrimAtPath(path) for path in paths))
    for prim in prims:
        is_simulation = prim.GetTypeName() == SIMULATION_TYPE
        if is_simulation or is_affector(prim):
            found.append(
                ParameterPrim(
                    path=str(prim.GetPath()),
                    type_name=str(prim.GetTypeName()),
                    is_simulation=is_simulation,
                    editors=tuple(_editors(prim, code)),
                )
            )
    return tuple(found)


def set_parameter(
    edits: Edits,
    path: str,
    name: str,
    value: Any,
    *,
    time: float | None = None,
    merge: str | None = None,
) -> None:
    """Set a parameter, even while its simulation runs.

    Args:
        edits: Edits of the stage.
        path: Path of the SplatSim prim or the affector.
        name: Name of the parameter, such as "rd:patternScale" or "deform:bend:angle".
        value: Value of its editor.
        time: Time code of a sample, added to the existing samples; None sets one value for all
            times, in place of any samples.
        merge: As for `Edits.step`.

    Raises:
        StageError: If there is no such prim, or no such deformer or driver on it.
        UsageError: If there is no such parameter, or the value is invalid.
    """
    group, instance, item = find(name)
    prim = edits.stage.GetPrimAtPath(path) if path.startswith("/") else None
    kind = "an affector" if group == "affector" else "a SplatSim prim"
    is_one = prim and (
        is_affector(prim) if group == "affector" else prim.GetTypeName() == SIMULATION_TYPE
    )
    if not is_one:
        raise StageError(path, "none" if not prim else "another prim", kind)
    known = instances(prim, group) if instance else []
    if instance and instance not in known:
        raise StageError(path, f"no {group} {instance!r}", f"one of {', '.join(known) or 'none'}")
    if time is not None and item.uniform:
        raise UsageError(name, f"a value at {time:g}", "one value for all times")
    edits.set_parameter(prim, name, typed(item, value), time=time, merge=merge)


def edit_parameter(
    edits: Edits, path: str, name: str, value: Any, *, now: float | None, merge: str | None = None
) -> None:
    """Set a parameter as a panel shows it: an animated one at the time of the view, which keeps
    its other samples, and any other one for all times.

    Args:
        edits, path, name, value, merge: As for `set_parameter`.
        now: Time code of the view; None is USD's default time.

    Raises:
        UsdSplatError: As for `set_parameter`.
    """
    _, _, item = find(name)
    prim = edits.stage.GetPrimAtPath(path) if path.startswith("/") else None
    attribute = prim.GetAttribute(f"{NAMESPACE}:{name}") if prim else None
    is_animated = attribute is not None and _is_animated(attribute, item)
    set_parameter(edits, path, name, value, time=now if is_animated else None, merge=merge)


def _is_animated(attribute: Usd.Attribute, item: Knob) -> bool:
    return bool(attribute) and not item.uniform and attribute.GetNumTimeSamples() > 0


def _editors(prim: Usd.Prim, code: Usd.TimeCode) -> Iterator[Editor]:
    """Yield the editors of all groups that are applied to a prim or have authored attributes."""
    if prim.GetTypeName() == SIMULATION_TYPE:
        for group, cls in GROUPS.items():
            if _has(prim, group):
                yield from _group(prim, cls, group, _HEADINGS[group], code)
        for group in NAMED:
            for name in instances(prim, group):
                heading = f"{_HEADINGS[group]} {name}"
                yield from _group(prim, INSTANCED[group], f"{group}:{name}", heading, code)
    if is_affector(prim):
        yield from _group(prim, INSTANCED["affector"], "affector", _HEADINGS["affector"], code)


def _has(prim: Usd.Prim, group: str) -> bool:
    """Return whether a group is applied to a simulation, or has authored attributes."""
    applied = prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    if group in _ALWAYS or SINGLE_APIS[group] in applied:
        return True
    lead = f"{NAMESPACE}:{group}:"
    return any(name.startswith(lead) for name in prim.GetAuthoredPropertyNames())


def _group(
    prim: Usd.Prim, cls: type, lead: str, heading: str, code: Usd.TimeCode
) -> Iterator[Editor]:
    main = MAIN[lead.partition(":")[0]]
    for item in knobs(cls):
        name = f"{lead}:{camel(item.name)}"
        if kind_of(item) is not None:
            made = _editor(prim, item, name, heading, code)
            yield replace(made, is_main=item.name in main or made.is_authored)
        if item.takes_mask and _has_masks(prim):
            yield _editor(prim, binding_of(item), f"{name}:{MASK}", heading, code)


def _has_masks(prim: Usd.Prim) -> bool:
    """Return whether a simulation has masks, or an affector may have the mask of one."""
    return prim.GetTypeName() != SIMULATION_TYPE or bool(instances(prim, "mask"))


def _editor(prim: Usd.Prim, item: Knob, name: str, heading: str, code: Usd.TimeCode) -> Editor:
    attribute = prim.GetAttribute(f"{NAMESPACE}:{name}")
    held, problem = item.default, ""
    try:
        found = read_one(prim, item, f"{NAMESPACE}:{name}", code)
        held = item.default if found is None else found
    except UsdSplatError as error:
        problem = str(error)
    return replace(
        editor_of(item, held, name=name, group=heading),
        is_animated=_is_animated(attribute, item),
        is_authored=bool(attribute) and attribute.HasAuthoredValue(),
        is_read_only=prim.IsInstanceProxy(),
        problem=problem,
    )
