"""The parameters of a simulation, each declared once: groups of knobs.

A knob `some_name` of the group `rd` is the attribute `splatSim:rd:someName` of the SplatSim prim,
the name `rd:someName` on the command line, and `parameters.rd.some_name` here.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from usdsplat.core.errors import UsageError
from usdsplat.core.knobs import Knob, checked, checked_value, knobs
from usdsplat.sim.parameters.accretion import AccretionParameters
from usdsplat.sim.parameters.affector import AffectorParameters
from usdsplat.sim.parameters.mask import MaskParameters
from usdsplat.sim.parameters.matter import CarriersParameters, MatterParameters
from usdsplat.sim.parameters.refine import RefineParameters
from usdsplat.sim.parameters.result import AppearanceParameters, BakeParameters, DriverParameters
from usdsplat.sim.parameters.shape import (
    ConformParameters,
    DeformParameters,
    DissolveParameters,
    ParticlesParameters,
    SettleParameters,
    SkinParameters,
)
from usdsplat.sim.parameters.solver import (
    GrowthParameters,
    NeighborsParameters,
    RdParameters,
    RelaxParameters,
    SimParameters,
)

__all__ = [
    "GROUPS",
    "INSTANCED",
    "MASK",
    "NAMED",
    "NAMESPACE",
    "AccretionParameters",
    "AffectorParameters",
    "AppearanceParameters",
    "BakeParameters",
    "CarriersParameters",
    "ConformParameters",
    "DeformParameters",
    "DissolveParameters",
    "DriverParameters",
    "GrowthParameters",
    "MaskParameters",
    "MatterParameters",
    "NeighborsParameters",
    "Parameters",
    "ParticlesParameters",
    "RdParameters",
    "RefineParameters",
    "RelaxParameters",
    "SettleParameters",
    "SimParameters",
    "SkinParameters",
    "binding_of",
    "camel",
    "legal",
    "masked_parameters",
]

NAMESPACE = "splatSim"

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """All groups of one SplatSim prim at one time."""

    sim: SimParameters = field(default_factory=SimParameters)
    neighbors: NeighborsParameters = field(default_factory=NeighborsParameters)
    refine: RefineParameters = field(default_factory=RefineParameters)
    carriers: CarriersParameters = field(default_factory=CarriersParameters)
    rd: RdParameters = field(default_factory=RdParameters)
    relax: RelaxParameters = field(default_factory=RelaxParameters)
    growth: GrowthParameters = field(default_factory=GrowthParameters)
    accretion: AccretionParameters = field(default_factory=AccretionParameters)
    settle: SettleParameters = field(default_factory=SettleParameters)
    matter: MatterParameters = field(default_factory=MatterParameters)
    conform: ConformParameters = field(default_factory=ConformParameters)
    skin: SkinParameters = field(default_factory=SkinParameters)
    particles: ParticlesParameters = field(default_factory=ParticlesParameters)
    dissolve: DissolveParameters = field(default_factory=DissolveParameters)
    appearance: AppearanceParameters = field(default_factory=AppearanceParameters)
    bake: BakeParameters = field(default_factory=BakeParameters)


GROUPS: dict[str, type] = {
    "sim": SimParameters,
    "neighbors": NeighborsParameters,
    "refine": RefineParameters,
    "carriers": CarriersParameters,
    "rd": RdParameters,
    "relax": RelaxParameters,
    "growth": GrowthParameters,
    "accretion": AccretionParameters,
    "settle": SettleParameters,
    "matter": MatterParameters,
    "conform": ConformParameters,
    "skin": SkinParameters,
    "particles": ParticlesParameters,
    "dissolve": DissolveParameters,
    "appearance": AppearanceParameters,
    "bake": BakeParameters,
}
"""Group of a SplatSim prim -> its knobs."""

INSTANCED: dict[str, type] = {
    "affector": AffectorParameters,
    "deform": DeformParameters,
    "driver": DriverParameters,
    "mask": MaskParameters,
}
"""Groups with several instances: affectors are prims of their own, deformers, drivers and masks
have names, as in `splatSim:deform:<name>:angle`."""

NAMED = ("deform", "driver", "mask")
"""Groups whose instances have names."""

MASK = "mask"
"""Last part of the name of an attribute that names the mask of a parameter."""


def binding_of(item: Knob) -> Knob:
    """Return the knob `<name>:mask` that names the mask of another knob."""
    return Knob(
        name=f"{item.name}:{MASK}", type=str, default="", usd_type="token", uniform=True,
        text=f"name of the mask that multiplies {item.name}, splat by splat",
    )  # fmt: skip


def masked_parameters() -> tuple[str, ...]:
    """Return the names of all parameters that take a mask, such as "growth:rate"."""
    return tuple(
        f"{group}:<name>:{camel(item.name)}" if group in NAMED else f"{group}:{camel(item.name)}"
        for group, cls in {**GROUPS, **INSTANCED}.items()
        for item in knobs(cls)
        if item.takes_mask
    )


@functools.cache
def camel(name: str) -> str:
    """Return a name in USD's spelling: `pattern_scale` is `patternScale`."""
    first, *rest = name.split("_")
    return first + "".join(word[:1].upper() + word[1:] for word in rest)


def legal(where: str, cls: type[T], values: Mapping[str, Any]) -> T:
    """Return values as their knobs' types, as `core.knobs.checked` does, and reject infinite
    numbers except where the default is infinite.

    Raises:
        UsageError: If a name is no knob of `cls`, or it cannot have that value.
    """
    made = checked(where, cls, values)
    for item in knobs(cls):
        if item.name in values:
            _check_finite(f"{where} {item.name}", item, getattr(made, item.name))
    return made


def legal_value(where: str, item: Knob, value: Any) -> Any:
    """Return one value as its knob's type, as `legal` does.

    Raises:
        UsageError: If the knob cannot have it.
    """
    found = checked_value(where, item, value)
    _check_finite(where, item, found)
    return found


def _check_finite(where: str, item: Knob, value: Any) -> None:
    """Reject an infinite number, unless the knob's default is infinite."""
    if item.default in (math.inf, -math.inf):
        return
    wrong = [each for each in _numbers(value) if not math.isfinite(each)]
    if wrong:
        is_one = isinstance(value, float)
        expected = f"{item.expected}, finite" if is_one else "finite numbers"
        raise UsageError(where, str(wrong[0]), expected)


def _numbers(value: Any) -> Iterator[float]:
    """Yield all numbers of a value."""
    if isinstance(value, tuple):
        for part in value:
            yield from _numbers(part)
    elif isinstance(value, (int, float)):
        yield value
