"""Read LOD roots: prims with USD's LODRootAPI, whose children are levels of detail.

The schemas of UsdLod are read by name, so they need not be in USD's registry. Items of
a root are its children in order, which UsdLod's own API does not list in Python.

We choose as follows. An override of `LODOverrideAPI` at the root, or at the nearest ancestor with
one, decides: no item, all, or one by index. Otherwise the first heuristic of domain `imaging` whose
type we know chooses by screen size or by distance. Otherwise `lod:default:index` does. Between two
items, where a heuristic may blend, we draw the nearer one. An item that is chosen is drawn even if
it is invisible itself: in files for renderers without UsdLod, all items but one are.

Source: `pxr/usd/usdLod/schema.usda` of OpenUSD 26.11.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from usdsplat.core.cloud import F64
from usdsplat.core.errors import StageError
from usdsplat.core.lod_heuristics import LodHeuristic, LodView, Metric, nearest_index
from usdsplat.schema import tokens
from usdsplat.schema.stage_values import local_to_world
from usdsplat.schema.values import vectors

Mode = Literal["noOverride", "indexedLOD", "noLOD", "allLOD"]

ROOT_API, OVERRIDE_API = "LODRootAPI", "LODOverrideAPI"
SCREEN_SIZE, DISTANCE = "LODScreenSizeHeuristic", "LODDistanceHeuristic"
IMAGING = "imaging"
DEFAULT_INDEX, HEURISTICS = "lod:default:index", "lod:heuristics"

_MODES = ("noOverride", "indexedLOD", "noLOD", "allLOD")
_MOST_LEVELS = 64
"""Above the number of levels of any tree."""
_IN_WORLD = Usd.TraverseInstanceProxies()
_Type = Sdf.ValueTypeNames


@dataclass(frozen=True, slots=True, kw_only=True)
class LodRoot:
    """An LOD root as read from a stage."""

    path: str
    items: tuple[str, ...]
    """Paths of the items, the finest first by custom."""
    default: int
    """Index of the item without a heuristic, in the range of the items."""
    mode: Mode
    """Override that acts on the root."""
    index: float
    """Index of the override `indexedLOD`."""
    heuristic: LodHeuristic | None

    def shown(self, view: LodView | None = None, to_world: F64 | None = None) -> tuple[str, ...]:
        """Return the paths of the items to draw.

        Args:
            view: The view; None for the choice that depends on none.
            to_world: Matrix from the space of the root to the world, for column vectors; None for
                the identity.
        """
        if self.mode == "allLOD":
            return self.items
        if self.mode == "noLOD" or not self.items:
            return ()
        level: float = self.default
        if self.mode == "indexedLOD":
            level = self.index
        elif self.heuristic is not None and view is not None:
            level = self.heuristic.level(view, np.eye(4) if to_world is None else to_world)
        return (self.items[nearest_index(level, len(self.items))],)


def is_lod_root(prim: Usd.Prim) -> bool:
    """Return whether a prim has LODRootAPI, whether USD knows it or not."""
    return bool(prim) and _has_api(prim, ROOT_API)


def read_lod_root(prim: Usd.Prim, time: Usd.TimeCode) -> LodRoot:
    """Read an LOD root, its override and its first heuristic that we know.

    Raises:
        StageError: If the prim is no LOD root, or an attribute has a value of another type than the
            schema's.
    """
    if not is_lod_root(prim):
        raise StageError(str(prim.GetPath()) if prim else "prim", f"no {ROOT_API}", "an LOD root")
    items = tuple(str(child.GetPath()) for child in prim.GetFilteredChildren(_IN_WORLD))
    default = _number(prim, DEFAULT_INDEX, time, 0.0)
    mode, index = _override(prim, time)
    return LodRoot(
        path=str(prim.GetPath()),
        items=items,
        default=nearest_index(default, max(1, len(items))),
        mode=mode,
        index=index,
        heuristic=_heuristic(prim, time),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemChoice:
    """Which items of the LOD roots of a stage are drawn."""

    shown: frozenset[Sdf.Path]
    """Items that are drawn even if they are invisible themselves."""
    hidden: frozenset[Sdf.Path]
    """Items that are not drawn."""
    problems: tuple[StageError, ...]
    """Roots that cannot be read; their items are drawn as the rest of the stage."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LodRoots:
    """The LOD roots of a stage."""

    prims: tuple[Usd.Prim, ...]
    replaced: frozenset[Sdf.Path]
    """Roots that a splat tree names, which is drawn instead of their items."""

    def is_replaced(self, prim: Usd.Prim) -> bool:
        """Return whether a tree is drawn instead of a prim."""
        return not self.replaced.isdisjoint(prim.GetPath().GetParentPath().GetPrefixes())


def find_roots(stage: Usd.Stage) -> LodRoots:
    """Find the LOD roots of a stage, in every instance. Each prototype is searched once."""
    prims: list[Usd.Prim] = []
    replaced: set[Sdf.Path] = set()
    for path in _roots_and_trees(Usd.PrimRange.Stage(stage), {}):
        prim = stage.GetPrimAtPath(path)
        if is_lod_root(prim):
            prims.append(prim)
        else:
            replaced.update(prim.GetRelationship(tokens.LOD_ROOT).GetForwardedTargets())
    return LodRoots(prims=tuple(prims), replaced=frozenset(replaced))


def _roots_and_trees(
    prims: Iterable[Usd.Prim], known: dict[Sdf.Path, tuple[Sdf.Path, ...]]
) -> Iterator[Sdf.Path]:
    """Yield the paths of the LOD roots and trees among prims, and in the instances among them.

    Args:
        prims: Prims of the stage or of a prototype, without instance proxies.
        known: Results for the prims below prototypes; those of others are added.
    """
    for prim in prims:
        info = prim.GetPrimTypeInfo()  # the fastest way to both names
        if ROOT_API in info.GetAppliedAPISchemas() or info.GetTypeName() == tokens.TREE_TYPE:
            yield prim.GetPath()
        if prim.IsInstance():
            prototype = prim.GetPrototype()
            root = prototype.GetPath()
            if root not in known:
                below = (each for each in Usd.PrimRange(prototype) if each != prototype)
                known[root] = tuple(_roots_and_trees(below, known))
            for path in known[root]:
                yield path.ReplacePrefix(root, prim.GetPath())


def choose_items(roots: LodRoots, time: Usd.TimeCode, view: LodView | None = None) -> ItemChoice:
    """Choose the items of LOD roots.

    Args:
        roots: The roots, on a stage that has not changed since.
        time: Time at which overrides, heuristics and transforms are read.
        view: The view; None for the choice that depends on none. Roots below point instancers are
            chosen without it, because each instance would have another size.
    """
    shown: set[Sdf.Path] = set()
    hidden: set[Sdf.Path] = set()
    problems: list[StageError] = []
    places = UsdGeom.XformCache(time)
    for prim in roots.prims:
        children = {child.GetPath() for child in prim.GetFilteredChildren(_IN_WORLD)}
        if prim.GetPath() in roots.replaced:
            hidden |= children
            continue
        try:
            root = read_lod_root(prim, time)
            own = None if root.heuristic is None or _is_scattered(prim) else view
            to_world = np.array(local_to_world(prim, places)).T if own else None
            chosen = {Sdf.Path(path) for path in root.shown(own, to_world)}
        except StageError as error:
            problems.append(error)
            continue
        shown |= chosen
        hidden |= children - chosen
    return ItemChoice(shown=frozenset(shown), hidden=frozenset(hidden), problems=tuple(problems))


def item_choice(stage: Usd.Stage, time: Usd.TimeCode) -> ItemChoice:
    """Choose the items of all LOD roots of a stage without regard to a view."""
    return choose_items(find_roots(stage), time)


def tree_level(prim: Usd.Prim, time: Usd.TimeCode) -> int | None:
    """Return the level of a splat tree that an override demands; None if views choose.

    The override is that of the tree itself, or else the one that acts on the LOD root that the tree
    names; of a tree without a root, the nearest one above it. `indexedLOD` is a level of the tree,
    0 the leaves and one above the root's the root; `allLOD` and `noLOD` are the leaves, because a
    tree is no item.

    Args:
        prim: The tree.
        time: Time of the override.

    Raises:
        StageError: If the index has another type than the schema's.
    """
    named = prim.GetRelationship(tokens.LOD_ROOT)
    targets = named.GetForwardedTargets() if named else ()
    root = prim.GetStage().GetPrimAtPath(targets[0]) if targets else None
    own = _own_override(prim, time)
    mode, index = own or _override(root or prim, time)
    if mode == "noOverride":
        return None
    return nearest_index(index, _MOST_LEVELS) if mode == "indexedLOD" else 0


def _has_api(prim: Usd.Prim, name: str) -> bool:
    """Return whether an API schema is applied, whether USD knows it or not."""
    return name in prim.GetPrimTypeInfo().GetAppliedAPISchemas()


def _is_scattered(prim: Usd.Prim) -> bool:
    """Return whether a prim is below a point instancer."""
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.PointInstancer):
            return True
        prim = prim.GetParent()
    return False


def _override(prim: Usd.Prim, time: Usd.TimeCode) -> tuple[Mode, float]:
    """Return the override that acts on a root, and its index."""
    while prim and not prim.IsPseudoRoot():
        if found := _own_override(prim, time):
            return found
        prim = prim.GetParent()
    return "noOverride", 0.0


def _own_override(prim: Usd.Prim, time: Usd.TimeCode) -> tuple[Mode, float] | None:
    """Return the override of a prim itself, and its index; None if it has none."""
    if not _has_api(prim, OVERRIDE_API):
        return None
    attribute = prim.GetAttribute("lod:override:mode")
    mode = attribute.Get(time) if attribute and attribute.HasAuthoredValue() else None
    if mode not in _MODES:
        return None
    return cast(Mode, str(mode)), _number(prim, "lod:override:index", time, 0.0)


def _heuristic(prim: Usd.Prim, time: Usd.TimeCode) -> LodHeuristic | None:
    """Return the first heuristic of a root that we know."""
    relationship = prim.GetRelationship(HEURISTICS)
    stage = prim.GetStage()
    for target in relationship.GetForwardedTargets() if relationship else ():
        found = stage.GetPrimAtPath(target)
        kind = str(found.GetTypeName()) if found else ""
        domain = found.GetAttribute("lod:domain").Get() if kind in (SCREEN_SIZE, DISTANCE) else None
        if domain == IMAGING:
            return _read_heuristic(found, kind, time)
    return None


def _read_heuristic(prim: Usd.Prim, kind: str, time: Usd.TimeCode) -> LodHeuristic:
    box = _box(prim, time)
    if kind == DISTANCE and box is None:
        found = _value(prim, "center", time)
        centre = np.zeros(3) if found is None else _vector(prim, "center", found)
        box = np.stack([centre, centre])
    if box is None:
        box = np.array([[-1.0] * 3, [1.0] * 3])
    low, high = (tuple(map(float, corner)) for corner in box)
    return LodHeuristic(
        metric=_metric(prim, kind, time),
        low=cast(tuple[float, float, float], low),
        high=cast(tuple[float, float, float], high),
        thresholds=_numbers(prim, "thresholds", time),
        blend_thresholds=_numbers(prim, "blendThresholds", time),
    )


def _metric(prim: Usd.Prim, kind: str, time: Usd.TimeCode) -> Metric:
    """Return what a heuristic measures; an unknown method counts as a box, as in UsdLod."""
    if kind == DISTANCE:
        return "distance"
    method = _value(prim, "projectionMethod", time)
    return "sphere" if method in (None, "projectedSphere") else "box"


def _box(prim: Usd.Prim, time: Usd.TimeCode) -> F64 | None:
    """Return the box of a heuristic: that of its bounding volume, else its own; or None."""
    relationship = prim.GetRelationship("boundingVolume")
    targets = relationship.GetForwardedTargets() if relationship else ()
    places = [prim.GetStage().GetPrimAtPath(target) for target in targets]
    for each in (*filter(None, places), prim):
        found = _value(each, tokens.EXTENT, time)
        corners = None if found is None else vectors(f"{each.GetPath()}.extent", found, 3)
        if corners is not None and len(corners) == 2 and (corners[0] <= corners[1]).all():
            return corners.astype(np.float64)
    return None


def _value(prim: Usd.Prim, name: str, time: Usd.TimeCode) -> Any:
    attribute = prim.GetAttribute(name)
    return attribute.Get(time) if attribute else None


def _vector(prim: Usd.Prim, name: str, found: Any) -> F64:
    vector = vectors(f"{prim.GetPath()}.{name}", [found], 3)
    return vector[0].astype(np.float64)


def _numbers(prim: Usd.Prim, name: str, time: Usd.TimeCode) -> tuple[float, ...]:
    found = vectors(f"{prim.GetPath()}.{name}", _value(prim, name, time), 1)
    return tuple(map(float, found[:, 0]))


def _number(prim: Usd.Prim, name: str, time: Usd.TimeCode, fallback: float) -> float:
    found = _value(prim, name, time)
    if found is None:
        return fallback
    if not isinstance(found, int | float):
        raise StageError(f"{prim.GetPath()}.{name}", repr(found), "a number")
    return float(found)
