"""Stages with mistakes, for the contract between `render` and `validate`."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from pathlib import Path

from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdRender, UsdShade, Vt

from tests.cli.conftest import ball
from usdsplat import schema

SIZE = (16, 12)
F = Sdf.ValueTypeNames


def base(path: Path) -> Usd.Stage:
    """A stage of two frames with everything that a mistake can be made in; nothing is wrong."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(2)
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/W").GetPrim())
    schema.author(stage, "/W/Ball", ball(40))
    camera = UsdGeom.Camera.Define(stage, "/W/Cam")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 4))
    camera.GetClippingRangeAttr().Set(Gf.Vec2f(0.1, 100))
    mesh = UsdGeom.Mesh.Define(stage, "/W/Floor")
    mesh.CreatePointsAttr([(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    material = UsdShade.Material.Define(stage, "/W/Mat")
    shader = UsdShade.Shader.Define(stage, "/W/Mat/S")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", F.Color3f).Set((0.5, 0.5, 0.5))
    material.CreateSurfaceOutput().ConnectToSource(shader.CreateOutput("surface", F.Token))
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    UsdLux.DistantLight.Define(stage, "/W/Sun")
    settings = UsdRender.Settings.Define(stage, "/Render/Settings")
    settings.CreateResolutionAttr(Gf.Vec2i(*SIZE))
    settings.CreateCameraRel().SetTargets(["/W/Cam"])
    settings.CreateProductsRel().SetTargets(["/Render/Product"])
    product = UsdRender.Product.Define(stage, "/Render/Product")
    product.CreateProductNameAttr("picture.exr")
    var = UsdRender.Var.Define(stage, "/Render/Color")
    var.CreateSourceNameAttr("Ci")
    product.CreateOrderedVarsRel().SetTargets(["/Render/Color"])
    return stage


def put(path: str, kind: Sdf.ValueTypeName, value: object) -> Callable[[Usd.Stage], None]:
    """Return an edit that sets a default value."""

    def edit(stage: Usd.Stage) -> None:
        prim = stage.GetPrimAtPath(Sdf.Path(path).GetPrimPath())
        if prim:
            prim.CreateAttribute(Sdf.Path(path).name, kind).Set(value)

    return edit


def at_two(path: str, value: object) -> Callable[[Usd.Stage], None]:
    """Return an edit that sets a value at frame 2, and the present one at frame 1."""

    def edit(stage: Usd.Stage) -> None:
        attribute = stage.GetAttributeAtPath(path)
        if attribute and attribute.Get() is not None:
            attribute.Set(attribute.Get(), 1)
            attribute.Set(value, 2)

    return edit


def target(path: str, *targets: str) -> Callable[[Usd.Stage], None]:
    """Return an edit that sets the targets of a relationship."""

    def edit(stage: Usd.Stage) -> None:
        prim = stage.GetPrimAtPath(Sdf.Path(path).GetPrimPath())
        if prim:
            prim.CreateRelationship(Sdf.Path(path).name).SetTargets(targets)

    return edit


def define(path: str, kind: str) -> Callable[[Usd.Stage], None]:
    """Return an edit that adds a prim."""
    return lambda stage: bool(stage.DefinePrim(path, kind)) and None


def refer(path: str, asset: str, prim: str = "") -> Callable[[Usd.Stage], None]:
    """Return an edit that adds a reference."""
    return lambda stage: (
        stage.DefinePrim(path).GetReferences().AddReference(asset, prim or Sdf.Path()) and None
    )


def hide(path: str) -> Callable[[Usd.Stage], None]:
    """Return an edit that hides a prim."""
    return lambda stage: UsdGeom.Imageable(stage.GetPrimAtPath(path)).MakeInvisible() and None


def _dome(stage: Usd.Stage) -> None:
    UsdLux.DomeLight.Define(stage, "/W/Dome").CreateTextureFileAttr("./none.exr")


def _texture(stage: Usd.Stage) -> None:
    node = UsdShade.Shader.Define(stage, "/W/Mat/T")
    node.CreateIdAttr("UsdUVTexture")
    node.CreateInput("file", F.Asset).Set("./none.png")
    shader = UsdShade.Shader(stage.GetPrimAtPath("/W/Mat/S"))
    output = node.CreateOutput("rgb", F.Float3)
    shader.CreateInput("diffuseColor", F.Color3f).ConnectToSource(output)


def _instancer(stage: Usd.Stage) -> None:
    scatter = UsdGeom.PointInstancer.Define(stage, "/W/Scatter")
    scatter.CreatePrototypesRel().SetTargets(["/W/None"])
    scatter.CreateProtoIndicesAttr([0])
    scatter.CreatePositionsAttr([(0, 0, 0)])


NAN = math.nan
MUTATIONS: dict[str, Callable[[Usd.Stage], None]] = {
    "reference": refer("/W/Hero", "./none.usda"),
    "prim": refer("/W/Hero2", "", "/W/None"),
    "sublayer": lambda stage: stage.GetRootLayer().subLayerPaths.append("./none.usda"),
    "dome": _dome,
    "bright": put("/W/Sun.inputs:intensity", F.Float, 1e20),
    "portal": define("/W/Portal", "PortalLight"),
    "volume": define("/W/Volume", "Volume"),
    "curves": define("/W/Hair", "BasisCurves"),
    "typing error": define("/W/Typo", "ParticleField3DGaussianSplatt"),
    "opacity": put("/W/Mat/S.inputs:opacity", F.Float, 0.1),
    "metallic": put("/W/Mat/S.inputs:metallic", F.Float, 1.0),
    "emission": put("/W/Mat/S.inputs:emissiveColor", F.Color3f, (5, 5, 5)),
    "input": put("/W/Mat/S.inputs:difuseColor", F.Color3f, (1, 0, 0)),
    "surface": put("/W/Mat/S.info:id", F.Token, "ND_standard_surface"),
    "texture": _texture,
    "grade": put("/W/Ball.splat:grade:exposre", F.Float, 1.0),
    "illegal grade": put("/W/Ball.splat:grade:temperature", F.Float, 10.0),
    "samples": put("/Render/Settings.splat:sampels", F.Int, 4),
    "illegal samples": put("/Render/Settings.splat:samples", F.Int, -4),
    "crop": target("/W/Ball.collection:cropInclude:includes", "/W/None"),
    "crop by mesh": target("/W/Ball.collection:cropInclude:includes", "/W/Floor"),
    "crop by nothing": target("/W/Ball.collection:cropExclude:includes", "/W/Mat"),
    "clipping": put("/W/Cam.clippingRange", F.Float2, Gf.Vec2f(10, 1)),
    "far away": put("/W/Cam.clippingRange", F.Float2, Gf.Vec2f(1000, 2000)),
    "aperture": put("/W/Cam.horizontalAperture", F.Float, 0.0),
    "shutter": put("/W/Cam.shutter:open", F.Double, 0.5),
    "blur": put("/W/Cam.shutter:close", F.Double, 0.5),
    "looks away": put("/W/Cam.xformOp:translate", F.Double3, Gf.Vec3d(0, 0, -9)),
    "op": put("/W/Floor.xformOpOrder", F.TokenArray, Vt.TokenArray(["xformOp:bogus"])),
    "nan": put("/W/Sun.inputs:intensity", F.Float, NAN),
    "indices": put("/W/Floor.faceVertexIndices", F.IntArray, Vt.IntArray([0, 1, 2, 9])),
    "later indices": at_two("/W/Floor.faceVertexIndices", Vt.IntArray([0, 1, 2, 9])),
    "later clipping": at_two("/W/Cam.clippingRange", Gf.Vec2f(10, 1)),
    "later opacities": at_two("/W/Ball.opacities", Vt.FloatArray([0.5])),
    "opacities": put("/W/Ball.opacities", F.FloatArray, Vt.FloatArray([2.0] * 40)),
    "type": put("/W/Ball.scales", F.Float3Array, Vt.Vec3fArray([Gf.Vec3f(NAN)] * 40)),
    "degree": put("/W/Ball.radiance:sphericalHarmonicsDegree", F.Int, 9),
    "space": put("/W/Ball.colorSpace:name", F.Token, "nonsense"),
    "empty": put("/W/Ball.positions", F.Point3fArray, Vt.Vec3fArray()),
    "camera": target("/Render/Settings.camera", "/W/None"),
    "product": target("/Render/Settings.products", "/Render/None"),
    "var": put("/Render/Color.sourceName", F.String, "lpe:C<RD>L"),
    "no var": target("/Render/Product.orderedVars", "/Render/None"),
    "kind": put("/Render/Product.productType", F.Token, "voxels"),
    "resolution": put("/Render/Settings.resolution", F.Int2, Gf.Vec2i(0, 10)),
    "window": put("/Render/Settings.dataWindowNDC", F.Float4, Gf.Vec4f(0, 0, NAN, 1)),
    "conform": put("/Render/Settings.aspectRatioConformPolicy", F.Token, "nonsense"),
    "purposes": put("/Render/Settings.includedPurposes", F.TokenArray, Vt.TokenArray(["x"])),
    "packed": define("/W/Packed", "ParticleFieldPackedSplat"),
    "instancer": _instancer,
    "no field": lambda stage: stage.RemovePrim("/W/Ball") and None,
    "no mesh": lambda stage: stage.RemovePrim("/W/Floor") and None,
    "no camera": lambda stage: stage.RemovePrim("/W/Cam") and None,
    "hidden": hide("/W"),
}
"""Name -> mistake."""


def mutated(path: Path, seed: int) -> list[str]:
    """Write a stage with one to three mistakes, and return their names."""
    rng = random.Random(seed)
    names = list(MUTATIONS)
    chosen = [names[seed % len(names)], *rng.sample(names, rng.randrange(3))]
    stage = base(path)
    for name in dict.fromkeys(chosen):
        try:
            MUTATIONS[name](stage)
        except Exception as error:
            assert "Invalid" in str(error) or "invalid" in str(error) or "Accessed" in str(error)
    stage.GetRootLayer().Save()
    return chosen
