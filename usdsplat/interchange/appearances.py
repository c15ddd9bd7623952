"""Find the visible splat fields of a stage, with every place where they appear."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core import edit
from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.errors import StageError, UsageError
from usdsplat.core.node_cuts import fixed_at, heights
from usdsplat.interchange.options import StageReading
from usdsplat.interchange.placement import checked_path
from usdsplat.interchange.tree_reading import LEAVES, ViewChoice, tree_reading
from usdsplat.interchange.view_cuts import view_cuts
from usdsplat.schema import attributes
from usdsplat.schema.lod_roots import item_choice, tree_level
from usdsplat.schema.stage_values import local_to_ancestor, local_to_world
from usdsplat.schema.tree import Tree
from usdsplat.schema.tree_cuts import TreeReading

MOST_SPLATS = 1 << 28
"""Maximum number of splats of an export: more would take 60 GB and are assumed to be a mistake."""

_IN_WORLD = Usd.TraverseInstanceProxies()
_IN_PROTOTYPE = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
"""Prototypes may be under an `over` or a `class`, so that they are not drawn by themselves."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Appearance:
    """A field or a splat tree with every place where it appears."""

    prim: Usd.Prim
    to_world: F64
    """Local to world matrices, column vectors, shape (k, 4, 4)."""
    trees: tuple[TreeReading, ...] = ()
    """What is read of a tree for each place, the same object where it is the same; none for a
    field."""

    @property
    def rasterize_mode(self) -> str:
        """Mode in which the splats are drawn; of a tree, most of them."""
        if not self.trees:
            return schema.rasterize_mode(self.prim)
        sizes: Counter[str] = Counter()
        for tree in self.trees:
            sizes[tree.rasterize_mode] += len(tree)
        return sizes.most_common(1)[0][0]

    @property
    def chunk_files(self) -> tuple[str, ...]:
        """Files of the chunks of a tree; none for a field."""
        return self.trees[0].tree.chunks if self.trees else ()

    def cloud(self, time: float | None, turn: F64) -> SplatCloud:
        """Return all its splats in world space, transformed by `turn`, shape (3, 3): axes and
        unit.

        Raises:
            StageError: If there are more than `MOST_SPLATS`, the field cannot be read, or float32
                cannot hold its world positions.
        """
        sources: Sequence[TreeReading | SplatCloud]
        sources = self.trees or [schema.fetch(self.prim, time)] * len(self.to_world)
        total = sum(map(len, sources))
        if total > MOST_SPLATS:
            raise StageError(str(self.prim.GetPath()), f"{total} splats", f"{MOST_SPLATS} at most")
        turned = np.eye(4)
        turned[:3, :3] = turn
        places: dict[int, list[F64]] = {}
        for source, matrix in zip(sources, self.to_world, strict=True):
            places.setdefault(id(source), []).append(turned @ matrix)
        clouds: list[SplatCloud] = []
        for source in {id(each): each for each in sources}.values():
            own = source.cloud() if isinstance(source, TreeReading) else source
            clouds += [self.placed(own, matrix) for matrix in places[id(source)]]
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
    prim_path, time = reading.prim_path, reading.time
    root = (
        stage.GetPseudoRoot() if prim_path is None else stage.GetPrimAtPath(checked_path(prim_path))
    )
    if not root:
        raise StageError(str(prim_path), "no such prim", "a splat field of the stage")
    places = UsdGeom.XformCache(code(time))
    found: list[Appearance]
    if is_exported(root):
        return _chosen([_once(root, places)], reading), []
    found = []
    notes: list[str] = []
    items = item_choice(stage, code(time))
    prims = iter(Usd.PrimRange(root, _IN_WORLD))
    for prim in prims:
        if prim != root and prim.GetPath() in items.hidden:
            prims.PruneChildren()
        elif prim.IsA(UsdGeom.PointInstancer):
            found += _instances(UsdGeom.PointInstancer(prim), places, reading, notes)
            prims.PruneChildren()
        elif is_exported(prim):
            if _is_visible(prim, reading, shown=items.shown):
                try:
                    found.append(_once(prim, places))
                except StageError as error:
                    notes.append(f"left out: {error}")
            else:
                notes.append(f"{prim.GetPath()}: left out, it is not shown in renders")
    if not found:
        where = prim_path or stage.GetRootLayer().identifier
        raise StageError(where, "; ".join(notes) or "no splat field", "a visible splat field")
    return _chosen(found, reading), notes


def is_exported(prim: Usd.Prim) -> bool:
    """Return whether a prim has splats that a capture can hold: a field or a splat tree."""
    return schema.is_splat_field(prim) or schema.is_tree(prim)


def _chosen(found: list[Appearance], reading: StageReading) -> list[Appearance]:
    """Return appearances with what is read of trees.

    Raises:
        StageError: If a tree cannot be read, or has no cut with so few splats.
        UsageError: If the choice has no effect, or no tree has that level.
    """
    choice = reading.trees
    trees = [each for each in found if schema.is_tree(each.prim)]
    if choice != LEAVES and not trees:
        expected = "one with a tree, which usdsplat lod makes; --decimate reduces fields"
        raise UsageError("level of detail", "a stage without splat trees", expected)
    if choice.view is not None:
        fields = (each for each in found if not schema.is_tree(each.prim))
        budgeted = fields if choice.view.budget else ()
        beside = sum(_splats(each, reading.time) for each in budgeted)
        chosen = _seen(trees, choice.view, beside, reading.time)
    else:
        own = [tree_reading(each.prim, choice) for each in trees]
        tops = [int(heights(each.tree.table)[0]) for each in own]
        if choice.level > max(tops, default=0):
            raise UsageError("level of detail", f"level {choice.level}", f"0 to {max(tops)}")
        chosen = {
            id(each): (one,) * len(each.to_world) for each, one in zip(trees, own, strict=True)
        }
    return [replace(each, trees=chosen.get(id(each), ())) for each in found]


def _seen(
    trees: list[Appearance], choice: ViewChoice, beside: int, time: float | None
) -> dict[int, tuple[TreeReading, ...]]:
    """Return what a picture of a view draws of each tree at each of its places, by the id() of the
    appearance.

    Args:
        trees: The trees.
        choice: The view.
        beside: Number of splats of the fields beside them.
        time: Time code at which overrides are read.
    """
    groups: dict[Sdf.Path, list[Appearance]] = {}  # native instances share a table
    for each in trees:
        prim = each.prim.GetPrimInPrototype() if each.prim.IsInstanceProxy() else each.prim
        groups.setdefault(prim.GetPath(), []).append(each)
    tables = [
        (_drawn_tree(group[0].prim, time), np.concatenate([each.to_world for each in group]))
        for group in groups.values()
    ]
    found = {}
    cuts = view_cuts(tables, choice, beside=beside)
    for group, (tree, _), own in zip(groups.values(), tables, cuts, strict=True):
        known = {id(cut): TreeReading(group[0].prim, tree, cut) for cut in own}
        readings = (known[id(cut)] for cut in own)
        for each in group:
            found[id(each)] = tuple(islice(readings, len(each.to_world)))
    return found


def _drawn_tree(prim: Usd.Prim, time: float | None) -> Tree:
    """Read a tree, with the table from which pictures choose if an override demands a level.

    Raises:
        StageError: If the tree or the override cannot be read.
    """
    tree, level = schema.read_tree(prim), tree_level(prim, code(time))
    return tree if level is None else replace(tree, table=fixed_at(tree.table, level))


def _splats(field: Appearance, time: float | None) -> int:
    """Return the number of splats of a field at all of its places."""
    when = attributes.time_code(field.prim, time)
    names = schema.tokens.POSITIONS, schema.tokens.POSITIONS_HALF
    counts = (attributes.length(field.prim, name, when) for name in names)
    return max(counts) * len(field.to_world)


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
    reading: StageReading,
    notes: list[str],
) -> Iterator[Appearance]:
    """Yield the fields of the prototypes of a point instancer, each with all its visible
    instances."""
    path = instancer.GetPath()
    if not _is_visible(instancer.GetPrim(), reading):
        notes.append(f"{path}: left out, it is not shown in renders")
        return
    to_instancer, kinds = _shown(instancer, reading.time)
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
            elif is_exported(prim) and _is_visible(prim, reading, prototype):
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
    reading: StageReading,
    root: Usd.Prim | None = None,
    shown: frozenset[Sdf.Path] = frozenset(),
) -> bool:
    """Return whether a prim is visible and of a purpose that is read; ancestors of a prototype
    `root` are ignored, and so is the own visibility of items of LOD roots that are `shown`."""
    purpose = ""
    while prim and not prim.IsPseudoRoot():
        imageable = UsdGeom.Imageable(prim)
        if imageable:
            own = imageable.GetVisibilityAttr().Get(code(reading.time))
            if own == UsdGeom.Tokens.invisible and prim.GetPath() not in shown:
                return False
            named = imageable.GetPurposeAttr()
            purpose = purpose or (str(named.Get()) if named.HasAuthoredValue() else "")
        if prim == root:
            break
        prim = prim.GetParent()
    return (purpose or UsdGeom.Tokens.default_) in reading.purposes
