"""Find the crop volumes of a field: the members of the collections of `SplatCropAPI`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pxr import Usd, UsdGeom

from usdsplat.core.errors import StageError
from usdsplat.render.specs import CropShape
from usdsplat.schema import tokens

SHAPES: dict[str, CropShape] = {
    "Sphere": "sphere",
    "Cube": "cube",
    "Cylinder": "cylinder",
    "Cone": "cone",
    "Capsule": "capsule",
    "Plane": "plane",
}
"""Prim type -> shape of its volume."""

SIZES = frozenset({"radius", "height", "size", "axis"})
"""Attributes of the shape of a volume."""

_COLLECTIONS = {tokens.CROP_INCLUDE: True, tokens.CROP_EXCLUDE: False}
_MEMBERS = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Volume:
    """A crop volume: splats inside are kept, or removed."""

    prim: Usd.Prim
    keeps: bool


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Crop:
    """The crop volumes of a field."""

    volumes: tuple[Volume, ...] = ()
    problem: StageError | None = None
    """A problem of the collections, such as prims that cannot crop."""
    signature: tuple[object, ...] = ()
    """Key that is equal if only values can have changed; computed while the prims are valid."""


NO_CROP = Crop()


def has_crop(prim: Usd.Prim) -> bool:
    """Return whether crop collections of the prim are authored.

    That suffices, whether or not `SplatCropAPI` is applied and known to USD.
    """
    return any(prim.GetAuthoredPropertiesInNamespace(f"collection:{name}") for name in _COLLECTIONS)


def find_crop(prim: Usd.Prim, *, carried: bool) -> Crop:
    """Find the crop volumes of a field; `carried` if a point instancer carries it."""
    if not has_crop(prim):
        return NO_CROP
    volumes: list[Volume] = []
    problem = None
    for name, keeps in _COLLECTIONS.items():
        for member in _members(Usd.CollectionAPI(prim, name)):
            if member.GetTypeName() in SHAPES:
                volumes.append(Volume(prim=member, keeps=keeps))
            elif not _is_group(member) and problem is None:
                found = f"{member.GetTypeName()} {member.GetPath()}, which cannot crop"
                expected = f"one of {', '.join(SHAPES)}"
                problem = StageError(f"{prim.GetPath()} collection:{name}", found, expected)
    if volumes and carried and problem is None:
        found = "crop volumes of a field that is instanced by a point instancer"
        expected = "none: such volumes do not move with the instances"
        problem = StageError(str(prim.GetPath()), found, expected)
    signature = [(each.prim.GetPath(), each.prim.GetTypeName(), each.keeps) for each in volumes]
    return Crop(volumes=tuple(volumes), problem=problem, signature=(str(problem), *signature))


def _members(collection: Usd.CollectionAPI) -> Iterator[Usd.Prim]:
    """Yield the active and loaded prims of a collection, sorted by path."""
    stage = collection.GetPrim().GetStage()
    query = collection.ComputeMembershipQuery()
    for path in Usd.CollectionAPI.ComputeIncludedPaths(query, stage, _MEMBERS):
        if path.IsPrimPath():
            yield stage.GetPrimAtPath(path)


def _is_group(prim: Usd.Prim) -> bool:
    """Return whether a prim only groups its descendants."""
    return not prim.GetTypeName() or prim.IsA(UsdGeom.Xform) or prim.IsA(UsdGeom.Scope)
