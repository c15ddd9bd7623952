"""What a simulation that runs takes from its stage, and what has to wait until it begins anew.

A solver prepares for what happens at any frame that it is told of beforehand, and reads what holds
for all times once. Both stay as they were; what a user changes there is told by name.
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
"""Groups that nobody asks before a bake."""
_NEEDS = {"scale": "sizes", "thickness": "sizes", "opacity": "fades", "color": "colors",
          "displacement": "needs_normals"}  # fmt: skip
"""Output of a driver -> what a simulation must have prepared for."""
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
"""Field of `Uses` -> the parameter that is likeliest to have asked for it, by importance."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pins:
    """How a simulation of one field began."""

    simulation: str
    """Path of the SplatSim prim."""
    first: Moment
    uses: Uses
    has_skin: bool

    def held(self, moment: Moment) -> tuple[Moment, list[str]]:
        """A moment that asks for nothing that was not there at the beginning.

        Returns:
            The moment, and the names of what it asked for besides.
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
    """Parameters with what holds for all times as it was first; the same where it is."""
    other = [name for name in _uniform(type(now)) if getattr(first, name) != getattr(now, name)]
    if not other:
        return now
    told += [f"{lead}:{camel(name)}" for name in other]
    return replace(now, **{name: getattr(first, name) for name in other})  # type: ignore[type-var]


def _uniform(cls: type) -> tuple[str, ...]:
    """Names of the knobs of a group that hold for all times."""
    return tuple(item.name for item in knobs(cls) if item.uniform)


def _without(moment: Moment, uses: Uses) -> Moment:
    """A moment without what was not prepared for; nothing at all where nothing was."""
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
