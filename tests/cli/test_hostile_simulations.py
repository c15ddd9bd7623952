"""Tests of the error messages for stages that cannot be simulated, on the command line."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from tests.cli.conftest import ball
from usdsplat import schema
from usdsplat.sim.stage.authoring import author

T = Sdf.ValueTypeNames
INF, NAN = float("inf"), float("nan")
FIELD, SIM, BALL, MESH = "/World/Field", "/World/Sim", "/World/Ball", "/World/Mesh"
CORNERS = [(0, 0, 0), (0.3, 0, 0), (0, 0.3, 0), (0, 0, 0.3)]
FACES = [0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2]


def make(path, count=40):
    """Two frames of some splats and a SplatSim prim."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(2)
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    schema.author(stage, FIELD, ball(count))
    stage.DefinePrim(SIM, "SplatSim")
    return stage


def says(name, kind, *values, on=SIM):
    """What authors a parameter, whatever its type; more values than one are samples."""

    def edit(stage):
        attribute = stage.GetPrimAtPath(on).CreateAttribute(f"splatSim:{name}", kind, custom=False)
        for frame, value in enumerate(values, 1):
            if len(values) > 1:
                attribute.Set(value, frame)
            else:
                attribute.Set(value)

    return edit


def leads(name, *targets):
    """What authors a relationship."""
    return lambda stage: (
        stage.GetPrimAtPath(SIM)
        .CreateRelationship(f"splatSim:{name}", custom=False)
        .SetTargets(targets)
    )


def sphere(radius=0.2, **knobs):
    """What adds a ball; knobs are authored whatever their value."""

    def edit(stage):
        prim = UsdGeom.Sphere.Define(stage, BALL)
        prim.CreateRadiusAttr(radius)
        author(prim.GetPrim(), {"affector:friction": 0.1})
        for name, value in knobs.items():
            says(f"affector:{name}", T.Float, value, on=BALL)(stage)

    return edit


def moved(*places):
    """What moves the ball."""

    def edit(stage):
        sphere()(stage)
        move = UsdGeom.Xformable(stage.GetPrimAtPath(BALL)).AddTranslateOp()
        for frame, place in enumerate(places, 1):
            move.Set(Gf.Vec3d(*place), frame)

    return edit


def mesh(points=CORNERS, counts=(3, 3, 3, 3), indices=FACES, **knobs):
    """What adds a mesh that acts."""

    def edit(stage):
        prim = UsdGeom.Mesh.Define(stage, MESH)
        prim.CreatePointsAttr(points)
        prim.CreateFaceVertexCountsAttr(list(counts))
        prim.CreateFaceVertexIndicesAttr(indices)
        author(prim.GetPrim(), {"affector:friction": 0.1})
        for name, value in knobs.items():
            says(f"affector:{name}", T.Float, value, on=MESH)(stage)

    return edit


def skeleton(joints=("a", "a/b"), matrix=1.0, **knobs):
    """What adds a skeleton that acts."""

    def edit(stage):
        UsdSkel.Root.Define(stage, "/World/Rig")
        prim = UsdSkel.Skeleton.Define(stage, "/World/Rig/Bones")
        prim.CreateJointsAttr(joints)
        prim.CreateBindTransformsAttr([Gf.Matrix4d(matrix)] * len(joints))
        prim.CreateRestTransformsAttr([Gf.Matrix4d(matrix)] * len(joints))
        author(prim.GetPrim(), {"affector:friction": 0.1, **knobs})

    return edit


def acts(kind):
    """What makes a prim of a type an affector."""
    return lambda stage: author(stage.DefinePrim("/World/It", kind), {"affector:friction": 0.1})


def place(kind, value):
    """What places the field."""

    def edit(stage):
        field = UsdGeom.Xformable(stage.GetPrimAtPath(FIELD))
        op = field.AddScaleOp() if kind == "scale" else field.AddTranslateOp()
        op.Set((Gf.Vec3f if kind == "scale" else Gf.Vec3d)(*value))
        sphere()(stage)

    return edit


def nowhere(stage):
    """A centre that is no number."""
    attribute = stage.GetPrimAtPath(FIELD).GetAttribute("positions")
    points = np.array(attribute.Get())
    points[3] = NAN
    attribute.Set(Vt.Vec3fArray.FromNumpy(points))


def weights(values, kind=T.FloatArray):
    """What selects splats."""
    return lambda stage: (
        UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(FIELD))
        .CreatePrimvar("splatSim:weight", kind, "vertex")
        .Set(values)
    )


def all_of(*edits):
    """Several edits."""

    def edit(stage):
        for each in edits:
            each(stage)

    return edit


def include(collection, path):
    """What says who is in a collection."""
    return lambda stage: (
        stage.GetPrimAtPath(SIM)
        .CreateRelationship(f"collection:{collection}:includes", custom=False)
        .SetTargets([path])
    )


HOSTILE = {
    "nan": (says("settle:omega", T.Float, NAN), "omega: found nan, expected 0 to 100 [1/s]"),
    "text": (says("settle:omega", T.String, "fast"), "omega: found 'fast', expected 0 to 100"),
    "array": (says("settle:omega", T.FloatArray, [1.0, 2.0]), "omega: found (1.0, 2.0), expected"),
    "float for bool": (says("rd:enabled", T.Float, 1.0), "rd:enabled: found 1.0, expected bool"),
    "int for token": (says("rd:preset", T.Int, 3), "rd:preset: found 3, expected one of custom"),
    "begun long ago": (
        says("sim:startTime", T.TimeCode, Sdf.TimeCode(-1e9)),
        "startTime: found -1e+09, expected one at most 100000 frames before 1",
    ),
    "unknown token": (says("rd:preset", T.Token, "stripes"), "found 'stripes', expected one of cu"),
    "later sample": (says("settle:omega", T.Float, 1.0, -5.0), "omega: found -5.0, expected 0 to"),
    "many substeps": (says("sim:substeps", T.Int, 2_000_000_000), "expected 1 to 64"),
    "nan vector": (says("particles:gravity", T.Vector3f, Gf.Vec3f(NAN)), "expected 3 numbers"),
    "inf vector": (says("particles:gravity", T.Vector3f, Gf.Vec3f(INF)), "expected finite numbers"),
    "inf scale": (says("rd:patternScale", T.Float, INF), "found inf, expected -1 or more [unit], "),
    "nan lattice": (says("deform:a:points", T.Point3fArray, [(NAN, 0, 0)] * 8), "expected finite"),
    "few points": (
        all_of(says("deform:a:type", T.Token, "lattice"),
               says("deform:a:points", T.Point3fArray, [(0, 0, 0)])),
        "deform:a:points: found 1 points, expected 8, as many as divisions say",
    ),
    "no frame": (leads("deform:a:frame", "/No"), "a:frame: found the target /No, which does not e"),
    "no mask": (says("deform:a:mask", T.String, "no"), "a:mask: found 'no', which does not exist"),
    "no target": (leads("conform:target", "/No"), "found the target /No, which does not ex"),
    "two targets": (leads("conform:target", FIELD, SIM), "target: found 2 targets, expected one"),
    "wrong target": (leads("conform:target", "/World"), "found a prim of type Xform, expected a M"),
    "wrong skeleton": (leads("skin:skeleton", FIELD), "expected a Skeleton"),
    "no joints": (skeleton(joints=()), "Bones: found no joints with a bind pose, expected bind"),
    "nan joints": (skeleton(matrix=NAN), "Bones: found joint transforms that are not finite"),
    "unknown joint": (skeleton(**{"affector:joints": ("z",)}), "found the joint z, expected one o"),
    "unbound": (all_of(skeleton(), leads("skin:skeleton", "/World/Rig/Bones")), "found no mesh, a"),
    "no faces": (mesh(counts=[], indices=[]), "Mesh: found a mesh without faces, expected a mes"),
    "no point": (mesh(counts=[3], indices=[0, 1, 900_000]), "found face vertex index 900000, expe"),
    "huge face": (mesh(counts=[2_000_000_000], indices=[0, 1, 2]), "expected 2000000000, the sum"),
    "nan mesh": (mesh(points=[(NAN, 0, 0), *CORNERS[1:]]), "Mesh.points: found numbers that are n"),
    "fine voxels": (mesh(voxelSize=1e-7), "voxelSize: found 1e-07, a field of 270002160005760000"),
    "negative radius": (sphere(-1.0), "Ball.radius: found -1.0, expected 0 or more"),
    "inf radius": (sphere(INF), "Ball.radius: found inf, expected 0 or more"),
    "inf blend": (sphere(blend=INF), "affector:blend: found inf, expected 0 or more [unit], finit"),
    "inf amount": (sphere(amount=INF), "affector:amount: found inf, expected a number, finite"),
    "ball leaves": (moved((0, 0, 0), (INF, 0, 0)), "Ball at 2: found a transform that is not fini"),
    "nan ball": (moved((NAN, 0, 0)), "Ball at 1: found a transform that is not finite, expected a"),
    "cone": (acts("Cone"), "found an affector of type Cone, expected one of Sphere, Capsule"),
    "no type": (acts(""), "found an affector without a type, expected one of Sphere, Capsule"),
    "flat field": (place("scale", (0, 1, 1)), "Field at 1: found a singular transform, expected "),
    "lost field": (place("move", (NAN, 0, 0)), "Field at 1: found a transform that is not finite"),
    "lost splat": (nowhere, "Field: found 1 splats with numbers that are not finite, expected fin"),
    "nan weight": (weights([NAN] * 40), "primvars:splatSim:weight: found numbers that are not fin"),
    "few weights": (weights([1.0] * 39), "found 39 numbers, expected 40, one for each splat, or 1"),
    "word weights": (weights(["a"] * 40, T.StringArray), "expected an array of numbers"),
    "no field": (include("splats", "/No"), "found no splat field in any simulation, expected at "),
    "two simulations": (lambda stage: stage.DefinePrim("/World/Two", "SplatSim"), "found the simu"),
    "no rate": (lambda stage: stage.SetTimeCodesPerSecond(0), "found timeCodesPerSecond of 0, exp"),
    "long": (lambda stage: stage.SetEndTimeCode(1e12), "a stage from 1 to 1e+12, expected a range"),
    "endless": (lambda stage: stage.SetEndTimeCode(INF), "a stage from 1 to inf, expected a range"),
    "backwards": (lambda stage: stage.SetEndTimeCode(-5), "a stage from 1 to -5, expected a range"),
    "edit and births": (
        all_of(says("bake:mode", T.Token, "edit"), says("rd:enabled", T.Bool, True),
               says("growth:birthRate", T.Float, 1.0)),
        "bake:mode edit: found splats that are born, die, are divided, or fill broken pieces",
    ),
}  # fmt: skip
"""What is wrong -> the edit that makes it so, and a part of the sentence about it."""


@pytest.mark.parametrize("wrong", HOSTILE)
def test_a_stage_that_cannot_be_simulated_is_one_sentence(wrong, run, tmp_path):
    """Oracle: where: found X, expected Y; status 2, and nothing is written."""
    edit, sentence = HOSTILE[wrong]
    stage = make(tmp_path / "stage.usda")
    edit(stage)
    stage.GetRootLayer().Save()
    status, out, err = run("simulate", tmp_path / "stage.usda", "-o", tmp_path / "bake.usda")
    assert (status, out) == (2, "")
    said = [line for line in err.splitlines() if "compiling" not in line]
    assert len(said) == 1 and said[0].startswith("usdsplat: ")
    assert ": found " in said[0] and ", expected " in said[0] and sentence in said[0]
    assert [path.name for path in tmp_path.iterdir()] == ["stage.usda"]


def test_no_splats_are_one_sentence(run, tmp_path):
    """Oracle: the sentence; an empty field is no simulation."""
    stage = make(tmp_path / "stage.usda", 0)
    stage.GetRootLayer().Save()
    status, _, err = run("simulate", tmp_path / "stage.usda", "-o", tmp_path / "bake.usda")
    assert (status, err) == (
        2,
        f"usdsplat: {FIELD}: found no splats, expected at least one splat\n",
    )


GROWING = {"rd:enabled": True, "growth:birthRate": 1.0, "growth:rate": 0.1}


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize(
    "values",
    [GROWING, {**GROWING, "rd:domain": "self"}, {"dissolve:enabled": True}, {"settle:omega": 1.0}],
    ids=["carrier", "self", "dissolve", "settle"],
)
def test_one_splat_and_two_are_simulated(values, count, run, tmp_path):
    """Oracle: finite numbers at every frame, and no splat that is lost."""
    stage = make(tmp_path / "stage.usda", count)
    author(stage.GetPrimAtPath(SIM), values)
    sphere()(stage)
    stage.GetRootLayer().Save()
    assert run("simulate", tmp_path / "stage.usda", "-o", tmp_path / "bake.usda")[0] == 0
    bake = Usd.Stage.Open(str(tmp_path / "bake.usda"))
    field = bake.GetPrimAtPath(FIELD)
    for frame in (1, 2):
        cloud = schema.fetch(field, frame)
        assert len(cloud) >= count
        for numbers in (cloud.positions, cloud.scales, cloud.rotations, cloud.opacities):
            assert np.isfinite(numbers).all()


DOUBTFUL = {
    "no target": (says("conform:weight", T.Float, 1.0), "conform:weight: found a weight and no ta"),
    "no weight": (
        all_of(mesh(), leads("conform:target", MESH)), "conform:weight: found 0 and a target, exp",
    ),
    "no skeleton": (
        all_of(mesh(), leads("skin:mesh", MESH)), "skin:skeleton: found none, and a mesh to take",
    ),
    "no pattern": (
        says("growth:rate", T.Float, 1.0), "growth:rate: found growth without a pattern, expected",
    ),
    "unread driver": (
        says("driver:a:amount", T.Float, 2.0), "driver:a:source: found a driver without a pattern",
    ),
    "no affector": (
        include("affectors", "/No"), "affectors:includes: found /No, which does not exist",
    ),
    "slip": (says("rd:fed", T.Float, 0.03), "expected such as splatSim:rd:feed"),
    "animated": (says("sim:seed", T.Int, 1, 2), "found samples over time, expected one value for"),
}  # fmt: skip
"""What is legal and hardly meant -> the edit, and a part of the remark about it."""


@pytest.mark.parametrize("odd", DOUBTFUL)
def test_what_leads_nowhere_is_said(odd, run, tmp_path):
    """Oracle: a sentence on stderr; the simulation is done."""
    edit, sentence = DOUBTFUL[odd]
    stage = make(tmp_path / "stage.usda")
    edit(stage)
    stage.GetRootLayer().Save()
    status, _, err = run("simulate", tmp_path / "stage.usda", "-o", tmp_path / "bake.usda")
    assert status == 0
    assert [line for line in err.splitlines() if sentence in line] != []
