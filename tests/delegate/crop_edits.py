"""Random edits of crop volumes."""

from __future__ import annotations

from pxr import Usd, UsdGeom

VOLUMES = ("Sphere", "Cube", "Cylinder", "Cone", "Capsule", "Plane")


def crop(field: Usd.Prim, path: str) -> None:
    """Keep what is inside a new sphere at `path`."""
    UsdGeom.Sphere.Define(field.GetStage(), path)
    field.ApplyAPI("SplatCropAPI")
    Usd.CollectionAPI(field, "cropInclude").CreateIncludesRel().SetTargets([path])


class CropEdits:
    """The part of an `Editor` that makes volumes and collections."""

    def _volume(self) -> Usd.Prim | None:
        return self._prim(lambda each: each.GetTypeName() in VOLUMES)

    def restructure_add_volume(self) -> None:
        prim = self.stage.DefinePrim(self._new_path(), self._random.choice(VOLUMES))
        UsdGeom.Xformable(prim).MakeMatrixXform().Set(self._matrix())

    def restructure_crop(self) -> None:
        if prim := self._field():
            prim.ApplyAPI("SplatCropAPI")
            self._gather(
                Usd.CollectionAPI(prim, self._random.choice(["cropInclude", "cropExclude"]))
            )

    def restructure_nested_collection(self) -> None:
        if prim := self._prim():
            self._gather(Usd.CollectionAPI.Apply(prim, "nested"))

    def _gather(self, collection: Usd.CollectionAPI) -> None:
        """Let a collection hold a volume, anything at all, and perhaps another collection."""
        prims = [prim for prim in (self._volume(), self._prim()) if prim]
        targets = [prim.GetPath() for prim in prims]
        owner = self._prim(lambda each: each.HasAPI("CollectionAPI", "nested"))
        if owner and self._random.random() < 0.5:
            targets.append(owner.GetPath().AppendProperty("collection:nested"))
        collection.CreateIncludesRel().SetTargets(targets)
        if self._random.random() < 0.3:
            collection.CreateExcludesRel().SetTargets(targets[:1])
        rules = ("expandPrims", "explicitOnly")
        collection.CreateExpansionRuleAttr(self._random.choice(rules))

    def set_volume(self) -> None:
        if prim := self._volume():
            names = [name for name in ("radius", "height", "size") if prim.HasAttribute(name)]
            if names:
                attribute = prim.GetAttribute(self._random.choice(names))
                self._set(attribute, lambda: self._random.choice([0.0, 0.5, 2.0]))
            else:
                prim.GetAttribute("axis").Set(self._random.choice("XYZ"))
