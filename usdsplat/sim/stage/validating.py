"""Validate the simulations and the bakes of a stage; each finding has a cure.

`schema.validate` checks splat fields; it is in a lower layer that does not know simulations.
"""

from __future__ import annotations

from pxr import Usd

from usdsplat.core.errors import UsdSplatError
from usdsplat.core.findings import Finding, from_error
from usdsplat.sim.parameters import NAMESPACE
from usdsplat.sim.stage import collections
from usdsplat.sim.stage.bake_findings import bake_findings
from usdsplat.sim.stage.findings import findings
from usdsplat.sim.stage.recipe import recipes

_MOST = 1000
"""Largest number of times at which values are checked: the first ones, and the last."""


def validate_simulations(stage: Usd.Stage, *, time: float | None = None) -> list[Finding]:
    """Check every SplatSim prim, its affectors, and the files of a bake.

    Args:
        stage: Is not changed.
        time: Time code to check; None checks wherever a parameter has a sample.

    Returns:
        Errors for what cannot be simulated, the first of each simulation, for missing results and
        for interrupted bakes; warnings for unused properties and dead targets.
    """
    found = list(bake_findings(stage))
    for prim in collections.find_simulations(stage):
        members = collections.affectors(stage, prim)
        found += findings(prim, members)
        times = [time] if time is not None else _times(stage, [prim, *members])
        try:
            for recipe in recipes(stage, prim, start=times[0]):
                for each in times:
                    recipe.at(each)
        except UsdSplatError as error:
            found.append(from_error("not-simulated", error))
    return found


def _times(stage: Usd.Stage, prims: list[Usd.Prim]) -> list[float]:
    """Return the times at which a parameter has a sample, and the stage's start."""
    times = {stage.GetStartTimeCode()}
    for prim in prims:
        for attribute in prim.GetAuthoredAttributes():
            if attribute.GetName().startswith(f"{NAMESPACE}:"):
                times.update(attribute.GetTimeSamples())
    found = sorted(times)
    return found if len(found) <= _MOST else [*found[: _MOST - 1], found[-1]]
