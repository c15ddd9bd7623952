"""Small stages with opaque prims, created in memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdSkel, Vt

from usdsplat.delegate.engine import Engine
from usdsplat.render.specs import MaterialSpec, MeshSpec


def add_mesh(
    stage: Usd.Stage, path: str, *, scheme: str = "none", faces: int = 2, scale: float = 1.0
) -> UsdGeom.Mesh:
    """A strip of unit squares along x, in the plane z = 0."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = [Gf.Vec3f(scale * x, scale * y, 0) for x in range(faces + 1) for y in (0, 1)]
    indices = [i for f in range(faces) for i in (2 * f, 2 * f + 2, 2 * f + 3, 2 * f + 1)]
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr([4] * faces)
    mesh.CreateFaceVertexIndicesAttr(indices)
    mesh.CreateSubdivisionSchemeAttr(scheme)
    return mesh


def add_material(
    stage: Usd.Stage, path: str, color: tuple[float, float, float] = (0.5, 0.25, 0.125)
) -> UsdShade.Material:
    """A UsdPreviewSurface of one colour."""
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
    output = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(output)
    return material


def add_texture(stage: Usd.Stage, material: str, file: str, varname: str = "st") -> UsdShade.Shader:
    """Connect the diffuse colour of a material to a picture, through a reader of a primvar."""
    texture = UsdShade.Shader.Define(stage, f"{material}/Texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    reader = UsdShade.Shader.Define(stage, f"{material}/Reader")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(varname)
    uvs = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(uvs)
    surface = UsdShade.Shader(stage.GetPrimAtPath(f"{material}/Surface"))
    color = texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    surface.GetInput("diffuseColor").ConnectToSource(color)
    return texture


def bind(prim: Usd.Prim | UsdGeom.Mesh, material: UsdShade.Material) -> None:
    """Bind a material for all purposes."""
    found = prim if isinstance(prim, Usd.Prim) else prim.GetPrim()
    UsdShade.MaterialBindingAPI.Apply(found).Bind(material)


def add_subset(mesh: UsdGeom.Mesh, name: str, faces: list[int]) -> UsdGeom.Subset:
    """Faces that materials can be bound to."""
    return UsdGeom.Subset.CreateGeomSubset(
        mesh, name, UsdGeom.Tokens.face, faces, UsdShade.Tokens.materialBind
    )


def add_skinned(stage: Usd.Stage, path: str) -> UsdGeom.Mesh:
    """A strip whose right end one joint of two lifts by 1 in z from time 1 to time 3."""
    UsdSkel.Root.Define(stage, path)
    skeleton = UsdSkel.Skeleton.Define(stage, f"{path}/Skeleton")
    unit = Gf.Matrix4d(1.0)
    skeleton.CreateJointsAttr(["a", "b"])
    skeleton.CreateBindTransformsAttr([unit, unit])
    skeleton.CreateRestTransformsAttr([unit, unit])
    animation = UsdSkel.Animation.Define(stage, f"{path}/Animation")
    animation.CreateJointsAttr(["a", "b"])
    animation.CreateRotationsAttr([Gf.Quatf(1.0)] * 2)
    animation.CreateScalesAttr([Gf.Vec3h(1.0)] * 2)
    moves = animation.CreateTranslationsAttr()
    moves.Set([Gf.Vec3f(0)] * 2, 1)
    moves.Set([Gf.Vec3f(0), Gf.Vec3f(0, 0, 1)], 3)
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    mesh = add_mesh(stage, f"{path}/Mesh", faces=1)
    skin = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    skin.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    skin.CreateJointIndicesPrimvar(False, 1).Set([0, 0, 1, 1])
    skin.CreateJointWeightsPrimvar(False, 1).Set([1.0] * 4)
    return mesh


def add_light(stage: Usd.Stage, path: str = "/Light") -> UsdLux.DistantLight:
    """A light without an extent, straight down -z."""
    light = UsdLux.DistantLight.Define(stage, path)
    light.CreateAngleAttr(0.0)
    light.CreateIntensityAttr(1.0)
    return light


def write_picture(path: Path, pixels: np.ndarray) -> str:
    """Write uint8 or float32 pixels, shape (h, w, c), as a file that OpenImageIO knows."""
    kind = "uint8" if pixels.dtype == np.uint8 else "float"
    output = oiio.ImageOutput.create(str(path))
    height, width, channels = pixels.shape
    assert output.open(str(path), oiio.ImageSpec(width, height, channels, kind))
    assert output.write_image(pixels)
    output.close()
    return str(path)


def surfaces(engine: Engine) -> list[tuple[object, ...]]:
    """All meshes and lights that an engine would draw, down to the last bit."""
    scene = engine.render_scene
    drawn = [(path, instance, *_mesh(mesh.spec)) for path, mesh, instance in scene.drawn_meshes()]
    return [*drawn, *((light,) for light in scene.lights)]


def pulled(engine: Engine, edit: Callable[[], object]) -> Counter[str]:
    """What the next sync reads after `edit`."""
    engine.sync()
    before = Counter(engine.pulls)
    edit()
    engine.sync()
    return Counter(engine.pulls) - before


def mesh_at(engine: Engine, path: str) -> MeshSpec:
    """The mesh that is seen at a path."""
    found = {i.path: mesh.spec for _, mesh, i in engine.render_scene.drawn_meshes()}
    return found[path]


def world_points(engine: Engine, path: str) -> np.ndarray:
    """Points of what is seen at a path, in the world."""
    for _, mesh, instance in engine.render_scene.drawn_meshes():
        if instance.path == path:
            matrix = np.array(instance.transform).reshape(4, 4)
            return mesh.spec.points @ matrix[:3, :3].T + matrix[:3, 3]
    raise KeyError(path)


def _mesh(spec: MeshSpec) -> tuple[object, ...]:
    arrays = ("points", "triangles", "faces", "normals", "colors", "uvs", "material_of")
    found = (getattr(spec, name) for name in arrays)
    held = tuple(None if each is None else (each.shape, each.tobytes()) for each in found)
    return (*held, spec.double_sided, *map(_material, spec.materials))


def _material(spec: MaterialSpec) -> tuple[object, ...]:
    texture = spec.texture and (spec.texture.pixels.tobytes(), spec.texture.wrap)
    return spec.diffuse, spec.uses_colors, texture, spec.path


def colors(*rgb: tuple[float, float, float]) -> Vt.Vec3fArray:
    """Values of a colour primvar."""
    return Vt.Vec3fArray([Gf.Vec3f(*each) for each in rgb])
