"""Random edits of a stage, of every kind that the delegate handles."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, Vt

from tests.delegate.asset_edits import AssetEdits
from tests.delegate.crop_edits import VOLUMES, CropEdits, crop
from tests.delegate.stages import add_camera, random_cloud
from tests.delegate.timing_edits import TimingEdits
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud

SPACES = ("srgb_rec709_scene", "lin_rec709_scene", "lin_ap1_scene", "no_such_space")
_Type = Sdf.ValueTypeNames
PURPOSES = ("default", "render", "proxy", "guide")


class Editor(AssetEdits, CropEdits, TimingEdits):
    """A stage and a source of edits; equal seeds make equal edits."""

    def __init__(self, seed: int, asset_folder: str) -> None:
        self._random = random.Random(seed)
        self._numbers = np.random.default_rng(seed)
        self._made = 0
        self.stage = self._make_stage(f"{asset_folder}/asset_{seed}.usda")
        self.times: list[float | None] = [None, 1.0, 1.0, 1.5, 2.0, 2.0, 2.5, 3.0, 3.0]

    def edit(self) -> str:
        """Make one edit and return its name; some change nothing."""
        kind = self._random.choice(["set_", "set_", "restructure_"])
        name = self._random.choice([each for each in dir(self) if each.startswith(kind)])
        layers = [*self._layers(), self.stage.GetSessionLayer()]
        target = self._random.choice(layers)
        if self.stage.IsLayerMuted(target.identifier):
            target = self.stage.GetRootLayer()
        self.stage.SetEditTarget(self.stage.GetEditTargetForLocalLayer(target))
        try:
            getattr(self, name)()
        except Tf.ErrorException:
            return f"{name} (refused)"
        return name

    def pick_time(self) -> float | None:
        return self._random.choice(self.times)

    # --- the stage -------------------------------------------------------------------------

    def _make_stage(self, asset: str) -> Usd.Stage:
        layer = Sdf.Layer.CreateNew(asset)
        source = Usd.Stage.Open(layer)
        UsdGeom.Xform.Define(source, "/Asset").AddTranslateOp().Set((0.5, 0, 0))
        source.SetDefaultPrim(source.GetPrimAtPath("/Asset"))
        crop(schema.author(source, "/Asset/Splats", random_cloud(50)), "/Asset/Matte")
        schema.author(source, "/Asset/Inner/More", random_cloud(51), form="packed")
        variants = source.GetPrimAtPath("/Asset").GetVariantSets().AddVariantSet("look")
        for number, name in enumerate("ab"):
            variants.AddVariant(name)
            variants.SetVariantSelection(name)
            with variants.GetVariantEditContext():
                schema.author(source, f"/Asset/Look{name}", random_cloud(60 + number))
        layer.Save()
        self._asset = layer
        stage = Usd.Stage.CreateInMemory()
        self._sublayers = [Sdf.Layer.CreateAnonymous(".usda") for _ in range(2)]
        for sub in self._sublayers:
            stage.GetRootLayer().subLayerPaths.append(sub.identifier)
        stage.GetRootLayer().subLayerOffsets[1] = Sdf.LayerOffset(1.0, 2.0)
        UsdGeom.Xform.Define(stage, "/World")
        crop(schema.author(stage, "/World/Field", random_cloud(1)), "/World/Matte")
        for name in ("One", "Two"):
            prim = UsdGeom.Xform.Define(stage, f"/World/{name}").GetPrim()
            prim.GetReferences().AddReference(asset)
            prim.SetInstanceable(True)
        schema.author(stage, "/Prototypes/Leaf/Splats", random_cloud(3, n=5))
        stage.GetPrimAtPath("/Prototypes").SetSpecifier(Sdf.SpecifierOver)
        scattered = UsdGeom.PointInstancer.Define(stage, "/World/Scatter")
        scattered.CreatePrototypesRel().SetTargets(["/Prototypes/Leaf", "/World/One"])
        self._scatter(scattered)
        schema.author(stage, "/Class/Splats", random_cloud(4, n=4))
        stage.GetPrimAtPath("/Class").SetSpecifier(Sdf.SpecifierClass)
        add_camera(stage, "/World/Camera")
        return stage

    def _layers(self) -> list[Sdf.Layer]:
        stack = self.stage.GetLayerStack(includeSessionLayers=False)
        return [layer for layer in stack if layer != self._asset]

    def _prims(self, kind: Callable[[Usd.Prim], bool] = bool) -> list[Usd.Prim]:
        return [prim for prim in self.stage.TraverseAll() if kind(prim)]

    def _prim(self, kind: Callable[[Usd.Prim], bool] = bool) -> Usd.Prim | None:
        found = self._prims(kind)
        return self._random.choice(found) if found else None

    def _field(self) -> Usd.Prim | None:
        return self._prim(schema.is_splat_field)

    def _instancer(self) -> UsdGeom.PointInstancer | None:
        prim = self._prim(lambda each: each.IsA(UsdGeom.PointInstancer))
        return UsdGeom.PointInstancer(prim) if prim else None

    def _new_path(self) -> str:
        parents = self._prims(lambda p: not p.IsInstance() and p.GetPath().pathElementCount < 5)
        parent = self._random.choice([self.stage.GetPseudoRoot(), *parents])
        self._made += 1
        return str(parent.GetPath().AppendChild(f"New{self._made}"))

    def _cloud(self) -> SplatCloud:
        n, degree = self._random.randint(0, 9), self._random.choice([0, 1])
        return random_cloud(self._random.randrange(1000), n=n, degree=degree)

    def _set(self, attribute: Usd.Attribute | UsdGeom.XformOp, make: Callable[[], Any]) -> None:
        """Author the default value, or two samples."""
        if self._random.random() < 0.5:
            attribute.Set(make())
        else:
            attribute.Set(make(), 1)
            attribute.Set(make(), 3)

    def _vectors(self, n: int) -> Vt.Vec3fArray:
        return Vt.Vec3fArray.FromNumpy(self._numbers.normal(size=(n, 3)).astype(np.float32))

    # --- the edits -------------------------------------------------------------------------

    def restructure_add_field(self) -> None:
        form = self._random.choice(["float", "half", "packed"])
        schema.author(self.stage, self._new_path(), self._cloud(), form=form)

    def restructure_add_xform(self) -> None:
        UsdGeom.Xform.Define(self.stage, self._new_path())

    def restructure_add_camera(self) -> None:
        add_camera(self.stage, self._new_path())

    def restructure_add_reference(self) -> None:
        prim = self.stage.DefinePrim(self._new_path(), "Xform")
        target = self._random.choice(["", "/Prototypes/Leaf", "/World/Two", "/World/Scatter"])
        if target:
            prim.GetReferences().AddInternalReference(target)
        else:
            prim.GetReferences().AddReference(self._asset.identifier)
        prim.SetInstanceable(self._random.random() < 0.5)

    def restructure_add_class_arc(self) -> None:
        if prim := self._prim():
            prim.GetInherits().AddInherit("/Class")

    def restructure_add_payload(self) -> None:
        prim = self.stage.DefinePrim(self._new_path(), "Xform")
        prim.GetPayloads().AddPayload(self._asset.identifier)

    def restructure_load_or_unload(self) -> None:
        if prim := self._prim(lambda each: each.HasAuthoredPayloads()):
            prim.Unload() if prim.IsLoaded() else prim.Load()

    def restructure_remove(self) -> None:
        prims = self._prims(lambda each: each.GetPath().pathElementCount > 1)
        if len(prims) > 12:
            self.stage.RemovePrim(self._random.choice(prims).GetPath())

    def restructure_rename(self) -> None:
        spec_path = (self._prim() or self.stage.GetPseudoRoot()).GetPath()
        layer = self.stage.GetEditTarget().GetLayer()
        spec = layer.GetPrimAtPath(spec_path)
        if spec and spec_path.pathElementCount > 1:
            self._made += 1
            spec.name = f"Renamed{self._made}"

    def restructure_retype(self) -> None:
        if prim := self._prim(lambda each: each.GetPath().pathElementCount > 1):
            names = ("Xform", "Mesh", "ParticleField3DGaussianSplat", "PointInstancer", "Camera")
            prim.SetTypeName(self._random.choice([*names, *VOLUMES[:2]]))

    def set_reauthor(self) -> None:
        if prim := self._field():
            form = self._random.choice(["float", "half", "packed"])
            schema.author(self.stage, prim.GetPath(), self._cloud(), form=form)

    def set_sample(self) -> None:
        if (prim := self._field()) and (attribute := prim.GetAttribute("positions")):
            self._set(attribute, lambda: self._vectors(self._random.randint(4, 5)))

    def set_opacities(self) -> None:
        if prim := self._field():
            kind = Sdf.ValueTypeNames.FloatArray
            self._set(prim.CreateAttribute("opacities", kind), self._opacities)

    def _opacities(self) -> Vt.FloatArray:
        return Vt.FloatArray([self._random.random() for _ in range(12)])

    def set_block_or_clear(self) -> None:
        if (prim := self._prim()) and (attributes := prim.GetAuthoredAttributes()):
            attribute = self._random.choice(attributes)
            self._random.choice([attribute.Block, attribute.Clear])()

    def set_remove_property(self) -> None:
        if (prim := self._prim()) and (names := prim.GetAuthoredPropertyNames()):
            prim.RemoveProperty(self._random.choice(names))

    def set_hints(self) -> None:
        if prim := self._field():
            choices = {
                "sortingModeHint": ("zDepth", "cameraDistance"),
                "projectionModeHint": ("perspective", "tangential"),
                "splat:rasterizeMode": ("classic", "antialiased"),
            }
            name = self._random.choice(list(choices))
            attribute = prim.CreateAttribute(name, Sdf.ValueTypeNames.Token)
            attribute.Set(self._random.choice(choices[name]))

    def set_footprint(self) -> None:
        if prim := self._field():
            attribute = prim.CreateAttribute("splat:sampling:footprint", Sdf.ValueTypeNames.Float)
            attribute.Set(self._random.choice([0.0, 0.001, 0.01, 0.1]))

    def set_color_space(self) -> None:
        if prim := self._prim():
            api = Usd.ColorSpaceAPI.Apply(prim)
            api.CreateColorSpaceNameAttr(self._random.choice(SPACES))

    def set_grade(self) -> None:
        if prim := self._field():
            values = {
                "exposure": self._random.uniform(-1, 1),
                "temperature": self._random.choice([10.0, 3200.0, 9000.0]),
                "gain": (1.0, self._random.random(), 1.0),
            }
            name = self._random.choice(list(values))
            kind = "Color3f" if name == "gain" else "Float"
            attribute = prim.CreateAttribute(f"splat:grade:{name}", getattr(_Type, kind))
            self._set(attribute, lambda: values[name])

    def set_attribute_color_space(self) -> None:
        if prim := self._field():
            name = "radiance:sphericalHarmonicsCoefficients"
            if attribute := prim.GetAttribute(name):
                if attribute.HasColorSpace():
                    attribute.ClearColorSpace()
                else:
                    attribute.SetColorSpace(self._random.choice(SPACES))

    def set_move(self) -> None:
        prim = self._prim(lambda each: each.IsA(UsdGeom.Xformable))
        if prim and (op := UsdGeom.Xformable(prim).MakeMatrixXform()):
            self._set(op, self._matrix)

    def _matrix(self) -> Gf.Matrix4d:
        matrix = np.eye(4)
        matrix[:3, :3] += 0.4 * self._numbers.normal(size=(3, 3))
        matrix[3, :3] = self._numbers.normal(size=3)
        return Gf.Matrix4d(matrix)

    def set_add_op(self) -> None:
        if prim := self._prim(lambda each: each.IsA(UsdGeom.Xformable)):
            xformable = UsdGeom.Xformable(prim)
            if not any(op.GetName() == "xformOp:rotateX" for op in xformable.GetOrderedXformOps()):
                xformable.AddRotateXOp().Set(self._random.choice([0.0, 30.0, 90.0]))

    def set_reset_stack(self) -> None:
        if prim := self._prim(lambda each: each.IsA(UsdGeom.Xformable)):
            UsdGeom.Xformable(prim).SetResetXformStack(self._random.random() < 0.5)

    def set_show_or_hide(self) -> None:
        if prim := self._prim(lambda each: each.IsA(UsdGeom.Imageable)):
            attribute = UsdGeom.Imageable(prim).CreateVisibilityAttr()
            self._set(attribute, lambda: self._random.choice(["invisible", "inherited"]))

    def set_purpose(self) -> None:
        if prim := self._prim(lambda each: each.IsA(UsdGeom.Imageable)):
            UsdGeom.Imageable(prim).CreatePurposeAttr().Set(self._random.choice(PURPOSES))

    def restructure_activate(self) -> None:
        if prim := self._prim(lambda each: each.GetPath().pathElementCount > 1):
            prim.SetActive(not prim.IsActive())

    def restructure_instanceable(self) -> None:
        if prim := self._prim(lambda each: each.HasAuthoredReferences()):
            prim.SetInstanceable(not prim.IsInstanceable())

    def restructure_specifier(self) -> None:
        if prim := self._prim(lambda each: each.GetPath().pathElementCount > 1):
            kinds = (Sdf.SpecifierDef, Sdf.SpecifierOver, Sdf.SpecifierClass)
            prim.SetSpecifier(self._random.choice(kinds))

    def restructure_variant(self) -> None:
        if prim := self._prim(lambda each: each.HasVariantSets()):
            prim.GetVariantSet("look").SetVariantSelection(self._random.choice(["a", "b", ""]))

    def set_edit_asset(self) -> None:
        source = Usd.Stage.Open(self._asset)
        paths = ("/Asset/Splats", "/Asset", "/Asset/Inner")
        prim = source.GetPrimAtPath(self._random.choice(paths))
        if self._random.random() < 0.5:
            UsdGeom.Xformable(prim).MakeMatrixXform().Set(Gf.Matrix4d(1 + self._random.random()))
        else:
            schema.author(source, "/Asset/Splats", self._cloud())

    def set_edit_class(self) -> None:
        schema.author(self.stage, "/Class/Splats", self._cloud())

    def _scatter(self, instancer: UsdGeom.PointInstancer) -> None:
        count = self._random.randint(0, 4)
        self._set(instancer.CreatePositionsAttr(), lambda: self._vectors(count))
        self._set(
            instancer.CreateProtoIndicesAttr(),
            lambda: [self._random.randint(0, 2) for _ in range(count)],
        )

    def restructure_add_instancer(self) -> None:
        instancer = UsdGeom.PointInstancer.Define(self.stage, self._new_path())
        leaf = schema.author(self.stage, f"{instancer.GetPath()}/Leaf", self._cloud())
        instancer.CreatePrototypesRel().SetTargets([leaf.GetPath()])
        self._scatter(instancer)

    def set_scatter(self) -> None:
        if instancer := self._instancer():
            self._scatter(instancer)

    def restructure_prototypes(self) -> None:
        if instancer := self._instancer():
            prims = self._random.sample(self._prims(), 2)
            instancer.CreatePrototypesRel().SetTargets([prim.GetPath() for prim in prims])

    def set_mask(self) -> None:
        if instancer := self._instancer():
            if self._random.random() < 0.7:
                numbers = instancer.CreateInvisibleIdsAttr()
                self._set(numbers, lambda: [self._random.randint(0, 2)])
            else:
                instancer.DeactivateId(self._random.randint(0, 3))

    def set_velocities(self) -> None:
        if instancer := self._instancer():
            count = len(instancer.GetProtoIndicesAttr().Get(1) or ())
            instancer.CreatePositionsAttr().Set(self._vectors(count), 1)
            instancer.CreateVelocitiesAttr().Set(self._vectors(count), 1)

    def set_camera(self) -> None:
        if prim := self._prim(lambda each: each.IsA(UsdGeom.Camera)):
            choices = {
                "focalLength": (0.0, 20.0, 35.0),
                "fStop": (0.0, 2.8),
                "focusDistance": (0.0, 5.0),
                "shutter:open": (-0.25, 0.0, 0.5),
                "shutter:close": (0.0, 0.25),
                "exposure": (0.0, 1.0),
                "exposure:fStop": (0.0, 2.0),
            }
            name = self._random.choice(list(choices))
            attribute = prim.GetAttribute(name)
            self._set(attribute, lambda: self._random.choice(choices[name]))

    def restructure_mute(self) -> None:
        layer = self._random.choice(self._layers()[1:] or [self.stage.GetSessionLayer()])
        if muted := self.stage.GetMutedLayers():
            self.stage.UnmuteLayer(muted[0])
        else:
            self.stage.MuteLayer(layer.identifier)

    def restructure_sublayer(self) -> None:
        root = self.stage.GetRootLayer()
        if len(root.subLayerPaths) > 2:
            del root.subLayerPaths[0]
        else:
            layer = Sdf.Layer.CreateAnonymous(".usda")
            prim = Sdf.CreatePrimInLayer(layer, "/World/Field")
            spec = Sdf.AttributeSpec(prim, "opacities", Sdf.ValueTypeNames.FloatArray)
            spec.default = Vt.FloatArray([0.5] * 20)
            self._sublayers.append(layer)
            root.subLayerPaths.insert(0, layer.identifier)

    def restructure_session(self) -> None:
        self.stage.GetSessionLayer().Clear()

    def restructure_population_mask(self) -> None:
        masks = (Usd.StagePopulationMask.All(), Usd.StagePopulationMask(["/World"]))
        self.stage.SetPopulationMask(self._random.choice(masks))

    def restructure_block_of_changes(self) -> None:
        layer = self.stage.GetEditTarget().GetLayer()
        with Sdf.ChangeBlock():
            for number in range(2):
                spec = Sdf.CreatePrimInLayer(layer, f"/World/Block{number}")
                spec.specifier = Sdf.SpecifierDef
                spec.typeName = "ParticleField3DGaussianSplat"
                if "positions" not in spec.attributes:
                    Sdf.AttributeSpec(spec, "positions", Sdf.ValueTypeNames.Point3fArray)
                spec.attributes["positions"].default = self._vectors(2)
