"""List prims as rows of a tree, whose children are read when a parent is expanded."""

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
    """A prim in the tree."""

    path: str
    name: str
    type_name: str
    """Type of the prim, such as "Mesh"; "" for none."""
    purpose: str
    """Computed purpose, inherited or not: default, render, proxy or guide; "" for none."""
    is_visible: bool
    """Whether it is visible at the time: neither it nor an ancestor is invisible."""
    is_hidden_itself: bool
    """Whether its own visibility is "invisible"."""
    is_imageable: bool
    """Whether it has a visibility attribute."""
    is_active: bool
    is_loaded: bool
    is_instance: bool
    is_in_instance: bool
    """Whether it is in an instance and cannot be edited."""
    is_abstract: bool
    """Whether it is an abstract class prim."""
    is_defined: bool
    """Whether it is defined, rather than only overrides."""
    kind: str
    """Kind, such as "component"; "" for none."""
    variants: tuple[tuple[str, str, tuple[str, ...]], ...]
    """Variant set, selection and choices."""
    has_children: bool
    is_splats: bool
    """Whether it is a splat field or a splat tree."""
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
    """Return the children of a prim, in stage order.

    Ten thousand children take about a second: request pages where that is possible.

    Args:
        stage: The stage.
        path: Path of the prim; "/" for the roots.
        time: Time code; None is USD's default time.
        undefined: Whether prims that only have overrides are listed.
        abstract: Whether class prims are listed.
        first: Index of the first child.
        most: Most children; None for all.

    Raises:
        StageError: If there is no such prim.
    """
    parent = _prim(stage, path)
    reader = _Reader(parent, time)
    found = parent.GetFilteredChildren(_shown(undefined=undefined, abstract=abstract))
    last = None if most is None else first + most
    return tuple(reader.row(child) for child in found[first:last])


def search(stage: Usd.Stage, text: str, *, most: int = 1000) -> tuple[str, ...]:
    """Return the paths of prims whose name, path or type contains a text, in stage order.

    Args:
        stage: The stage; class prims and prims with only overrides are left out.
        text: Ignoring case; "*" matches any text and "?" any character, and then the whole name,
            path or type must match. A text with "/" is matched with paths.
        most: Most results.
    """
    text = text.strip()
    if not text:
        return ()
    matches = matcher(text)
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


def path_of(stage: Usd.Stage, path: str) -> str:
    """Return the path of a prim.

    Raises:
        StageError: If there is no such prim.
    """
    return str(_prim(stage, path).GetPath())


class _Reader:
    """Reads rows of the children of one prim, with the shared state computed once."""

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
            is_splats = schema.is_splat_field(prim) or schema.is_tree(prim)
            self._types[kind] = is_seen, is_camera, is_splats
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
    """Return the predicate of listed prims; inactive ones and those in instances are included."""
    if undefined and abstract:
        return _EVERYTHING
    flags = [] if undefined else [Usd.PrimIsDefined]
    flags += [] if abstract else [~Usd.PrimIsAbstract]
    return Usd.TraverseInstanceProxies(flags[0] & flags[1] if len(flags) == 2 else flags[0])


def matcher(text: str) -> Callable[[str], object]:
    """Return a function that tests whether a text matches, ignoring case, as `search` has it."""
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
