"""Separate parameters that a running simulation accepts from those that need a restart.

A solver prepares for the features of all frames that are known in advance, and reads constant
values once. Both stay fixed during a run; changes to them are reported by name.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TypeVar

from usdsplat.core.knobs import knobs
from usdsplat.sim.parameters import GROUPS, NAMESPACE, Parameters, camel
from usdsplat.sim.specs import Affector, Deformer, Driver, Moment
from usdsplat.sim.uses import Uses, uses_at

T = TypeVar("T")

_LATER = ("bake",)
"""Groups that are used by bakes only."""
_NEEDS = {"scale": "sizes", "thickness": "sizes", "opacity": "fades", "color": "colors",
          "displacement": "needs_normals"}  # fmt: skip
"""Output of a driver -> feature that a simulation must have prepared."""
_CAUSES = {
    "reacts": "rd:enabled",
    "grows": "growth:rate",
    "has_births": "growth:birthRate",
    "flies": "particles:enabled",
    "dissolves": "dissolve:enabled",
    "collides": "affector:role",
    "deforms": "deform",
    "sizes": "growth:sizeFollow",
    "fades": "appearance:keepOpacity",
    "needs_neighbors": "growth:sizeFollow",
    "colors": "driver",
    "needs_normals": "driver",
}
"""Field of `Uses` -> the parameter that most likely requires it, by importance."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pins:
    """The initial state of a simulation of one field."""

    simulation: str
    """Path of the SplatSim prim."""
    first: Moment
    uses: Uses
    has_skin: bool

    def held(self, moment: Moment) -> tuple[Moment, list[str]]:
        """Return a moment restricted to features that were prepared at the start.

        Returns:
            The moment, and the names of the ignored changes.
        """
        told: list[str] = []
        parameters = self._parameters(moment.parameters, told)
        pinned = replace(
            moment,
            parameters=parameters,
            affectors=tuple(self._affectors(moment.affectors, told)),
            deformers=tuple(self._deformers(moment.deformers, told)),
            drivers=tuple(self._drivers(moment.drivers, told)),
        )
        asked = uses_at(pinned, self.has_skin)
        lacking = [
            name for name in _CAUSES if getattr(asked, name) and not getattr(self.uses, name)
        ]
        if not lacking:
            return pinned, told
        if self.uses == Uses():
            return _without(pinned, self.uses), [f"{self._lead}:sim:enabled"]
        if "dissolves" in lacking:
            lacking = [name for name in lacking if name != "flies"]
        told.append(f"{self._lead}:{_CAUSES[lacking[0]]}")
        return _without(pinned, self.uses), told

    def _parameters(self, now: Parameters, told: list[str]) -> Parameters:
        groups = {}
        for name in GROUPS:
            group = getattr(now, name)
            if name not in _LATER:
                first = getattr(self.first.parameters, name)
                groups[name] = _pinned(first, group, f"{self._lead}:{name}", told)
        return replace(now, **groups)

    def _affectors(self, now: Iterable[Affector], told: list[str]) -> Iterable[Affector]:
        known = {each.path: each for each in self.first.affectors}
        for each in now:
            first = known[each.path].parameters
            lead = f"{each.path}.{NAMESPACE}:affector"
            yield replace(each, parameters=_pinned(first, each.parameters, lead, told))

    def _deformers(self, now: Iterable[Deformer], told: list[str]) -> Iterable[Deformer]:
        known = {each.name: each for each in self.first.deformers}
        for each in now:
            first = known[each.name]
            lead = f"{self._lead}:deform:{each.name}"
            held = _pinned(first.parameters, each.parameters, lead, told)
            yield first if held is not each.parameters else each

    def _drivers(self, now: Iterable[Driver], told: list[str]) -> Iterable[Driver]:
        known = {each.name: each for each in self.first.drivers}
        for each in now:
            lead = f"{self._lead}:driver:{each.name}"
            yield replace(
                each,
                parameters=_pinned(known[each.name].parameters, each.parameters, lead, told),
            )

    @property
    def _lead(self) -> str:
        return f"{self.simulation}.{NAMESPACE}"


def _pinned(first: T, now: T, lead: str, told: list[str]) -> T:
    """Return parameters with their initial constant values; the same object if unchanged."""
    other = [name for name in _uniform(type(now)) if getattr(first, name) != getattr(now, name)]
    if not other:
        return now
    told += [f"{lead}:{camel(name)}" for name in other]
    return replace(now, **{name: getattr(first, name) for name in other})  # type: ignore[type-var]


def _uniform(cls: type) -> tuple[str, ...]:
    """Return the names of the uniform knobs of a group."""
    return tuple(item.name for item in knobs(cls) if item.uniform)


def _without(moment: Moment, uses: Uses) -> Moment:
    """Return a moment without features that were not prepared."""
    p = moment.parameters
    parameters = replace(
        p,
        sim=replace(p.sim, enabled=p.sim.enabled and uses != Uses()),
        rd=replace(p.rd, enabled=p.rd.enabled and uses.reacts),
        growth=replace(
            p.growth,
            rate=p.growth.rate if uses.grows else 0.0,
            birth_rate=p.growth.birth_rate if uses.has_births else 0.0,
            size_follow=p.growth.size_follow if uses.needs_neighbors and uses.sizes else 0.0,
        ),
        particles=replace(p.particles, enabled=p.particles.enabled and uses.flies),
        dissolve=replace(p.dissolve, enabled=p.dissolve.enabled and uses.dissolves),
        appearance=replace(p.appearance, keep_opacity=p.appearance.keep_opacity and uses.fades),
    )
    drivers = [
        each
        for each in moment.drivers
        if getattr(uses, _NEEDS[each.parameters.output])
        and (uses.needs_neighbors or each.parameters.source != "crowding")
    ]
    return replace(moment, parameters=parameters, drivers=tuple(drivers))
