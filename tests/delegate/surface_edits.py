"""Random edits of meshes, shapes, materials, subsets, skeletons and lights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdSkel, Vt

from tests.delegate.edits import Editor
from tests.delegate.surface_stages import (
    add_light,
    add_material,
    add_mesh,
    add_skinned,
    add_subset,
    add_texture,
    bind,
    write_picture,
)

SHAPES = ("Sphere", "Cube", "Cylinder", "Cone", "Capsule", "Plane", "Cylinder_1", "Mesh")
INTERPOLATIONS = ("constant", "uniform", "vertex", "varying", "faceVarying")


class SurfaceEditor(Editor):
    """An editor of stages that hold opaque things too."""

    def __init__(self, seed: int, asset_folder: str) -> None:
        self._picture = str(Path(asset_folder) / "picture.png")
        rng = np.random.default_rng(seed)
        write_picture(Path(self._picture), rng.integers(0, 255, (3, 2, 3), dtype=np.uint8))
        super().__init__(seed, asset_folder)

    def _make_stage(self, asset: str) -> Usd.Stage:
        stage = super()._make_stage(asset)
        source = Usd.Stage.Open(self._asset)
        mesh = add_mesh(source, "/Asset/Mesh", faces=3)
        bind(mesh, add_material(source, "/Asset/Looks/Red"))
        add_skinned(source, "/Asset/Skinned")
        self._asset.Save()
        add_mesh(stage, "/World/Smooth", scheme="catmullClark")
        add_mesh(stage, "/Prototypes/Leaf/Mesh", faces=1)
        add_skinned(stage, "/World/Rig")
        add_material(stage, "/World/Looks/Textured")
        add_texture(stage, "/World/Looks/Textured", self._picture)
        bind(stage.GetPrimAtPath("/World"), add_material(stage, "/World/Looks/Plain"))
        add_light(stage, "/World/Light")
        return stage

    def _mesh(self) -> UsdGeom.Mesh | None:
        prim = self._prim(lambda each: each.IsA(UsdGeom.Mesh))
        return UsdGeom.Mesh(prim) if prim else None

    def _gprim(self) -> Usd.Prim | None:
        return self._prim(lambda each: each.IsA(UsdGeom.Gprim))

    def _material(self) -> UsdShade.Material | None:
        prim = self._prim(lambda each: each.IsA(UsdShade.Material))
        return UsdShade.Material(prim) if prim else None

    def _shader(self) -> UsdShade.Shader | None:
        prim = self._prim(lambda each: each.IsA(UsdShade.Shader))
        return UsdShade.Shader(prim) if prim else None

    def _triple(self) -> Gf.Vec3f:
        return Gf.Vec3f(*(self._random.random() for _ in range(3)))

    # --- the edits -------------------------------------------------------------------------

    def restructure_add_mesh(self) -> None:
        scheme = self._random.choice(["none", "catmullClark", "loop", "bilinear"])
        add_mesh(self.stage, self._new_path(), scheme=scheme, faces=self._random.randint(0, 3))

    def restructure_add_shape(self) -> None:
        self.stage.DefinePrim(self._new_path(), self._random.choice(SHAPES))

    def restructure_retype_shape(self) -> None:
        if prim := self._gprim():
            prim.SetTypeName(self._random.choice(SHAPES))

    def restructure_add_rig(self) -> None:
        add_skinned(self.stage, self._new_path())

    def restructure_add_light(self) -> None:
        add_light(self.stage, self._new_path())

    def restructure_add_subset(self) -> None:
        if mesh := self._mesh():
            self._made += 1
            subset = add_subset(mesh, f"Subset{self._made}", [self._random.randint(0, 2)])
            if material := self._material():
                bind(subset.GetPrim(), material)

    def restructure_add_material(self) -> None:
        path = self._new_path()
        add_material(self.stage, path, tuple(self._triple()))
        if self._random.random() < 0.5:
            file = self._random.choice([self._picture, "missing.png"])
            add_texture(self.stage, path, file)

    def restructure_remove_shader(self) -> None:
        if shader := self._shader():
            self.stage.RemovePrim(shader.GetPath())

    def set_points(self) -> None:
        if mesh := self._mesh():
            count = len(mesh.GetPointsAttr().Get(1) or ()) + self._random.choice([0, 0, 0, 1, -1])
            self._set(mesh.GetPointsAttr(), lambda: self._vectors(max(0, count)))

    def set_point_velocities(self) -> None:
        if mesh := self._mesh():
            count = len(mesh.GetPointsAttr().Get(1) or ())
            mesh.GetPointsAttr().Set(self._vectors(count), 1)
            mesh.CreateVelocitiesAttr().Set(self._vectors(count), 1)

    def set_topology(self) -> None:
        if mesh := self._mesh():
            counts = self._random.choice([[4], [4, 4], [3, 3, 4], []])
            indices = [self._random.randint(0, 5) for _ in range(sum(counts))]
            self._set(mesh.GetFaceVertexCountsAttr(), lambda: counts)
            self._set(mesh.GetFaceVertexIndicesAttr(), lambda: indices)

    def set_surface_kind(self) -> None:
        if mesh := self._mesh():
            schemes = ("none", "catmullClark", "bilinear", "loop", "bezier")
            self._random.choice(
                [
                    lambda: mesh.CreateSubdivisionSchemeAttr(self._random.choice(schemes)),
                    lambda: mesh.CreateHoleIndicesAttr([0]),
                    lambda: mesh.CreateOrientationAttr(
                        self._random.choice(["leftHanded", "rightHanded"])
                    ),
                    lambda: mesh.CreateDoubleSidedAttr(self._random.random() < 0.5),
                    lambda: mesh.CreateInterpolateBoundaryAttr("edgeOnly"),
                ]
            )()

    def set_normals(self) -> None:
        if mesh := self._mesh():
            count = len(mesh.GetPointsAttr().Get(1) or ())
            if self._random.random() < 0.5:
                self._set(mesh.CreateNormalsAttr(), lambda: self._vectors(count))
                mesh.SetNormalsInterpolation(self._random.choice(["vertex", "faceVarying"]))
            else:
                api = UsdGeom.PrimvarsAPI(mesh)
                kind = Sdf.ValueTypeNames.Normal3fArray
                primvar = api.CreatePrimvar("normals", kind, "vertex")
                self._set(primvar.GetAttr(), lambda: self._vectors(count))

    def set_shape_size(self) -> None:
        if prim := self._gprim():
            for name in ("radius", "height", "size", "width", "length"):
                if attribute := prim.GetAttribute(name):
                    self._set(attribute, lambda: self._random.choice([0.5, 1.0, 2.0]))
            if axis := prim.GetAttribute("axis"):
                axis.Set(self._random.choice("XYZ"))

    def set_display_color(self) -> None:
        if prim := self._prim(lambda each: each.IsA(UsdGeom.Imageable)):
            interpolation = self._random.choice(INTERPOLATIONS)
            kind = Sdf.ValueTypeNames.Color3fArray
            primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("displayColor", kind, interpolation)
            count = self._random.choice([1, 2, 4, 6, 8])
            self._set(primvar.GetAttr(), lambda: [self._triple() for _ in range(count)])
            if self._random.random() < 0.3:
                primvar.SetIndices(Vt.IntArray([0] * self._random.choice([1, 4, 6])))

    def set_uvs(self) -> None:
        if prim := self._gprim():
            kind = Sdf.ValueTypeNames.TexCoord2fArray
            interpolation = self._random.choice(["vertex", "faceVarying"])
            primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("st", kind, interpolation)
            count = self._random.choice([4, 6, 8])
            values = self._numbers.uniform(size=(count, 2)).astype(np.float32)
            self._set(primvar.GetAttr(), lambda: Vt.Vec2fArray.FromNumpy(values))

    def set_binding(self) -> None:
        prim = self._prim(lambda each: each.IsA(UsdGeom.Imageable) or each.IsA(UsdGeom.Subset))
        material = self._material()
        if prim and material:
            api = UsdShade.MaterialBindingAPI.Apply(prim)
            purpose = self._random.choice(["", "", "preview", "full"])
            strength = self._random.choice(["weakerThanDescendants", "strongerThanDescendants"])
            api.Bind(material, strength, purpose)

    def set_collection_binding(self) -> None:
        prim = self._prim(lambda each: each.IsA(UsdGeom.Imageable))
        material = self._material()
        if prim and material:
            collection = Usd.CollectionAPI.Apply(prim, "some")
            collection.CreateIncludesRel().SetTargets(
                [self._random.choice(self._prims()).GetPath()]
            )
            UsdShade.MaterialBindingAPI.Apply(prim).Bind(collection, material, "some")

    def set_unbind(self) -> None:
        if prim := self._prim(lambda each: each.HasAPI(UsdShade.MaterialBindingAPI)):
            UsdShade.MaterialBindingAPI(prim).UnbindAllBindings()

    def set_shader_input(self) -> None:
        if shader := self._shader():
            values: list[tuple[str, Any, Any]] = [
                ("diffuseColor", Sdf.ValueTypeNames.Color3f, self._triple),
                ("fallback", Sdf.ValueTypeNames.Float4, lambda: Gf.Vec4f(0.5)),
                ("scale", Sdf.ValueTypeNames.Float4, lambda: Gf.Vec4f(self._random.random())),
                ("bias", Sdf.ValueTypeNames.Float4, lambda: Gf.Vec4f(self._random.random())),
                ("wrapS", Sdf.ValueTypeNames.Token, lambda: self._random.choice(["clamp", "x"])),
                ("sourceColorSpace", Sdf.ValueTypeNames.Token, lambda: "raw"),
                ("varname", Sdf.ValueTypeNames.String, lambda: self._random.choice(["st", "uv"])),
                (
                    "file",
                    Sdf.ValueTypeNames.Asset,
                    lambda: Sdf.AssetPath(self._random.choice([self._picture, "none.png"])),
                ),
            ]
            name, kind, make = self._random.choice(values)
            self._set(shader.CreateInput(name, kind).GetAttr(), make)

    def set_shader_id(self) -> None:
        if shader := self._shader():
            ids = ("UsdPreviewSurface", "UsdUVTexture", "UsdPrimvarReader_float3", "Other")
            shader.CreateIdAttr(self._random.choice(ids))

    def set_connection(self) -> None:
        one, two = self._shader(), self._shader()
        if one and two:
            source = two.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
            kind = Sdf.ValueTypeNames.Color3f
            one.CreateInput("diffuseColor", kind).ConnectToSource(source)

    def set_subset(self) -> None:
        if prim := self._prim(lambda each: each.IsA(UsdGeom.Subset)):
            indices = [self._random.randint(0, 2) for _ in range(self._random.randint(0, 2))]
            self._set(UsdGeom.Subset(prim).GetIndicesAttr(), lambda: indices)

    def set_animation(self) -> None:
        if prim := self._prim(lambda each: each.IsA(UsdSkel.Animation)):
            moves = UsdSkel.Animation(prim).GetTranslationsAttr()
            self._set(moves, lambda: self._vectors(self._random.choice([2, 2, 2, 1])))

    def set_skinning(self) -> None:
        if prim := self._prim(lambda each: each.HasAPI(UsdSkel.BindingAPI)):
            api = UsdSkel.BindingAPI(prim)
            targets = [each.GetPath() for each in self._prims() if each.IsA(UsdSkel.Skeleton)]
            self._random.choice(
                [
                    lambda: api.CreateSkeletonRel().SetTargets([self._random.choice(targets)]),
                    lambda: api.CreateGeomBindTransformAttr(self._matrix()),
                    lambda: api.CreateJointIndicesPrimvar(False, 1).Set([1, 0, 1, 0]),
                    lambda: api.CreateSkinningMethodAttr("dualQuaternion"),
                    lambda: api.CreateAnimationSourceRel().SetTargets([]),
                ]
            )()

    def set_bind_pose(self) -> None:
        if prim := self._prim(lambda each: each.IsA(UsdSkel.Skeleton)):
            poses = Vt.Matrix4dArray([self._matrix(), self._matrix()])
            UsdSkel.Skeleton(prim).CreateBindTransformsAttr(poses)

    def set_light(self) -> None:
        if prim := self._prim(lambda each: each.IsA(UsdLux.DistantLight)):
            light = UsdLux.DistantLight(prim)
            attribute = self._random.choice(
                [light.CreateIntensityAttr(), light.CreateExposureAttr(), light.CreateAngleAttr()]
            )
            self._set(attribute, lambda: self._random.choice([0.0, 1.0, 2.0]))
            light.CreateColorAttr(self._triple())
            light.CreateNormalizeAttr(self._random.random() < 0.5)

    def set_edit_asset_surface(self) -> None:
        source = Usd.Stage.Open(self._asset)
        name = self._random.choice(["points", "shader", "bind", "move", "remove"])
        if name == "points" and (mesh := UsdGeom.Mesh.Get(source, "/Asset/Mesh")):
            mesh.GetPointsAttr().Set(self._vectors(8))
        elif name == "shader":
            add_material(source, "/Asset/Looks/Red", tuple(self._triple()))
        elif name == "bind":
            bind(source.GetPrimAtPath("/Asset"), add_material(source, "/Asset/Looks/Blue"))
        elif name == "move" and (prim := source.GetPrimAtPath("/Asset/Skinned/Skeleton")):
            UsdGeom.Xformable(prim).MakeMatrixXform().Set(self._matrix())
        elif name == "remove":
            source.RemovePrim("/Asset/Looks/Blue")
