"""Prims as a tree shows them: one row each, the children when somebody opens their parent."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from pxr import Sdf, Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.errors import StageError
from usdsplat.preview.stage_model.placing import code_of
from usdsplat.sim.stage.collections import SIMULATION_TYPE, is_affector

_INVISIBLE = UsdGeom.Tokens.invisible
_EVERYTHING = Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)


@dataclass(frozen=True, slots=True, kw_only=True)
class PrimRow:
    """One prim in the tree."""

    path: str
    name: str
    type_name: str
    """Such as "Mesh"; "" for a prim without one."""
    purpose: str
    """As it is in effect, inherited or not: default, render, proxy or guide; "" without any."""
    is_visible: bool
    """Whether it can be seen at the time: neither itself nor an ancestor is invisible."""
    is_hidden_itself: bool
    """Whether it is invisible by its own word, not an ancestor's."""
    is_imageable: bool
    """Whether it has a visibility at all."""
    is_active: bool
    is_loaded: bool
    is_instance: bool
    is_in_instance: bool
    """Whether it is part of an instance, and so cannot be edited."""
    is_abstract: bool
    """Whether it is a class."""
    is_defined: bool
    """Whether it is more than opinions over nothing."""
    kind: str
    """Such as "component"; "" for none."""
    variants: tuple[tuple[str, str, tuple[str, ...]], ...]
    """Set, selection, and what it can be."""
    has_children: bool
    is_splats: bool
    is_camera: bool
    is_affector: bool
    is_simulation: bool


def children(
    stage: Usd.Stage,
    path: str = "/",
    *,
    time: float | None = None,
    undefined: bool = False,
    abstract: bool = False,
    first: int = 0,
    most: int | None = None,
) -> tuple[PrimRow, ...]:
    """The children of a prim, in their order.

    Ten thousand take about a second: ask for them in pages where there may be as many.

    Args:
        stage: Whose.
        path: Of the prim; "/" for the roots.
        time: Time code; None is USD's default time.
        undefined: Whether prims that are only opinions over nothing are shown.
        abstract: Whether classes are shown.
        first: Number of the first that is wanted.
        most: How many are wanted at most; None for all.

    Raises:
        StageError: If there is no such prim.
    """
    parent = _prim(stage, path)
    reader = _Reader(parent, time)
    found = parent.GetFilteredChildren(_shown(undefined=undefined, abstract=abstract))
    last = None if most is None else first + most
    return tuple(reader.row(child) for child in found[first:last])


def row(stage: Usd.Stage, path: str, *, time: float | None = None) -> PrimRow:
    """One prim.

    Raises:
        StageError: If there is no such prim.
    """
    prim = _prim(stage, path)
    if prim.IsPseudoRoot():
        raise StageError(path, "the root of all prims", "a prim")
    return _Reader(prim.GetParent(), time).row(prim)


def search(stage: Usd.Stage, text: str, *, most: int = 1000) -> tuple[str, ...]:
    """Paths of the prims whose name, path or type has a text in it, in the order of the stage.

    Args:
        stage: Where to look; classes and what is only opinions over nothing are left out.
        text: In upper or lower case; "*" stands for anything and "?" for any letter, and then the
            whole name, path or type must match. A text with "/" in it is looked for in paths.
        most: How many are found at most.
    """
    text = text.strip()
    if not text:
        return ()
    matches = _matcher(text)
    in_paths = "/" in text
    types: dict[str, bool] = {}
    found = []
    for prim in Usd.PrimRange.Stage(stage, _shown()):
        if in_paths:
            is_match = bool(matches(str(prim.GetPath())))
        else:
            kind = prim.GetTypeName()
            if kind not in types:
                types[kind] = bool(kind and matches(kind))
            is_match = types[kind] or bool(matches(prim.GetName()))
        if is_match:
            found.append(str(prim.GetPath()))
            if len(found) >= most:
                break
    return tuple(found)


def ancestors(path: str) -> tuple[str, ...]:
    """Paths of the prims above one, from the root down: what a tree opens to show it."""
    if not Sdf.Path.IsValidPathString(path):
        return ()
    return tuple(str(each) for each in Sdf.Path(path).GetPrimPath().GetPrefixes()[:-1])


class _Reader:
    """What the children of one prim have in common, found once."""

    def __init__(self, parent: Usd.Prim, time: float | None) -> None:
        self._code = code_of(time)
        imageable = UsdGeom.Imageable(parent)
        self._is_seen = not imageable or imageable.ComputeVisibility(self._code) != _INVISIBLE
        none = UsdGeom.Imageable.PurposeInfo()
        self._purpose = imageable.ComputePurposeInfo() if imageable else none
        self._above = "" if parent.IsPseudoRoot() else str(parent.GetPath())
        self._types: dict[str, tuple[bool, bool, bool]] = {}

    def row(self, prim: Usd.Prim) -> PrimRow:
        kind = str(prim.GetTypeName())
        if kind not in self._types:
            is_seen, is_camera = prim.IsA(UsdGeom.Imageable), prim.IsA(UsdGeom.Camera)
            self._types[kind] = is_seen, is_camera, schema.is_splat_field(prim)
        is_imageable, is_camera, is_splats = self._types[kind]
        name = prim.GetName()
        is_active = prim.IsActive()
        is_hidden, purpose = False, ""
        if is_imageable and is_active:
            is_hidden = prim.GetAttribute(UsdGeom.Tokens.visibility).Get(self._code) == _INVISIBLE
            purpose = str(UsdGeom.Imageable(prim).ComputePurposeInfo(self._purpose).purpose)
        return PrimRow(
            path=f"{self._above}/{name}",
            name=name,
            type_name=kind,
            purpose=purpose,
            is_visible=self._is_seen and not is_hidden,
            is_hidden_itself=is_hidden,
            is_imageable=is_imageable,
            is_active=is_active,
            is_loaded=prim.IsLoaded(),
            is_instance=prim.IsInstance(),
            is_in_instance=prim.IsInstanceProxy(),
            is_abstract=prim.IsAbstract(),
            is_defined=prim.IsDefined(),
            kind=prim.GetKind(),
            variants=tuple(_variants(prim)),
            has_children=bool(prim.GetFilteredChildrenNames(_EVERYTHING)),
            is_splats=is_splats,
            is_camera=is_camera,
            is_affector=is_affector(prim),
            is_simulation=kind == SIMULATION_TYPE,
        )


def _variants(prim: Usd.Prim) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    if prim.HasVariantSets():
        sets = prim.GetVariantSets()
        for name in sets.GetNames():
            chosen = sets.GetVariantSet(name)
            yield name, chosen.GetVariantSelection(), tuple(chosen.GetVariantNames())


def _shown(*, undefined: bool = False, abstract: bool = False) -> Any:
    """A predicate: which prims are there to a tree; inactive ones too, and those in instances."""
    if undefined and abstract:
        return _EVERYTHING
    flags = [] if undefined else [Usd.PrimIsDefined]
    flags += [] if abstract else [~Usd.PrimIsAbstract]
    return Usd.TraverseInstanceProxies(flags[0] & flags[1] if len(flags) == 2 else flags[0])


def _matcher(text: str) -> Callable[[str], object]:
    """A test of a text, in upper or lower case; it is true where it matches."""
    if "*" in text or "?" in text:
        return re.compile(fnmatch.translate(text), re.IGNORECASE).match
    wanted = text.lower()
    return lambda found: wanted in found.lower()


def _prim(stage: Usd.Stage, path: str) -> Usd.Prim:
    is_path = Sdf.Path.IsValidPathString(path) and Sdf.Path(path).IsAbsoluteRootOrPrimPath()
    prim = stage.GetPrimAtPath(path) if is_path else None
    if not prim:
        raise StageError(path, "no prim", "a prim of the stage")
    return prim
