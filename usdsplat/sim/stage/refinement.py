"""Refine the captures of a stage's simulations, before their first frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

from pxr import Sdf, Usd

from usdsplat.core.findings import Finding, finding
from usdsplat.core.wording import counted
from usdsplat.kernels.device import Device
from usdsplat.sim.parameters import NAMESPACE, Parameters
from usdsplat.sim.refining import GROWTH, oversized, refined, spacing_of
from usdsplat.sim.stage import refined_layer
from usdsplat.sim.stage.recipe import StageRecipe
from usdsplat.sim.stage.twins import over_captures
from usdsplat.sim.uses import Uses

MAX_SIZE = 2.0
"""Automatic `refine:maxSize`: a pattern repeats after 10 to 15 spacings."""

Composes = Callable[[Usd.Stage, Sdf.Layer], Usd.Stage]
"""Returns a stage with one more layer, between its captures and stronger opinions."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Refining:
    """How the captures of a simulation are refined."""

    compose: Composes = over_captures
    """Adds the layer of refined captures."""
    known: Sdf.Layer | None = None
    """The layer of a bake that is resumed; None refines the captures anew."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Refinement:
    """Refined captures."""

    layer: Sdf.Layer | None = None
    """Their layer; None if no splat was divided."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Largest standard deviation [unit] of each field that is refined, by its path."""
    findings: tuple[Finding, ...] = ()

    def facts(self, path: str) -> Mapping[str, float]:
        """Return what is known about the refinement of a field, with the names of a record."""
        found = dict(refined_layer.records(self.layer).get(path, {})) if self.layer else {}
        limit = self.limits.get(path, math.inf)
        return {**found, "refineSize": limit} if math.isfinite(limit) else found


def refine(
    stage: Usd.Stage,
    recipes: Mapping[str, StageRecipe],
    uses: Mapping[str, Uses],
    *,
    device: Device,
    known: Sdf.Layer | None = None,
    reading: AbstractContextManager[Any],
) -> Refinement:
    """Divide the large splats of all fields that ask for it.

    Args:
        stage: The stage; it is not changed.
        recipes, uses: The fields, and what their simulations need.
        device: Runs the kernels.
        known: As in `Refining`.
        reading: Entered whenever the stage is read.
    """
    layer = refined_layer.new_layer(stage)
    limits: dict[str, float] = {}
    findings: list[Finding] = []
    for path, recipe in recipes.items():
        if not uses[path].refines:
            continue
        p = recipe.parameters(recipe.start)
        facts = refined_layer.records(known).get(path) if known else None
        limit = _limit(device, recipe, p, uses[path]) if facts is None else facts["refineSize"]
        limits[path] = limit
        if known is not None or not math.isfinite(limit):
            continue
        rest, asked = recipe.rest, p.refine
        knobs = {"anisotropy": asked.max_anisotropy, "faint": asked.min_opacity}
        budget = asked.budget if asked.budget >= 0 else min(GROWTH * len(rest), p.sim.max_count)
        cloud, rows = refined(device, rest, limit=limit, budget=budget, **knobs)
        left = oversized(device, cloud, limit=limit, **knobs)
        if left:
            findings.append(_left(recipe, p, budget, left))
        if cloud is rest:
            continue
        with reading:
            prim = stage.GetPrimAtPath(path)
            refined_layer.author(layer, prim, rest, cloud, rows, recipe.cut)
        sizes = {"refineSize": limit, "capturedSplats": len(rest), "refinedSplats": len(cloud)}
        refined_layer.record(layer, path, sizes)
    if known is not None:
        return Refinement(layer=known, limits=limits)
    made = layer if refined_layer.records(layer) else None
    return Refinement(layer=made, limits=limits, findings=tuple(findings))


def _limit(device: Device, recipe: StageRecipe, parameters: Parameters, uses: Uses) -> float:
    """Return the largest standard deviation of a splat [unit]."""
    asked, spacing = parameters.refine, parameters.refine.spacing
    if spacing < 0:
        spacing = spacing_of(device, recipe.rest, parameters, uses)
    size = asked.max_size if asked.max_size >= 0 else MAX_SIZE
    return size * spacing if spacing > 0 or asked.spacing == 0 else math.inf


def _left(recipe: StageRecipe, parameters: Parameters, budget: int, left: int) -> Finding:
    """Return the finding about splats that a budget leaves as they are."""
    asked, count = parameters.refine, len(recipe.rest)
    number = f"{counted(left, 'splat')} above maxSize, with a budget of {budget:,}"
    if budget <= count:
        number = f"a budget of {budget:,}, and {counted(count, 'splat')}; none is divided"
    is_asked = asked.max_size >= 0 or 0 <= asked.budget <= count
    return finding(
        "large-splats",
        f"{recipe.simulation}.{NAMESPACE}:refine:budget",
        number,
        "a larger budget, or a larger refine:maxSize",
        severity="warning" if is_asked else "note",
    )
