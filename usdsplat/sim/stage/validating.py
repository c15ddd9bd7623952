"""Validate the simulations and the bakes of a stage; each finding has a cure.

`schema.validate` checks splat fields; it is in a lower layer that does not know simulations.
"""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Sdf, Tf, Usd

from usdsplat.core.errors import UsdSplatError
from usdsplat.core.findings import Finding, finding, from_error
from usdsplat.sim.parameters import NAMESPACE
from usdsplat.sim.stage import collections
from usdsplat.sim.stage.findings import findings
from usdsplat.sim.stage.provenance import read_record
from usdsplat.sim.stage.recipe import recipes

_MOST = 1000
"""Largest number of times at which values are checked: the first ones, and the last."""


def validate_simulations(stage: Usd.Stage, *, time: float | None = None) -> list[Finding]:
    """Check every SplatSim prim, its affectors, and the files of a bake.

    Args:
        stage: Is not changed.
        time: Time code to check; None checks wherever a parameter has a sample.

    Returns:
        Errors for what cannot be simulated, the first of each simulation, and for missing results;
        warnings for unused properties and dead targets.
    """
    found = list(_bakes(stage))
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


def _bakes(stage: Usd.Stage) -> Iterator[Finding]:
    """Yield a finding for each missing layer of a bake."""
    for layer in stage.GetLayerStack(includeSessionLayers=False):
        if read_record(layer) is None:
            continue
        for path in layer.subLayerPaths:
            if not _is_layer(layer, path):
                found = f"a bake without its layer {path}"
                expected = f"the file beside {layer.GetDisplayName()}"
                yield finding("no-results", "/", found, expected)


def _is_layer(layer: Sdf.Layer, path: str) -> bool:
    """Return whether USD can read a sublayer."""
    try:
        return bool(Sdf.Layer.FindOrOpenRelativeToLayer(layer, path))
    except Tf.ErrorException:
        return False


def _times(stage: Usd.Stage, prims: list[Usd.Prim]) -> list[float]:
    """Return the times at which a parameter has a sample, and the stage's start."""
    times = {stage.GetStartTimeCode()}
    for prim in prims:
        for attribute in prim.GetAuthoredAttributes():
            if attribute.GetName().startswith(f"{NAMESPACE}:"):
                times.update(attribute.GetTimeSamples())
    found = sorted(times)
    return found if len(found) <= _MOST else [*found[: _MOST - 1], found[-1]]
