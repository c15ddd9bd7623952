"""Splat trees in simulations: a cut is simulated, and its bake is a field in place of the tree."""

from __future__ import annotations

from pxr import Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.errors import StageError
from usdsplat.core.node_cuts import heights
from usdsplat.schema import tokens
from usdsplat.schema.tree_cuts import TreeReading
from usdsplat.sim.parameters import NAMESPACE, SimParameters
from usdsplat.sim.stage.sample_layer import SampleLayer


def simulated_cut(prim: Usd.Prim, parameters: SimParameters) -> TreeReading:
    """Return the cut of a splat tree that the parameters ask for. No chunk is opened.

    Raises:
        StageError: If the tree cannot be read, or has no such cut.
    """
    level = parameters.tree_level
    if level < 0:
        return TreeReading.within(prim, parameters.tree_splats)
    found = TreeReading.at_level(prim, level)
    top = int(heights(found.tree.table)[0])
    if level > top:
        where = f"{prim.GetPath()}, {NAMESPACE}:sim:treeLevel"
        raise StageError(where, f"level {level}", f"0 to {top}")
    return found


def is_simulated(prim: Usd.Prim) -> bool:
    """Return whether a simulation can have the prim as a member: a splat field, or a tree."""
    return schema.is_splat_field(prim) or schema.is_tree(prim)


def replaced_root(prim: Usd.Prim) -> str:
    """Return the path of the LOD root that a tree stands for; "" if there is none."""
    targets = prim.GetRelationship(tokens.LOD_ROOT).GetForwardedTargets()
    return str(targets[0]) if targets and prim.GetStage().GetPrimAtPath(targets[0]) else ""


def author_replacement(part: SampleLayer, path: str, mode: str, root: str) -> None:
    """Write what draws a field in place of the tree at `path`, besides its type and arrays: how it
    is rasterized, and that its LOD root is invisible.

    Args:
        part: Layer with the field.
        path: Path of the tree.
        mode: Rasterize mode of the field.
        root: Path of the LOD root that the tree stands for, or "".
    """
    kind = Sdf.ValueTypeNames.Token
    part.attribute(path, tokens.RASTERIZE_MODE, kind, uniform=True).default = mode
    if root:
        visibility = part.attribute(root, UsdGeom.Tokens.visibility, kind)
        visibility.default = UsdGeom.Tokens.invisible
