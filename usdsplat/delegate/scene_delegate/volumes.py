"""Which prims a field is cropped by: what is in the collections of `SplatCropAPI`."""

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
"""Type of a prim -> the shape of its volume."""

SIZES = frozenset({"radius", "height", "size", "axis"})
"""What the shape of a volume is read from."""

_COLLECTIONS = {tokens.CROP_INCLUDE: True, tokens.CROP_EXCLUDE: False}
_MEMBERS = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Volume:
    """A prim by which splats are kept, or left out."""

    prim: Usd.Prim
    keeps: bool


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Crop:
    """What the crop collections of one field hold."""

    volumes: tuple[Volume, ...] = ()
    problem: StageError | None = None
    """What else is in them, or why they do not do what somebody may expect."""
    signature: tuple[object, ...] = ()
    """Equal when nothing but values can have changed; taken while the prims are valid."""


NO_CROP = Crop()


def has_crop(prim: Usd.Prim) -> bool:
    """Whether anything is said about crop collections of the prim.

    That is enough, whether `SplatCropAPI` is applied, and known to USD, or not.
    """
    return any(prim.GetAuthoredPropertiesInNamespace(f"collection:{name}") for name in _COLLECTIONS)


def find_crop(prim: Usd.Prim, *, carried: bool) -> Crop:
    """Look up which volumes the field `prim` is cropped by; `carried` if by a point instancer."""
    if not has_crop(prim):
        return NO_CROP
    volumes: list[Volume] = []
    problem = None
    for name, keeps in _COLLECTIONS.items():
        for member in _members(Usd.CollectionAPI(prim, name)):
            if member.GetTypeName() in SHAPES:
                volumes.append(Volume(prim=member, keeps=keeps))
            elif not _is_group(member) and problem is None:
                found = f"{member.GetTypeName()} {member.GetPath()}, which crops nothing"
                expected = f"one of {', '.join(SHAPES)}"
                problem = StageError(f"{prim.GetPath()} collection:{name}", found, expected)
    if volumes and carried and problem is None:
        found = "crop volumes of a field that a point instancer carries"
        expected = "none; they stay where they are authored"
        problem = StageError(str(prim.GetPath()), found, expected)
    signature = [(each.prim.GetPath(), each.prim.GetTypeName(), each.keeps) for each in volumes]
    return Crop(volumes=tuple(volumes), problem=problem, signature=(str(problem), *signature))


def _members(collection: Usd.CollectionAPI) -> Iterator[Usd.Prim]:
    """Prims of a collection, sorted by path; those that are not active or loaded are none."""
    stage = collection.GetPrim().GetStage()
    query = collection.ComputeMembershipQuery()
    for path in Usd.CollectionAPI.ComputeIncludedPaths(query, stage, _MEMBERS):
        if path.IsPrimPath():
            yield stage.GetPrimAtPath(path)


def _is_group(prim: Usd.Prim) -> bool:
    """Whether a prim is there for what is beneath it only."""
    return not prim.GetTypeName() or prim.IsA(UsdGeom.Xform) or prim.IsA(UsdGeom.Scope)
