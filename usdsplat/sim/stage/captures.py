"""Read the capture that a simulation morphs into."""

from __future__ import annotations

from dataclasses import replace

from pxr import Usd

from usdsplat import schema
from usdsplat.core import edit
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.sim.parameters import NAMESPACE, ConformParameters, SimParameters
from usdsplat.sim.population import padded
from usdsplat.sim.stage import fields
from usdsplat.sim.stage.parameters import read
from usdsplat.sim.stage.spaces import Space
from usdsplat.sim.stage.targets import related
from usdsplat.sim.stage.trees import is_simulated, simulated_cut

TARGET = f"{NAMESPACE}:conform:target"


def target_capture(simulation: Usd.Prim, space: Space) -> SplatCloud | None:
    """Return the capture that is the target of conform, at the start, in the simulation's space;
    None if the target is no splat field or tree.

    Raises:
        StageError: If it cannot be read, is the field itself, or the mode needs a mesh.
    """
    prim = related(simulation, TARGET)
    if prim is None or not is_simulated(prim):
        return None
    where = f"{simulation.GetPath()}.{TARGET}"
    if prim == space.field:
        raise StageError(where, "the simulated field itself", "another one, or a mesh")
    default = Usd.TimeCode.Default()
    mode = read(simulation, ConformParameters, f"{NAMESPACE}:conform", default).mode
    if mode != "transport":
        raise StageError(where, f"a capture, and conform:mode {mode}", "conform:mode transport")
    asked = read(simulation, SimParameters, f"{NAMESPACE}:sim", default)
    cut = simulated_cut(prim, asked) if schema.is_tree(prim) else None
    cloud, _ = fields.read_rest(prim, space.start, cut)
    moved = edit.transform(cloud, space.from_prim(prim, space.start))
    return replace(moved, ids=None, velocities=None)


def with_degree(cloud: SplatCloud, other: SplatCloud) -> SplatCloud:
    """Return a capture with harmonics of at least the degree of another one."""
    return replace(cloud, sh=padded(cloud.sh, other.sh.shape[1]))
