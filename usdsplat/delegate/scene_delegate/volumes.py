"""Find the crop volumes of a field: the members of the collections of `SplatCropAPI`."""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass

from pxr import Sdf, Usd, UsdGeom

from usdsplat.core.findings import Finding, finding
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
    findings: tuple[Finding, ...] = ()
    """Problems of the collections, such as prims that cannot crop."""
    signature: tuple[object, ...] = ()
    """Key that is equal if only values can have changed; computed while the prims are valid."""


NO_CROP = Crop()


def has_crop(prim: Usd.Prim) -> bool:
    """Return whether crop collections of the prim itself are authored.

    That suffices, whether or not `SplatCropAPI` is applied and known to USD.
    """
    return any(_has_collection(prim, name) for name in _COLLECTIONS)


def _has_collection(prim: Usd.Prim, name: str) -> bool:
    return bool(prim.GetAuthoredPropertiesInNamespace(f"collection:{name}"))


def lineage(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Yield a prim and its ancestors, the nearest first."""
    while prim and not prim.IsPseudoRoot():
        yield prim
        prim = prim.GetParent()


def find_crop(prim: Usd.Prim, *, roots: Container[Sdf.Path]) -> Crop:
    """Find the crop volumes of a field.

    A field inherits the crops of its ancestors: the nearest collection that includes, and all that
    exclude.

    Args:
        prim: The field.
        roots: Paths of the roots of the prototypes of point instancers that carry it.
    """
    croppers = [each for each in lineage(prim) if has_crop(each)]
    if not croppers:
        return NO_CROP
    volumes: list[Volume] = []
    acting: list[Usd.Prim] = []
    findings: list[Finding] = []
    for name, keeps in _COLLECTIONS.items():
        owners = [each for each in croppers if _has_collection(each, name)]
        for owner in owners[:1] if keeps else owners:
            members = [
                Volume(prim=member, keeps=keeps)
                for member in _members(Usd.CollectionAPI(owner, name))
                if member.GetTypeName() in SHAPES
            ]
            acting += [owner] if members else []
            known = {(each.prim.GetPath(), each.keeps) for each in volumes}
            volumes += [each for each in members if (each.prim.GetPath(), keeps) not in known]
            findings += _problems(owner, name, has_volumes=bool(members))
    if any(path in roots for each in acting for path in each.GetPath().GetPrefixes()):
        found = "crop volumes of a field that is instanced by a point instancer"
        expected = "none: such volumes do not move with the instances"
        findings.append(finding("crop-member", str(prim.GetPath()), found, expected))
    signature = [(each.prim.GetPath(), each.prim.GetTypeName(), each.keeps) for each in volumes]
    told = tuple(each.key for each in findings)
    return Crop(volumes=tuple(volumes), findings=tuple(findings), signature=(told, *signature))


def _problems(prim: Usd.Prim, name: str, *, has_volumes: bool) -> Iterator[Finding]:
    """Yield what a crop collection asks for and does not get."""
    stage, where = prim.GetStage(), f"{prim.GetPath()}.collection:{name}"
    includes = prim.GetRelationship(f"collection:{name}:includes")
    targets = includes.GetForwardedTargets() if includes else []
    missing = [path for path in targets if not stage.GetPrimAtPath(path.GetPrimPath())]
    for path in missing:
        yield finding("missing-prim", where, f"{path}, which does not exist", "a crop volume")
    for member in _members(Usd.CollectionAPI(prim, name)):
        if member.GetTypeName() not in SHAPES and not _is_group(member):
            found = f"{member.GetTypeName()} {member.GetPath()}, which cannot crop"
            yield finding("crop-member", where, found, f"one of {', '.join(SHAPES)}")
    if len(targets) > len(missing) and not has_volumes:
        found = "a collection without crop volumes"
        yield finding("empty-crop", where, found, f"one of {', '.join(SHAPES)}")


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
