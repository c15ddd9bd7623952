"""Find out what a simulation needs before it starts: stages, neighbours, and arrays that change."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

from usdsplat.sim.materials import breaks, resolved
from usdsplat.sim.specs import Moment, Recipe


@dataclass(frozen=True, slots=True, kw_only=True)
class Uses:
    """Stages, neighbours and arrays that a simulation needs at any time."""

    deforms: bool = False
    """Whether deformers, a skin or a target move splats."""
    collides: bool = False
    reacts: bool = False
    grows: bool = False
    """Whether splats move along their normals with the pattern."""
    breeds: bool = False
    """Whether splats have children."""
    accretes: bool = False
    """Whether new matter grows over the carriers."""
    has_births: bool = False
    """Whether splats are born, and may die."""
    flies: bool = False
    dissolves: bool = False
    needs_neighbors: bool = False
    """Whether anything but the reaction needs neighbours of splats."""
    fades: bool = False
    """Whether opacities change."""
    sizes: bool = False
    """Whether scales change other than by deformation."""
    colors: bool = False

    refines: bool = False
    """Whether large splats are divided before the first frame."""
    splits: bool = False
    """Whether splats are divided while they move."""
    coheres: bool = False
    """Whether splats follow matter."""
    breaks: bool = False
    """Whether matter breaks into pieces that are filled."""
    transports: bool = False
    """Whether splats move onto a target by transport of the field's carriers."""
    joins: bool = False
    """Whether the splats of another capture join."""
    needs_normals: bool = False
    """Whether normals are needed, with their outer side."""

    @property
    def varies(self) -> bool:
        """Whether the number of splats may change."""
        return self.has_births or self.splits or self.joins

    @property
    def writes(self) -> frozenset[str]:
        """Names of the cloud's arrays that may change."""
        found = {"positions"}
        turns = self.deforms or self.collides or self.coheres
        if turns or self.varies:
            found |= {"rotations", "scales", "sh"}
        if self.joins or self.transports or self.breaks:
            found.add("opacities")
        if self.sizes or self.dissolves or self.accretes:
            found.add("scales")
        if self.fades or self.varies or self.dissolves:
            found.add("opacities")
        if self.colors:
            found.add("sh")
        return frozenset(found)

    def joined(self, other: Uses) -> Uses:
        """Return what either of two needs."""
        return Uses(**{name: getattr(self, name) or getattr(other, name) for name in _NAMES})


_NAMES = tuple(Uses.__dataclass_fields__)


def uses_over(recipe: Recipe, times: Iterable[float]) -> Uses:
    """Return what a field's simulation needs at these times [time code]."""
    has_skin = recipe.binding is not None
    return reduce(Uses.joined, (uses_at(recipe.at(time), has_skin) for time in times), Uses())


def uses_at(moment: Moment, has_skin: bool) -> Uses:
    """Return what is needed at one time."""
    p, refine = moment.parameters, moment.parameters.refine
    if not p.sim.enabled:
        return Uses()
    roles = {each.parameters.role for each in moment.affectors if each.parameters.enabled}
    outputs = {each.parameters.output for each in moment.drivers}
    sources = {each.parameters.source for each in moment.drivers}
    reacts = p.rd.enabled
    breeds = reacts and p.growth.birth_rate > 0
    accretes = reacts and p.accretion.enabled
    has_target = moment.target is not None or moment.becomes is not None
    conforms = has_target and p.conform.weight > 0
    filled = breaks(resolved(p.matter)) and p.matter.fill
    asks = reacts or conforms or p.matter.enabled or p.dissolve.enabled
    refines = refine.enabled == "on" or (refine.enabled == "auto" and asks)
    return Uses(
        refines=refines,
        splits=refines and math.isfinite(refine.stretch),
        deforms=bool(moment.deformers) or has_skin or has_target,
        collides="collide" in roles,
        coheres=p.matter.enabled,
        breaks=filled,
        transports=has_target and p.conform.mode == "transport",
        joins=moment.becomes is not None,
        reacts=reacts,
        grows=reacts and p.growth.rate != 0,
        breeds=breeds,
        accretes=accretes,
        has_births=breeds or accretes or filled,
        flies=p.particles.enabled or p.dissolve.enabled,
        dissolves=p.dissolve.enabled,
        needs_neighbors=breeds or p.growth.size_follow > 0 or "crowding" in sources,
        fades="opacity" in outputs or "opacity" in roles or p.appearance.keep_opacity,
        sizes=bool({"scale", "thickness"} & outputs) or p.growth.size_follow > 0,
        colors="color" in outputs or accretes or filled,
        needs_normals="displacement" in outputs
        or p.dissolve.enabled
        or (reacts and p.growth.rate != 0)
        or breeds,
    )
