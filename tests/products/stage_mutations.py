"""Random damage to stages: values, types, tokens, names, arcs and metadata."""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux, Vt

from tests.cli.conftest import ball
from tests.products.mutated_stages import base
from tests.trees import little_tree
from usdsplat import schema

DATA = Path(__file__).parents[1] / "data" / "v0_6_0"
INF, NAN = float("inf"), float("nan")
NUMBERS = (0.0, -1.0, 1.0, 0.5, 2.0, 1e-30, 1e30, -1e30, 1e300, INF, -INF, NAN)
WHOLE = (0, -1, 1, 2, 3, 7, 255, 2**31 - 1, -(2**31))
LENGTHS = (0, 1, 2, 3, 4, 40, 41, 1000)
WORDS = (
    "", "nothing", "none", "bad token", "zDepth", "packed_1", "vertex", "faceVarying", "constant",
    "invisible", "guide", "catmullClark", "subset", "é", "a/b", "deepRaster", "####.exr", "Z",
)  # fmt: skip
OPS = (
    "xformOp:wrong", "xformOp:translate", "xformOp:rotateXYZ:a:b", "!resetXformStack!",
    "!invert!xformOp:translate", "!invert!", "translate", "xformOp:", "", "xformOp:scale",
)  # fmt: skip
TYPES = (
    "Mesh", "Sphere", "Cube", "Points", "PointInstancer", "Camera", "DistantLight", "DomeLight",
    "ParticleField3DGaussianSplat", "ParticleFieldPackedSplat", "SplatSim", "Scope", "Xform",
    "Material", "Shader", "RenderProduct", "RenderSettings", "BasisCurves", "Nonsense", "",
)  # fmt: skip
NAMES = (
    "splat:grade:exposure", "splat:grade:matrix", "splat:grade:gain", "splat:packing", "ids",
    "velocities", "primvars:displayColor", "primvars:displayOpacity", "widths", "points",
    "visibility", "purpose", "extent", "extentsHint", "colorSpace:name", "xformOpOrder",
    "xformOp:translate", "radiance:sphericalHarmonicsDegree", "splat:rasterizeMode", "productName",
    "shutter:open", "shutter:close", "focalLength", "splatSim:substeps", "inputs:diffuseColor",
)  # fmt: skip
NOT_AUTHORED = (
    Tf.ErrorException,
    LookupError,
    TypeError,
    ValueError,
    ArithmeticError,
    RuntimeError,
)
"""Errors of mutations that a layer does not have a place for, or that USD does not allow."""
ARCS = ("", "./stage.usda", "./missing.usda", "./other.usda", "./broken.usda")


def sources(folder: Path) -> list[Path]:
    """Write valid stages: one with a product, one with instances and points, one with a splat tree,
    and those of 0.6."""
    found = [folder / "product.usda", folder / "instances.usda"]
    stage = base(found[0])
    schema.author(stage, "/W/Packed/F", ball(12), form="packed")
    schema.author_grade(stage.GetPrimAtPath("/W"), exposure=0.5)
    stage.Save()
    _instances(found[1]).Save()
    found.append(little_tree(folder, ball(40)))
    for path in sorted(DATA.glob("*.usd*")):
        layer = Sdf.Layer.FindOrOpen(str(path))
        found.append(folder / f"{path.stem}_0_6.usda")
        layer.Export(str(found[-1]))
    return found


def _instances(path: Path) -> Usd.Stage:
    """A stage with instances, a point instancer, points, crops, a variant and a simulation."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Z")
    world = UsdGeom.Xform.Define(stage, "/W").GetPrim()
    stage.SetDefaultPrim(world)
    schema.author(stage, "/Source/F", ball(20))
    for name in ("A", "B"):
        prim = stage.DefinePrim(f"/W/{name}", "Xform")
        prim.GetReferences().AddInternalReference("/Source")
        prim.SetInstanceable(True)
    stage.GetPrimAtPath("/Source").SetSpecifier(Sdf.SpecifierClass)
    instancer = UsdGeom.PointInstancer.Define(stage, "/W/Many")
    UsdGeom.Sphere.Define(stage, "/W/Many/Ball")
    instancer.CreatePrototypesRel().SetTargets(["/W/Many/Ball", "/Source/F"])
    instancer.CreateProtoIndicesAttr([0, 1, 0])
    instancer.CreatePositionsAttr([(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    points = UsdGeom.Points.Define(stage, "/W/Points")
    points.CreatePointsAttr([(0, 0, 0), (1, 1, 1)])
    points.CreateWidthsAttr([0.5, 1.0])
    points.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set([(1, 0, 0), (0, 1, 0)])
    matte = UsdGeom.Cube.Define(stage, "/W/Matte")
    world.CreateRelationship("collection:cropInclude:includes").SetTargets([matte.GetPath()])
    field = schema.author(stage, "/W/Moving", ball(8))
    for time in (1, 2):
        schema.author(stage, "/W/Moving", ball(8, seed=time), time=time)
    looks = field.GetVariantSets().AddVariantSet("look")
    looks.AddVariant("red")
    looks.SetVariantSelection("red")
    with looks.GetVariantEditContext():
        field.GetAttribute("opacities").Set([0.5] * 8)
    UsdLux.DistantLight.Define(stage, "/W/Sun").CreateIntensityAttr(2.0)
    sim = stage.DefinePrim("/W/Sim", "SplatSim")
    sim.CreateRelationship("collection:splats:includes").SetTargets(["/W/Moving"])
    return stage


def mutated(seed: int, originals: list[Path], folder: Path) -> Path:
    """Write one of the stages with random damage to a folder, and return its path."""
    rng = random.Random(seed)
    path, source = folder / "stage.usda", rng.choice(originals)
    shutil.copy(originals[0], folder / "other.usda")
    shutil.copytree(originals[0].parent / "tree_chunks", folder / "tree_chunks")
    (folder / "broken.usda").write_text('#usda 1.0\ndef Xform "W" {\n')
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.TransferContent(Sdf.Layer.FindOrOpen(str(source)))
    for _ in range(rng.randint(1, 4)):
        try:
            rng.choice(MUTATIONS)(rng, layer)
        except NOT_AUTHORED:
            continue  # USD does not allow this one to be authored
    text = layer.ExportToString()
    path.write_text(_damaged(rng, text) if rng.random() < 0.1 else text, encoding="utf-8")
    return path


# --- mutations -----------------------------------------------------------------------------------


def _prims(layer: Sdf.Layer) -> list[Sdf.PrimSpec]:
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    return [layer.GetPrimAtPath(path) for path in sorted(paths) if path.IsPrimPath()]


def _attributes(layer: Sdf.Layer) -> list[Sdf.AttributeSpec]:
    return [each for prim in _prims(layer) for each in prim.attributes]


def _number(rng: random.Random) -> float:
    return rng.choice(NUMBERS) if rng.random() < 0.7 else rng.uniform(-3, 3)


def _scalar(rng: random.Random, default: Any) -> Any:
    """A value of the type of another one."""
    if isinstance(default, bool):
        return rng.random() < 0.5
    if isinstance(default, int):
        return rng.choice(WHOLE)
    if isinstance(default, float):
        return _number(rng)
    if isinstance(default, str):
        return rng.choice(WORDS)
    if isinstance(default, Sdf.AssetPath):
        return Sdf.AssetPath(rng.choice(("missing.png", "./stage.usda", "/dev/null", "a[b]")))
    if isinstance(default, Gf.Quatf | Gf.Quath | Gf.Quatd):
        return type(default)(*(_number(rng) for _ in range(4)))
    if hasattr(default, "dimension"):
        dimension = default.dimension
        size = dimension if isinstance(dimension, int) else dimension[0] * dimension[1]
        whole = isinstance(default, Gf.Vec2i | Gf.Vec3i | Gf.Vec4i)
        return type(default)(*(rng.choice(WHOLE) if whole else _number(rng) for _ in range(size)))
    return default


def _value(rng: random.Random, kind: Sdf.ValueTypeName) -> Any:
    """A random value of a type."""
    one = kind.scalarType.defaultValue
    if not kind.isArray:
        return _scalar(rng, one)
    some = [_scalar(rng, one) for _ in range(rng.randint(1, 3))]
    return type(kind.defaultValue)([rng.choice(some) for _ in range(rng.choice(LENGTHS))])


def change_value(rng: random.Random, layer: Sdf.Layer) -> None:
    """Replace a value by another one of its type, or block it."""
    attribute = rng.choice(_attributes(layer))
    if rng.random() < 0.1:
        attribute.default = Sdf.ValueBlock()
    else:
        attribute.default = _value(rng, attribute.typeName)


def damage_element(rng: random.Random, layer: Sdf.Layer) -> None:
    """Replace one element of an array."""
    attribute = rng.choice([each for each in _attributes(layer) if each.typeName.isArray])
    found = list(attribute.default or ())
    if found:
        found[rng.randrange(len(found))] = _scalar(rng, attribute.typeName.scalarType.defaultValue)
        attribute.default = type(attribute.typeName.defaultValue)(found)


def change_samples(rng: random.Random, layer: Sdf.Layer) -> None:
    """Author samples at ordinary and odd times."""
    attribute = rng.choice(_attributes(layer))
    for _ in range(rng.randint(1, 4)):
        time = rng.choice((1, 2, 1.5, 0, -1e6, 1e15, 3.25))
        layer.SetTimeSample(attribute.path, time, _value(rng, attribute.typeName))


def change_type(rng: random.Random, layer: Sdf.Layer) -> None:
    """Author a property of a known name with any type."""
    prim = rng.choice(_prims(layer))
    known = [each.name for each in prim.attributes]
    name = rng.choice(known) if known and rng.random() < 0.7 else rng.choice(NAMES)
    if name in prim.properties:
        del prim.properties[name]
    kinds = ("Float", "FloatArray", "Int", "IntArray", "Token", "TokenArray", "String", "Asset")
    kinds += ("Point3fArray", "Float3Array", "Int4Array", "Int64Array", "Matrix4d", "Double3")
    kind = getattr(Sdf.ValueTypeNames, rng.choice((*kinds, "QuatfArray", "Half", "Bool")))
    Sdf.AttributeSpec(prim, name, kind).default = _value(rng, kind)


def change_ops(rng: random.Random, layer: Sdf.Layer) -> None:
    """Author an order of transform ops."""
    prim = rng.choice(_prims(layer))
    name = "xformOpOrder"
    if name in prim.properties:
        del prim.properties[name]
    order = Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.TokenArray)
    order.default = Vt.TokenArray([rng.choice(OPS) for _ in range(rng.randint(1, 3))])


def delete(rng: random.Random, layer: Sdf.Layer) -> None:
    """Remove a prim or a property."""
    prim = rng.choice(_prims(layer))
    if rng.random() < 0.3 or not prim.properties:
        parent = prim.nameParent or layer.pseudoRoot
        del parent.nameChildren[prim.name]
    else:
        del prim.properties[rng.choice(list(prim.properties.keys()))]


def change_prim(rng: random.Random, layer: Sdf.Layer) -> None:
    """Change type, specifier, or metadata of a prim."""
    prim = rng.choice(_prims(layer))
    which = rng.randrange(6)
    if which == 0:
        prim.typeName = rng.choice(TYPES)
    elif which == 1:
        prim.specifier = rng.choice((Sdf.SpecifierDef, Sdf.SpecifierOver, Sdf.SpecifierClass))
    elif which == 2:
        prim.instanceable = not prim.instanceable
    elif which == 3:
        prim.active = not prim.active
    elif which == 4:
        prim.kind = rng.choice(("component", "assembly", "nonsense", "subcomponent"))
    else:
        known = ("SplatGradeAPI", "SplatCropAPI", "NoSuchAPI", "CollectionAPI:x", "GeomModelAPI")
        applied = Sdf.TokenListOp.CreateExplicit([rng.choice(known)])
        prim.SetInfo("apiSchemas", applied)


def change_stage(rng: random.Random, layer: Sdf.Layer) -> None:
    """Change the metadata of the stage."""
    root = layer.pseudoRoot
    name = rng.choice(
        ("metersPerUnit", "timeCodesPerSecond", "framesPerSecond", "startTimeCode", "endTimeCode")
    )
    which = rng.randrange(4)
    if which == 0:
        root.SetInfo("upAxis", rng.choice(("X", "Y", "Z", "", "up")))
    elif which == 1:
        layer.defaultPrim = rng.choice(("W", "Missing", "/W/A", ""))
    else:
        root.SetInfo(name, _number(rng))


def add_arc(rng: random.Random, layer: Sdf.Layer) -> None:
    """Add a reference, payload, class or sublayer: to a file, itself, or a prim of this layer."""
    prim = rng.choice(_prims(layer))
    path = rng.choice([*(each.path for each in _prims(layer)), Sdf.Path("/Missing"), Sdf.Path()])
    which, asset = rng.randrange(5), rng.choice(ARCS)
    if which == 0:
        prim.referenceList.Prepend(Sdf.Reference(asset, path))
    elif which == 1:
        prim.payloadList.Prepend(Sdf.Payload(asset, path))
    elif which == 2:
        prim.inheritPathList.Prepend(path)
    elif which == 3:
        prim.specializesList.Prepend(path)
    else:
        layer.subLayerPaths.append(asset or "./missing.usda")


def change_targets(rng: random.Random, layer: Sdf.Layer) -> None:
    """Point a relationship or a connection elsewhere, also at itself."""
    prims = _prims(layer)
    targets = [rng.choice(prims).path for _ in range(rng.randint(0, 3))]
    targets += rng.choice(([], [Sdf.Path("/Missing")], [Sdf.Path("/W.visibility")]))
    relationships = [each for prim in prims for each in prim.relationships]
    if relationships and rng.random() < 0.7:
        found = rng.choice(relationships)
        targets += rng.choice(([], [found.path]))
        found.targetPathList.ClearEditsAndMakeExplicit()
        found.targetPathList.explicitItems = list(dict.fromkeys(targets))
    else:
        attributes = _attributes(layer)
        source = rng.choice((rng.choice(attributes), rng.choice(attributes))).path
        rng.choice(attributes).connectionPathList.Prepend(source)


def change_clips(rng: random.Random, layer: Sdf.Layer) -> None:
    """Author metadata of value clips."""
    clip = {
        "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(rng.choice(ARCS[1:]))]),
        "primPath": rng.choice(("/W/Moving", "/Missing", "", "not a path")),
        "active": Vt.Vec2dArray([Gf.Vec2d(rng.choice((0, 1, NAN)), rng.choice((0, 7, -1)))]),
        "times": Vt.Vec2dArray([Gf.Vec2d(_number(rng), _number(rng)) for _ in range(2)]),
    }
    for name in rng.sample(list(clip), rng.randint(0, 2)):
        del clip[name]
    rng.choice(_prims(layer)).SetInfo("clips", {"default": clip})


def change_bake(rng: random.Random, layer: Sdf.Layer) -> None:
    """Author the record of an interrupted bake that lacks entries, or has some of other types."""
    record = {
        "checkpoint": rng.choice(("x", 1)),
        "frameRange": rng.choice(
            (Vt.DoubleArray([1, 2]), Vt.DoubleArray([NAN]), Vt.StringArray(["a", "b"]), 3.0)
        ),
        "completedFrames": rng.choice((1, "a", NAN)),
        "inputHash": rng.choice((Vt.StringArray(["a  b"]), Vt.IntArray([1]), 1)),
        "mode": rng.choice(("clips", 1)),
    }
    for name in rng.sample(list(record), rng.randint(0, 3)):
        del record[name]
    nested = {"usdsplat": {"bake": rng.choice((record, record, record, "x"))}}
    layer.customLayerData = nested
    rng.choice(_prims(layer)).customData = nested


MUTATIONS: tuple[Callable[[random.Random, Sdf.Layer], None], ...] = (
    *(change_value, change_value, damage_element, damage_element, change_samples, change_type),
    *(change_type, change_ops, delete, change_prim, change_stage, add_arc, add_arc),
    *(change_targets, change_clips, change_bake),
)


def _damaged(rng: random.Random, text: str) -> str:
    """Text of a layer that is cut, or with other characters."""
    at = rng.randrange(len(text))
    return rng.choice(
        (text[:at], text[:at] + rng.choice("{}()[]@\"'<>=\0") + text[at:], text + "\ndef")
    )
