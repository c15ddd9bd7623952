"""Walk a stage for the prims that matter: fields, instancers, cameras.

A field may be seen many times: through native instances, where its arrays are those of one prim in
a prototype, and through point instancers, nested to any depth. Everything that shares its arrays
becomes one entry, named after the first path by which it is seen: paths inside prototypes are
USD's own and change from one stage to the next.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from pxr import Usd, UsdGeom

from usdsplat import schema
from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.delegate.instancing import Link, Placement
from usdsplat.delegate.scene_delegate.volumes import NO_CROP, Crop, find_crop, has_crop

Kind = Literal["field", "instancer", "camera", ""]

IN_WORLD = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
IN_PROTOTYPE = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
"""Prototypes may be kept under an `over` or a `class`, so that they do not show by themselves."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Level:
    """An instancer, or at last the field, where it stands."""

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
    """One way by which a field is seen."""

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
class FieldEntry:
    """A splat prim and all its appearances."""

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

    fields: dict[str, FieldEntry] = field(default_factory=dict)
    instancers: dict[str, Usd.Prim] = field(default_factory=dict)
    cameras: dict[str, Usd.Prim] = field(default_factory=dict)
    problems: dict[str, UsdSplatError] = field(default_factory=dict)
    """Path -> why something there was left out."""

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
            if kind == "field":
                self._add_field(prim, links, levels)
            elif kind == "instancer":
                prims.PruneChildren()  # prototypes beneath an instancer show through it only
                self._enter(prim, links, levels)
            elif not links:
                self._found.cameras[str(prim.GetPath())] = prim

    def finish(self) -> Population:
        """Name the entries and put their appearances in order."""
        for seen in self._seen.values():
            seen.sort(key=lambda appearance: appearance.order)
            path = seen[0].placement.path
            source = source_of(seen[0].levels[-1].prim)
            signature = (source.GetPath(), *(appearance.signature for appearance in seen))
            carried = any(appearance.placement.links for appearance in seen)
            crop = find_crop(seen[0].levels[-1].prim, carried=carried)
            self._found.fields[path] = FieldEntry(
                source=source, appearances=tuple(seen), signature=signature, crop=crop
            )
        return self._found

    def _kind(self, prim: Usd.Prim) -> Kind:
        """What a prim is to us, looked up once for each type."""
        name = prim.GetTypeName()
        if name not in self._kinds:
            self._kinds[name] = _classify(prim)
        return self._kinds[name]

    def _add_field(
        self, prim: Usd.Prim, links: tuple[Link, ...], levels: tuple[Level, ...]
    ) -> None:
        placement = Placement(path=str(prim.GetPath()), links=links)
        appearance = Appearance(placement=placement, levels=levels)
        key = (source_of(prim).GetPath(), _inherited_space(prim), _cropped_alone(prim))
        self._seen.setdefault(key, []).append(appearance)

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


def _classify(prim: Usd.Prim) -> Kind:
    if schema.is_splat_field(prim):
        return "field"
    if prim.IsA(UsdGeom.PointInstancer):
        return "instancer"
    return "camera" if prim.IsA(UsdGeom.Camera) else ""


def _cropped_alone(prim: Usd.Prim) -> str:
    """What keeps instances apart that are cropped: each one has its own volumes in the world."""
    return str(prim.GetPath()) if prim.IsInstanceProxy() and has_crop(prim) else ""


def _inherited_space(prim: Usd.Prim) -> str:
    """What an instance inherits and its prototype cannot know: the colour space named above it."""
    return schema.color_space(prim) if prim.IsInstanceProxy() else ""
