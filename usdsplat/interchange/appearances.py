"""Find the visible splat fields of a stage, with every place where they appear."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core import edit
from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.node_cuts import heights
from usdsplat.interchange.options import StageReading
from usdsplat.interchange.placement import checked_path
from usdsplat.interchange.tree_reading import LEAVES, TreeChoice, TreeReading
from usdsplat.schema.lod_roots import item_choice
from usdsplat.schema.stage_values import local_to_ancestor, local_to_world

MOST_SPLATS = 1 << 28
"""Maximum number of splats of an export: more would take 60 GB and are assumed to be a mistake."""

_PURPOSES = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
_IN_WORLD = Usd.TraverseInstanceProxies()
_IN_PROTOTYPE = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
"""Prototypes may be under an `over` or a `class`, so that they are not drawn by themselves."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Appearance:
    """A field or a splat tree with every place where it appears."""

    prim: Usd.Prim
    to_world: F64
    """Local to world matrices, column vectors, shape (k, 4, 4)."""
    tree: TreeReading | None = None
    """What is read of a tree; None for a field."""

    @property
    def rasterize_mode(self) -> str:
        """Mode in which the splats are drawn."""
        mode = schema.rasterize_mode(self.prim)
        return mode if self.tree is None else self.tree.rasterize_mode

    @property
    def chunk_files(self) -> tuple[str, ...]:
        """Files of the chunks of a tree; none for a field."""
        return () if self.tree is None else self.tree.tree.chunks

    def cloud(self, time: float | None, turn: F64) -> SplatCloud:
        """Return all its splats in world space, transformed by `turn`, shape (3, 3): axes and
        unit.

        Raises:
            StageError: If there are more than `MOST_SPLATS`, the field cannot be read, or float32
                cannot hold its world positions.
        """
        source = self.tree if self.tree is not None else schema.fetch(self.prim, time)
        total = len(source) * len(self.to_world)
        if total > MOST_SPLATS:
            raise StageError(str(self.prim.GetPath()), f"{total} splats", f"{MOST_SPLATS} at most")
        own = source.cloud() if isinstance(source, TreeReading) else source
        turned = np.eye(4)
        turned[:3, :3] = turn
        clouds = [self.placed(own, turned @ matrix) for matrix in self.to_world]
        return clouds[0] if len(clouds) == 1 else edit.merge(clouds)

    def placed(self, own: SplatCloud, matrix: F64) -> SplatCloud:
        """Return splats of the field or tree, transformed by a matrix.

        Raises:
            StageError: If the matrix is not finite, or float32 cannot hold the result.
        """
        if not np.isfinite(matrix).all():
            found = "a transform that is not finite"
            raise StageError(str(self.prim.GetPath()), found, "finite numbers")
        placed = edit.transform(own, matrix)
        if edit.overflows(own, placed):
            found = "splats beyond the float32 range in world space"
            raise StageError(str(self.prim.GetPath()), found, "a smaller transform")
        return placed


def appearances(stage: Usd.Stage, reading: StageReading) -> tuple[list[Appearance], list[str]]:
    """Return the visible fields and trees, one entry for each, and notes on what is left out.

    Of LOD roots, the items that are drawn without a view are taken; none if a tree stands for them.

    Args:
        stage: The stage.
        reading: What to read. A field that it names is taken even if it is invisible.

    Raises:
        StageError: If there is no such prim, or nothing is visible.
        UsageError: If `prim_path` is not the path of a prim, or no tree has the chosen level.
    """
    prim_path, time, trees = reading.prim_path, reading.time, reading.trees
    root = (
        stage.GetPseudoRoot() if prim_path is None else stage.GetPrimAtPath(checked_path(prim_path))
    )
    if not root:
        raise StageError(str(prim_path), "no such prim", "a splat field of the stage")
    places = UsdGeom.XformCache(code(time))
    found: list[Appearance]
    if is_exported(root):
        return _chosen([_once(root, places)], trees), []
    found = []
    notes: list[str] = []
    items = item_choice(stage, code(time))
    prims = iter(Usd.PrimRange(root, _IN_WORLD))
    for prim in prims:
        if prim != root and prim.GetPath() in items.hidden:
            prims.PruneChildren()
        elif prim.IsA(UsdGeom.PointInstancer):
            found += _instances(UsdGeom.PointInstancer(prim), places, time, notes)
            prims.PruneChildren()
        elif is_exported(prim):
            if _is_visible(prim, time, shown=items.shown):
                try:
                    found.append(_once(prim, places))
                except StageError as error:
                    notes.append(f"left out: {error}")
            else:
                notes.append(f"{prim.GetPath()}: left out, it is not shown in renders")
    if not found:
        where = prim_path or stage.GetRootLayer().identifier
        raise StageError(where, "; ".join(notes) or "no splat field", "a visible splat field")
    return _chosen(found, trees), notes


def is_exported(prim: Usd.Prim) -> bool:
    """Return whether a prim has splats that a capture can hold: a field or a splat tree."""
    return schema.is_splat_field(prim) or schema.is_tree(prim)


def _chosen(found: list[Appearance], trees: TreeChoice) -> list[Appearance]:
    """Return appearances with what is read of trees.

    Raises:
        StageError: If a tree cannot be read, or has no cut with so few splats.
        UsageError: If the choice has no effect, or no tree has that level.
    """
    chosen = [
        replace(each, tree=TreeReading.of(each.prim, trees)) if schema.is_tree(each.prim) else each
        for each in found
    ]
    if trees != LEAVES:
        trees_read = [each.tree.tree for each in chosen if each.tree is not None]
        tops = [int(heights(tree.table)[0]) for tree in trees_read]
        if not tops:
            raise UsageError("level of detail", "a stage without splat trees", "one with a tree")
        if trees.level > max(tops):
            raise UsageError("level of detail", f"level {trees.level}", f"0 to {max(tops)}")
    return chosen


def code(time: float | None) -> Usd.TimeCode:
    """Return a time as a USD time code."""
    return Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)


def _once(prim: Usd.Prim, places: UsdGeom.XformCache) -> Appearance:
    """Return a field that appears once, with its own transform.

    Raises:
        StageError: If USD does not know one of its transform ops.
    """
    return Appearance(prim=prim, to_world=_columns(local_to_world(prim, places))[None])


def _instances(
    instancer: UsdGeom.PointInstancer,
    places: UsdGeom.XformCache,
    time: float | None,
    notes: list[str],
) -> Iterator[Appearance]:
    """Yield the fields of the prototypes of a point instancer, each with all its visible
    instances."""
    path = instancer.GetPath()
    if not _is_visible(instancer.GetPrim(), time):
        notes.append(f"{path}: left out, it is not shown in renders")
        return
    to_instancer, kinds = _shown(instancer, time)
    try:
        to_world = _columns(local_to_world(instancer.GetPrim(), places))
    except StageError as error:
        notes.append(f"left out: {error}")
        return
    stage = instancer.GetPrim().GetStage()
    for kind, target in enumerate(instancer.GetPrototypesRel().GetForwardedTargets()):
        prototype = stage.GetPrimAtPath(target)
        here = to_world @ to_instancer[kinds == kind]
        if not prototype or not len(here):
            continue
        is_defined = prototype.IsDefined() and not prototype.IsAbstract()
        for prim in Usd.PrimRange(prototype, _IN_WORLD if is_defined else _IN_PROTOTYPE):
            if prim.IsA(UsdGeom.PointInstancer):
                notes.append(f"{prim.GetPath()}: point instances of instances are not exported")
            elif is_exported(prim) and _is_visible(prim, time, prototype):
                try:
                    inner = local_to_ancestor(prim, prototype, places)
                except StageError as error:
                    notes.append(f"left out: {error}")
                    continue
                yield Appearance(prim=prim, to_world=here @ _columns(inner))


def _shown(instancer: UsdGeom.PointInstancer, time: float | None) -> tuple[F64, F64]:
    """Return matrices of the unmasked instances, (k, 4, 4), and their prototypes, (k,)."""
    own, positions = UsdGeom.PointInstancer, instancer.GetPositionsAttr()
    when = code(time)
    if time is None and positions.Get() is None:  # first sample, as for fields
        when = code(next(iter(positions.GetTimeSamples()), None))
    maps = instancer.ComputeInstanceTransformsAtTime(
        when, when, own.IncludeProtoXform, own.IgnoreMask
    )
    matrices = np.array(maps or (), np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)
    kinds = np.array(instancer.GetProtoIndicesAttr().Get(when) or (), np.int64)
    mask = np.array(instancer.ComputeMaskAtTime(when) or np.ones(len(kinds)), bool)
    if not len(matrices) == len(kinds) == len(mask):
        found = f"{len(matrices)} places for {len(kinds)} instances"
        raise StageError(str(instancer.GetPath()), found, "one for each")
    return matrices[mask], kinds[mask]


def _columns(matrix: object) -> F64:
    """Convert a Gf matrix, for row vectors, to one for column vectors."""
    return np.array(matrix, np.float64).T


def _is_visible(
    prim: Usd.Prim,
    time: float | None,
    root: Usd.Prim | None = None,
    shown: frozenset[Sdf.Path] = frozenset(),
) -> bool:
    """Return whether renders show the prim; ancestors of a prototype `root` are ignored, and so is
    the own visibility of items of LOD roots that are `shown`."""
    purpose = ""
    while prim and not prim.IsPseudoRoot():
        imageable = UsdGeom.Imageable(prim)
        if imageable:
            own = imageable.GetVisibilityAttr().Get(code(time))
            if own == UsdGeom.Tokens.invisible and prim.GetPath() not in shown:
                return False
            named = imageable.GetPurposeAttr()
            purpose = purpose or (str(named.Get()) if named.HasAuthoredValue() else "")
        if prim == root:
            break
        prim = prim.GetParent()
    return not purpose or purpose in _PURPOSES
