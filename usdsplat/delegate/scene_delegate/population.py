"""Walk a stage for the prims that matter: fields, meshes, instancers, cameras, lights.

A field or a mesh may be seen many times: through native instances, where its arrays are those of
one prim in a prototype, and through point instancers, nested to any depth. Everything that shares
its arrays becomes one entry, named after the first path by which it is seen: paths inside
prototypes are USD's own and change from one stage to the next. Instances of one mesh that inherit
other colours, materials or skeletons from above them are other entries.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdSkel

from usdsplat import schema
from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.delegate.instancing import Link, Placement
from usdsplat.delegate.scene_delegate.notices import INHERITED
from usdsplat.delegate.scene_delegate.volumes import NO_CROP, Crop, find_crop, has_crop

Kind = Literal["field", "mesh", "instancer", "camera", "light", ""]

SHAPES = (
    UsdGeom.Mesh,
    UsdGeom.Sphere,
    UsdGeom.Cube,
    UsdGeom.Cylinder,
    UsdGeom.Cylinder_1,
    UsdGeom.Cone,
    UsdGeom.Capsule,
    UsdGeom.Capsule_1,
    UsdGeom.Plane,
)
"""What is drawn as a surface."""

IN_WORLD = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
IN_PROTOTYPE = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
"""Prototypes may be kept under an `over` or a `class`, so that they do not show by themselves."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Level:
    """An instancer, or at last the field or mesh, where it stands."""

    prim: Usd.Prim
    root: Usd.Prim | None
    """The prototype it is in; None in the world."""

    def lineage(self) -> Iterator[Usd.Prim]:
        """The prim and its ancestors, as far as they place it: up to the prototype's root."""
        prim = self.prim
        while prim and not prim.IsPseudoRoot():
            yield prim
            if prim == self.root:
                return
            prim = prim.GetParent()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Appearance:
    """One way by which a field or a mesh is seen."""

    placement: Placement
    levels: tuple[Level, ...]
    """Outermost first; one more than the placement has links."""

    @property
    def signature(self) -> tuple[object, ...]:
        """Equal when nothing but values can have changed."""
        roots = (level.root and level.root.GetPath() for level in self.levels)
        return (self.placement, *(level.prim.GetPath() for level in self.levels), *roots)

    @property
    def order(self) -> tuple[object, ...]:
        """Appearances are listed by path, then by the instancers that they come through."""
        links = tuple((link.instancer, link.prototype) for link in self.placement.links)
        return self.placement.path, links


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RprimEntry:
    """A field or a mesh and all its appearances."""

    source: Usd.Prim
    """Where the arrays are; in a prototype when all appearances are in native instances."""
    appearances: tuple[Appearance, ...]
    signature: tuple[object, ...]
    """Where the arrays are, then how it is seen; taken while the prims are valid."""
    crop: Crop = NO_CROP

    @property
    def prim(self) -> Usd.Prim:
        """The first appearance: unlike `source` it inherits what is said above its instance."""
        return self.appearances[0].levels[-1].prim


@dataclass(slots=True, eq=False)
class Population:
    """Everything that a stage holds for us."""

    fields: dict[str, RprimEntry] = field(default_factory=dict)
    meshes: dict[str, RprimEntry] = field(default_factory=dict)
    instancers: dict[str, Usd.Prim] = field(default_factory=dict)
    cameras: dict[str, Usd.Prim] = field(default_factory=dict)
    lights: dict[str, Usd.Prim] = field(default_factory=dict)
    problems: dict[str, UsdSplatError] = field(default_factory=dict)
    """Path -> why something there was left out."""

    def rprims(self) -> Iterator[tuple[str, RprimEntry]]:
        """Fields and meshes, each with its path."""
        yield from self.fields.items()
        yield from self.meshes.items()

    @property
    def crop_volumes(self) -> frozenset[str]:
        """Paths of all prims that a field is cropped by: they are not drawn as surfaces."""
        return frozenset(
            str(volume.prim.GetPath())
            for entry in self.fields.values()
            for volume in entry.crop.volumes
        )


def source_of(prim: Usd.Prim) -> Usd.Prim:
    """The prim whose opinions an instance proxy shows; any other prim itself."""
    return prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim


def populate(stage: Usd.Stage) -> Population:
    """Walk the whole stage."""
    walk = _Walk(stage)
    walk.scan(stage.GetPseudoRoot(), (), ())
    return walk.finish()


class _Walk:
    """The state of one walk."""

    def __init__(self, stage: Usd.Stage) -> None:
        self._stage = stage
        self._kinds: dict[str, Kind] = {}
        self._seen: dict[tuple[object, ...], list[Appearance]] = {}
        self._above: dict[Sdf.Path, tuple[Sdf.Path, ...]] = {}
        self._found = Population()

    def scan(self, root: Usd.Prim, links: tuple[Link, ...], outer: tuple[Level, ...]) -> None:
        """Collect what is at and beneath `root`: the stage's, or the root of a prototype."""
        defined = not links or (root.IsDefined() and not root.IsAbstract())
        prims = iter(Usd.PrimRange(root, IN_WORLD if defined else IN_PROTOTYPE))
        for prim in prims:
            kind = self._kind(prim)
            if not kind:
                continue
            levels = (*outer, Level(prim=prim, root=root if links else None))
            if kind == "field" or kind == "mesh":
                self._add_rprim(kind, prim, links, levels)
            elif kind == "instancer":
                prims.PruneChildren()  # prototypes beneath an instancer show through it only
                self._enter(prim, links, levels)
            elif not links:
                found = self._found.cameras if kind == "camera" else self._found.lights
                found[str(prim.GetPath())] = prim

    def finish(self) -> Population:
        """Name the entries and put their appearances in order."""
        for (kind, *_), seen in self._seen.items():
            if kind == "field":
                carried = any(appearance.placement.links for appearance in seen)
                seen.sort(key=lambda appearance: appearance.order)
                crop = find_crop(seen[0].levels[-1].prim, carried=carried)
                _enlist(self._found.fields, seen, crop)
        volumes = self._found.crop_volumes
        for (kind, *_), seen in self._seen.items():
            drawn = [each for each in seen if each.placement.path not in volumes]
            if kind == "mesh" and drawn:
                drawn.sort(key=lambda appearance: appearance.order)
                _enlist(self._found.meshes, drawn, NO_CROP)
        return self._found

    def _kind(self, prim: Usd.Prim) -> Kind:
        """What a prim is to us, looked up once for each type."""
        name = prim.GetTypeName()
        if name not in self._kinds:
            self._kinds[name] = _classify(prim)
        return self._kinds[name]

    def _add_rprim(
        self, kind: Kind, prim: Usd.Prim, links: tuple[Link, ...], levels: tuple[Level, ...]
    ) -> None:
        placement = Placement(path=str(prim.GetPath()), links=links)
        appearance = Appearance(placement=placement, levels=levels)
        inherited: tuple[object, ...] = (_inherited_space(prim), _cropped_alone(prim))
        if kind == "mesh":
            inherited = self._inherited_looks(prim)
        key = (kind, source_of(prim).GetPath(), inherited)
        self._seen.setdefault(key, []).append(appearance)

    def _inherited_looks(self, prim: Usd.Prim) -> tuple[Sdf.Path, ...]:
        """The prims above an instance from which what is in it inherits what it looks like."""
        if not prim.IsInstanceProxy():
            return ()
        while not prim.IsInstance():
            prim = prim.GetParent()
        path = prim.GetPath()
        if path not in self._above:
            self._above[path] = _givers(prim)
        return self._above[path]

    def _enter(
        self, instancer: Usd.Prim, links: tuple[Link, ...], levels: tuple[Level, ...]
    ) -> None:
        """Scan an instancer's prototypes."""
        path = str(instancer.GetPath())
        if any(link.instancer == path for link in links):
            found = "an instancer that is among its own prototypes"
            self._found.problems[path] = StageError(path, found, "prototypes without a cycle")
            return
        self._found.instancers[path] = instancer
        targets = UsdGeom.PointInstancer(instancer).GetPrototypesRel().GetForwardedTargets()
        for number, target in enumerate(targets):
            root = self._stage.GetPrimAtPath(target)
            if root:
                self.scan(root, (*links, Link(instancer=path, prototype=number)), levels)
            else:
                error = StageError(path, f"no prim at its prototype {target}", "an existing one")
                self._found.problems[path] = error


def _enlist(entries: dict[str, RprimEntry], seen: list[Appearance], crop: Crop) -> None:
    """Add what is seen by all of these appearances, named after the first of them."""
    source = source_of(seen[0].levels[-1].prim)
    entries[seen[0].placement.path] = RprimEntry(
        source=source,
        appearances=tuple(seen),
        signature=(source.GetPath(), *(appearance.signature for appearance in seen)),
        crop=crop,
    )


def _classify(prim: Usd.Prim) -> Kind:
    if schema.is_splat_field(prim):
        return "field"
    if any(prim.IsA(shape) for shape in SHAPES):
        return "mesh"
    if prim.IsA(UsdGeom.PointInstancer):
        return "instancer"
    if prim.IsA(UsdGeom.Camera):
        return "camera"
    return "light" if prim.IsA(UsdLux.DistantLight) else ""


def _givers(prim: Usd.Prim) -> tuple[Sdf.Path, ...]:
    """Which of an instance and the prims above it say what a mesh beneath them looks like."""
    found = []
    while not prim.IsPseudoRoot():
        names = prim.GetAuthoredPropertyNames()
        if prim.IsA(UsdSkel.Root) or any(name.startswith(INHERITED) for name in names):
            found.append(source_of(prim).GetPath())
        prim = prim.GetParent()
    return tuple(found)


def _cropped_alone(prim: Usd.Prim) -> str:
    """What keeps instances apart that are cropped: each one has its own volumes in the world."""
    return str(prim.GetPath()) if prim.IsInstanceProxy() and has_crop(prim) else ""


def _inherited_space(prim: Usd.Prim) -> str:
    """What an instance inherits and its prototype cannot know: the colour space named above it."""
    return schema.color_space(prim) if prim.IsInstanceProxy() else ""
