"""Findings about values and captures that a simulation cannot follow, and what it does instead."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from usdsplat.core.findings import Finding, finding
from usdsplat.core.wording import counted
from usdsplat.sim import styles
from usdsplat.sim.accretion import Accretion
from usdsplat.sim.carriers import Carriers
from usdsplat.sim.specs import Affector, Moment, Recipe, Surface
from usdsplat.sim.uses import Uses

LONG = 0.25
"""Duration from which steps are long: what swings within a second is no longer followed [s]."""
VAST = 1000.0
"""Size of an affector, in sizes of the capture, from which it is taken for a mistake."""


def has_area(surface: Surface) -> bool:
    """Return whether a mesh has a triangle with an area."""
    corners = surface.points[surface.triangles].astype(np.float64)
    with np.errstate(all="ignore"):
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return bool((np.abs(across) > 0).any())


def limit_findings(
    recipe: Recipe, uses: Uses, first: Moment, carriers: Carriers | None
) -> Iterator[Finding]:
    """Yield what a field's simulation does otherwise than asked; paths are those of properties.

    Args:
        recipe: The field.
        uses: What its simulation needs.
        first: Values of the stage at the first frame.
        carriers: Its carriers, of which there may be none.
    """
    p = first.parameters
    if carriers is not None and not len(carriers):
        found = f"{counted(len(recipe.rest), 'splat')} without a surface to put carriers on"
        if uses.coheres:
            expected = "a capture of surfaces; its splats move alone, without matter"
            yield finding("no-carriers", "splatSim:matter:enabled", found, expected)
        if uses.transports or first.becomes is not None:
            expected = "a capture of surfaces; its splats move to the closest points of a mesh"
            if first.becomes is not None:
                expected = "a capture of surfaces; its splats do not become another one"
            yield finding("no-carriers", "splatSim:conform:mode", found, expected)
        if uses.accretes and p.rd.domain == "carrier":
            expected = "a capture of surfaces; nothing grows"
            yield finding("no-carriers", "splatSim:accretion:enabled", found, expected)
    motif = styles.resolved(p.accretion).motif
    if uses.accretes and motif != "pattern" and not p.rd.front_speed > 0:
        found = f"{motif} and no front, rd:frontSpeed {p.rd.front_speed:g}"
        expected = "a positive rd:frontSpeed"
        cure = f"make it {expected}; matter grows where the pattern is, without the motif"
        yield finding("unused", "splatSim:accretion:motif", found, expected, cure=cure)
    if uses.accretes and p.rd.domain != "carrier":
        found, expected = f"new matter and rd:domain {p.rd.domain}", "rd:domain carrier"
        cure = f"make it {expected}; nothing grows"
        yield finding("unused", "splatSim:accretion:enabled", found, expected, cure=cure)
    if first.target is not None and uses.transports and not has_area(first.target):
        expected = "triangles with an area; splats move to the closest points"
        yield finding("flat-target", "splatSim:conform:target", "a mesh without area", expected)
    if uses.coheres and p.matter.material == "custom" and p.matter.tear < p.matter.stretch:
        found = f"{p.matter.tear:g}, and a stretch limit of {p.matter.stretch:g}"
        expected = "more than matter:stretch; edges tear before they reach the limit"
        yield finding("weak-matter", "splatSim:matter:tear", found, expected)
    dt = 1.0 / (recipe.codes_per_second * p.sim.substeps)
    if dt > LONG:
        expected = f"at most {LONG:g} s: more substeps, or more time codes a second"
        yield finding("long-steps", "splatSim:sim:substeps", f"steps of {dt:g} s", expected)
    size = _size(recipe.rest.positions)
    for each in first.affectors:
        pushes = each.parameters.enabled and each.parameters.role == "collide"
        extent = _largest(each) if pushes else 0.0
        if size > 0 and extent > VAST * size:
            found = f"{each.path}, of {extent:g}, and a capture of {size:g}"
            expected = f"affectors of at most {VAST:g} times its size; splats are moved that far"
            yield finding("vast-affector", "collection:affectors:includes", found, expected)


def room(accretion: Accretion, first: Moment, here: int) -> Iterator[Finding]:
    """Yield a finding if new matter would not have room on all carriers that it may grow on.

    Args:
        accretion: New matter of a field.
        first: Values of the stage at the first frame.
        here: Number of splats without new matter.
    """
    knobs, most = styles.resolved(first.parameters.accretion), first.parameters.sim.max_count
    layers, places = knobs.layers, int((accretion.allowed(knobs) > 0).sum())
    room = max(0, most - here) // layers
    if room >= places:
        return
    found = f"{most:,}, with {counted(here, 'splat')} before growth"
    expected = f"{here + layers * places:,} for all new matter; growth ends before"
    if not room:
        expected = f"up to {here + layers * places:,} for new matter; nothing grows"
    severity: Literal["warning", "note"] = "note" if room else "warning"
    yield finding("no-room", "splatSim:sim:maxCount", found, expected, severity=severity)


def _size(points: np.ndarray) -> float:
    """Return the diagonal of the box around points that are finite [unit]."""
    sound = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    return float(np.linalg.norm(np.ptp(sound, axis=0))) if len(sound) else 0.0


def _largest(affector: Affector) -> float:
    """Return the largest size of an affector's bodies but planes and meshes [unit]."""
    return max((max(map(abs, each.size)) for each in affector.solids), default=0.0)
