"""Members of a simulation: its fields and its affectors."""

from __future__ import annotations

from collections.abc import Callable

from pxr import Usd

from usdsplat.core.findings import Finding, finding
from usdsplat.schema.lod_roots import find_roots
from usdsplat.sim.parameters import NAMESPACE
from usdsplat.sim.stage.trees import is_simulated

SIMULATION_TYPE = "SplatSim"
AFFECTOR_API = "SplatAffectorAPI"
SPLATS = "splats"
AFFECTORS = "affectors"
"""Collections of a simulation."""

_LEFT_OUT = "left-out-of-simulation"


def find_simulations(stage: Usd.Stage) -> list[Usd.Prim]:
    """Return all active, defined SplatSim prims of a stage, in the order of the stage."""
    return [prim for prim in stage.Traverse() if prim.GetTypeName() == SIMULATION_TYPE]


def splats(stage: Usd.Stage, simulation: Usd.Prim) -> tuple[list[Usd.Prim], list[Finding]]:
    """Return the fields and splat trees of a simulation, ordered by path, and a finding on each
    that is left out.

    Fields in instances are left out, because no opinion can be authored on them; and without a
    finding those for other renderers, of which a tree is drawn, and simulated, instead.
    """
    roots = find_roots(stage)
    everyone = Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())
    members = _members(everyone, simulation, SPLATS, is_simulated)
    found = [prim for prim in members if not roots.is_replaced(prim)]
    left_out = [
        finding(_LEFT_OUT, str(prim.GetPath()), "a field in an instance", "one that can be edited")
        for prim in found
        if prim.IsInstanceProxy()
    ]
    return [prim for prim in found if not prim.IsInstanceProxy()], left_out


def affectors(stage: Usd.Stage, simulation: Usd.Prim) -> list[Usd.Prim]:
    """Return the affectors of a simulation, ordered by path, visible or not, in instances too."""
    everyone = Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())
    return _members(everyone, simulation, AFFECTORS, is_affector)


def is_affector(prim: Usd.Prim) -> bool:
    """Return whether SplatAffectorAPI is applied to a prim, known to USD or not, or one of its
    attributes is authored."""
    if AFFECTOR_API in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
        return True
    lead = f"{NAMESPACE}:affector:"
    return any(name.startswith(lead) for name in prim.GetAuthoredPropertyNames())


def _members(
    everyone: Usd.PrimRange,
    simulation: Usd.Prim,
    name: str,
    is_one: Callable[[Usd.Prim], bool],
) -> list[Usd.Prim]:
    """Return the prims that satisfy a predicate and are in the collection; without a collection,
    all that satisfy the predicate."""
    query = _query(simulation, name)
    found = [
        prim
        for prim in everyone
        if is_one(prim) and (query is None or query.IsPathIncluded(prim.GetPath()))
    ]
    return sorted(found, key=lambda prim: prim.GetPath())


def _query(simulation: Usd.Prim, name: str) -> Usd.CollectionMembershipQuery | None:
    """Return the query of a collection; None if it is not authored."""
    includes = simulation.GetRelationship(f"collection:{name}:includes")
    expression = simulation.GetAttribute(f"collection:{name}:membershipExpression")
    root = simulation.GetAttribute(f"collection:{name}:includeRoot")
    if not (
        (includes and includes.HasAuthoredTargets())
        or (expression and expression.HasAuthoredValue())
        or (root and root.Get())
    ):
        return None
    return Usd.CollectionAPI(simulation, name).ComputeMembershipQuery()
