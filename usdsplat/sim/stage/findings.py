"""Findings: authored properties of a simulation that are valid but have no effect."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pxr import Usd

from usdsplat.core.findings import Finding, finding
from usdsplat.schema.values import value
from usdsplat.sim.parameters import GROUPS, MASK, NAMED, NAMESPACE
from usdsplat.sim.stage import collections
from usdsplat.sim.stage.parameters import instances, unread

_PATTERN = ("u", "v", "vMinusU")
"""Sources of drivers that only a reaction provides."""


def findings(simulation: Usd.Prim, affectors: Iterable[Usd.Prim]) -> list[Finding]:
    """Return findings on unused properties of a SplatSim prim and its affectors, and on requests
    that cannot be met."""
    return [
        *unread(simulation, (*GROUPS, *NAMED)),
        *(each for prim in affectors for each in unread(prim, ("affector",))),
        *(
            finding(
                "unused",
                f"{simulation.GetPath()}.{name}",
                found,
                expected,
                cure=f"make it {expected}",
            )
            for name, found, expected in _findings(simulation)
        ),
    ]


def _findings(simulation: Usd.Prim) -> Iterator[tuple[str, str, str]]:
    """Yield (property, found, expected)."""
    stage = simulation.GetStage()
    for collection in (collections.SPLATS, collections.AFFECTORS):
        includes = f"collection:{collection}:includes"
        asked = simulation.GetRelationship(includes)
        for path in asked.GetForwardedTargets() if asked else ():
            if not stage.GetObjectAtPath(path):
                yield includes, f"{path}, which does not exist", "a prim"
    preset = value(simulation.GetAttribute(f"{NAMESPACE}:rd:preset"), Usd.TimeCode.Default())
    for name in ("rd:feed", "rd:kill"):
        if preset not in (None, "custom") and _ever(simulation, name):
            yield f"{NAMESPACE}:{name}", f"a value and rd:preset {preset}", "rd:preset custom"
    if not _ever(simulation, "rd:enabled"):
        for name in ("growth:rate", "growth:birthRate"):
            if _ever(simulation, name):
                yield f"{NAMESPACE}:{name}", "growth without a pattern", "splatSim:rd:enabled on"
        for name in instances(simulation, "driver"):
            source = simulation.GetAttribute(f"{NAMESPACE}:driver:{name}:source")
            if (value(source, Usd.TimeCode.Default()) or "v") in _PATTERN:
                where = f"{NAMESPACE}:driver:{name}:source"
                yield (
                    where,
                    "a driver without a pattern",
                    "splatSim:rd:enabled on, or another source",
                )
    yield from _mask_findings(simulation)
    target = simulation.GetRelationship(f"{NAMESPACE}:conform:target")
    has_target = bool(target and target.GetForwardedTargets())
    if has_target != _ever(simulation, "conform:weight"):
        found, expected = "0 and a target", "more than 0"
        if not has_target:
            found, expected = (
                "a weight and no target",
                "rel splatSim:conform:target to a mesh or capture",
            )
        yield f"{NAMESPACE}:conform:weight", found, expected
    mesh = simulation.GetRelationship(f"{NAMESPACE}:skin:mesh")
    skeleton = simulation.GetRelationship(f"{NAMESPACE}:skin:skeleton")
    if mesh and mesh.HasAuthoredTargets() and not (skeleton and skeleton.HasAuthoredTargets()):
        where = f"{NAMESPACE}:skin:skeleton"
        yield where, "none, and a mesh to take it from", "the skeleton that the mesh is bound to"


def _mask_findings(simulation: Usd.Prim) -> Iterator[tuple[str, str, str]]:
    """Yield (property, found, expected) about masks that have no effect."""
    now = Usd.TimeCode.Default()
    reacts = _ever(simulation, "rd:enabled")
    bound = simulation.GetAttribute(f"{NAMESPACE}:dissolve:by:{MASK}")
    by = value(simulation.GetAttribute(f"{NAMESPACE}:dissolve:by"), now)
    if bound and value(bound, now) and by != "mask":
        yield f"{NAMESPACE}:dissolve:by:{MASK}", "a mask and another order", "dissolve:by mask"
    for name in instances(simulation, "mask"):
        lead = f"{NAMESPACE}:mask:{name}"
        source = value(simulation.GetAttribute(f"{lead}:source"), now)
        if source in _PATTERN and not reacts:
            yield f"{lead}:source", "a mask without a pattern", "splatSim:rd:enabled on"


def _ever(simulation: Usd.Prim, name: str) -> bool:
    """Return whether a parameter that is 0 or off by default has another value at any time."""
    attribute = simulation.GetAttribute(f"{NAMESPACE}:{name}")
    if not attribute or not attribute.HasAuthoredValue():
        return False
    if attribute.ValueMightBeTimeVarying():
        return True
    return bool(value(attribute, Usd.TimeCode.Default()))
