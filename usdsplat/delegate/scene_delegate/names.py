"""Find properties in our namespaces with unknown names, which have no effect.

Names of simulations are checked where they are read, see `sim.stage.parameters.unread`; here only
those on prims that are no part of a simulation.
"""

from __future__ import annotations

import difflib
from collections.abc import Container, Iterable, Iterator

from pxr import Sdf, Usd, UsdRender

from usdsplat import schema
from usdsplat.core.findings import Finding, finding
from usdsplat.render.settings import usd_names
from usdsplat.schema import tokens
from usdsplat.schema.tree import is_tree

DRAWING = "splat:"
SIMULATION = "splatSim:"
AFFECTOR = "splatSim:affector:"

KNOWN = frozenset(usd_names()) | {
    value
    for value in vars(tokens).values()
    if isinstance(value, str) and value.startswith(DRAWING) and value != "splat:grade:"
}
"""Names of properties of all our schemas but those of simulations."""

GRADES = schema.GRADE_ATTRIBUTES
LIGHTING = (tokens.LIGHTING, tokens.CAPTURED_LIGHTS)
CROPS = (tokens.CROP_INCLUDE, tokens.CROP_EXCLUDE)


def checked_names(prim: Usd.Prim) -> list[str]:
    """Return the names of the authored properties of a prim that are ours, or seem to be."""
    return [
        name
        for name in prim.GetAuthoredPropertyNames()
        if name.startswith((DRAWING, SIMULATION, "collection:crop"))
    ]


def unknown_names(prim: Usd.Prim, names: list[str]) -> Iterator[Finding]:
    """Yield a finding for each of the `checked_names` of a prim that is unknown, or that has an
    effect on splat fields only."""
    for name in names:
        if name.startswith(DRAWING) and name not in KNOWN:
            yield _unknown(prim, name, sorted(KNOWN))
        elif name in LIGHTING and not _has_light(prim):
            yield finding("unused", f"{prim.GetPath()}.{name}", "no splat field", "it on the field")
        elif name.startswith("collection:"):
            collection, _, rest = name.removeprefix("collection:").partition(":")
            near = schema.is_splat_field(prim) or difflib.get_close_matches(
                collection, CROPS, 1, 0.8
            )
            if near and collection not in CROPS:
                yield _unknown(prim, name, [f"collection:{each}:{rest}" for each in CROPS])
        elif name.startswith(SIMULATION) and not _is_simulated(prim, names):
            yield finding(
                "unknown-name",
                f"{prim.GetPath()}.{name}",
                "an unknown property",
                "it on a SplatSim prim or an affector",
            )


def inheritable(prim: Usd.Prim, names: list[str]) -> list[tuple[Usd.Prim, str]]:
    """Return the properties of a prim that fields below it inherit, as pairs (prim, property name).

    These are those of its grade and its crop collections.

    Args:
        prim: The prim.
        names: Its `checked_names`.
    """
    found = [(prim, name) for name in names if name in GRADES]
    crops = (f"collection:{name}" for name in CROPS)
    return found[:1] + [
        (prim, crop) for crop in crops if any(name.startswith(f"{crop}:") for name in names)
    ]


def without_fields(
    found: Iterable[tuple[Usd.Prim, str]], above: Container[Sdf.Path]
) -> Iterator[Finding]:
    """Yield a finding for each pair of `inheritable` that applies to no field.

    Args:
        found: The pairs.
        above: Paths of all fields and of the prims above them.
    """
    for prim, name in found:
        if prim.GetPath() not in above:
            expected = "a splat field at or below the prim"
            yield finding("unused", f"{prim.GetPath()}.{name}", "no splat field", expected)


def _unknown(prim: Usd.Prim, name: str, known: list[str]) -> Finding:
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    expected = f"such as {near[0]}" if near else "a property of a schema of usdsplat"
    return finding("unknown-name", f"{prim.GetPath()}.{name}", "an unknown property", expected)


def _has_light(prim: Usd.Prim) -> bool:
    """Return whether a prim has light of splats: its own, or that of a picture."""
    is_of_picture = any(prim.IsA(each) for each in (UsdRender.Settings, UsdRender.Product))
    return is_of_picture or schema.is_splat_field(prim) or is_tree(prim)


def _is_simulated(prim: Usd.Prim, names: list[str]) -> bool:
    """Return whether the prim's names are checked by the simulation."""
    applied = prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    return (
        prim.GetTypeName() == "SplatSim"
        or "SplatAffectorAPI" in applied
        or any(name.startswith(AFFECTOR) for name in names)
    )
