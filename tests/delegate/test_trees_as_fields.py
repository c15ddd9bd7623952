"""Tests that all that acts on a field acts on a splat tree, against the field of its leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.delegate.stages import add_camera
from tests.delegate.tree_stages import field_stage, tree_stage
from tests.render.lod.trees import OF_SURFACES, Made, made
from tests.render.rendering import random_cloud
from usdsplat import schema
from usdsplat.delegate.engine import PURPOSES, Engine
from usdsplat.render.renderer import AOVS
from usdsplat.render.settings import RenderSettings

TREE = "/World/Tree"
LEAVES = RenderSettings(lod_error=0.0)
MOVING = RenderSettings(lod_error=0.0, samples=3)


def native_instances(stage: Usd.Stage) -> None:
    """Two native instances of the prim above, one of them mirrored; the prim itself is a class."""
    for number, matrix in enumerate((Gf.Matrix4d(), Gf.Matrix4d().SetScale((-1, 0.5, 1)))):
        prim = UsdGeom.Xform.Define(stage, f"/Copy{number}")
        prim.AddTransformOp().Set(matrix * Gf.Matrix4d().SetTranslate((number, 0, -number)))
        prim.GetPrim().GetReferences().AddInternalReference("/World")
        prim.GetPrim().SetInstanceable(True)
    stage.GetPrimAtPath("/World").SetSpecifier(Sdf.SpecifierClass)


def point_instances(stage: Usd.Stage) -> None:
    """Three point instances, one of them invisible, of a prim within the instancer."""
    many = UsdGeom.PointInstancer.Define(stage, "/Many")
    stage.DefinePrim("/Many/One").GetReferences().AddInternalReference("/World")
    many.CreatePrototypesRel().SetTargets(["/Many/One"])
    many.CreateProtoIndicesAttr([0, 0, 0])
    many.CreatePositionsAttr([(0, 0, 0), (1.5, 0.2, -2), (3, 0, 0)])
    many.CreateScalesAttr([(1, 1, 1), (0.5, 1, 2), (1, 1, 1)])
    many.CreateInvisibleIdsAttr([2])
    UsdGeom.Imageable(stage.GetPrimAtPath("/World")).MakeInvisible()
    UsdGeom.Imageable(stage.GetPrimAtPath("/Many/One")).MakeVisible()


def native_instances_of_point_instances(stage: Usd.Stage) -> None:
    """Instances of instances."""
    point_instances(stage)
    for number in range(2):
        prim = UsdGeom.Xform.Define(stage, f"/Group{number}")
        prim.AddTranslateOp().Set((0, 1.5 * number, 0))
        prim.GetPrim().GetReferences().AddInternalReference("/Many")
        prim.GetPrim().SetInstanceable(True)


def shear(stage: Usd.Stage) -> None:
    """A transform that mirrors and shears."""
    matrix = Gf.Matrix4d(1, 0.3, 0, 0, 0, -0.7, 0.4, 0, 0.2, 0, 1.3, 0, 0.1, 0, 0, 1)
    UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddTransformOp().Set(matrix)


def flat(stage: Usd.Stage) -> None:
    """A singular transform."""
    UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddScaleOp().Set((1, 1, 0))


def purpose(stage: Usd.Stage) -> None:
    """An inherited purpose that the pictures do not show, overridden on the prim."""
    for path, value in (("/World", "guide"), (TREE, "render")):
        UsdGeom.Imageable(stage.GetPrimAtPath(path)).CreatePurposeAttr(value)


def visible_in_frame_two(stage: Usd.Stage) -> None:
    """Visibility that changes."""
    attribute = UsdGeom.Imageable(stage.GetPrimAtPath("/World")).CreateVisibilityAttr()
    attribute.Set("invisible", 1)
    attribute.Set("inherited", 2)


def grades(stage: Usd.Stage) -> None:
    """A grade above, and one on the prim."""
    schema.author_grade(stage.GetPrimAtPath("/World"), exposure=0.7, saturation=0.4)
    schema.author_grade(stage.GetPrimAtPath(TREE), gain=(1.2, 0.8, 0.5))


def a_grade_that_changes(stage: Usd.Stage) -> None:
    """A grade with samples, which differs within the shutter."""
    for time, value in ((1, -3.0), (2, 0.0), (3, 2.0)):
        schema.author_grade(stage.GetPrimAtPath("/World"), exposure=value, time=time)


def crops(stage: Usd.Stage) -> None:
    """A volume that keeps, above, and one that removes, on the prim."""
    UsdGeom.Sphere.Define(stage, "/Ball").CreateRadiusAttr(1.2)
    UsdGeom.Cube.Define(stage, "/Box").AddTranslateOp().Set((1.5, 0, 0))
    for path, name, volume in (("/World", "cropInclude", "/Ball"), (TREE, "cropExclude", "/Box")):
        prim = stage.GetPrimAtPath(path)
        prim.AddAppliedSchema("SplatCropAPI")
        includes = prim.CreateRelationship(f"collection:{name}:includes", custom=False)
        includes.SetTargets([volume])
    UsdGeom.Imageable(stage.GetPrimAtPath("/Ball")).MakeInvisible()
    UsdGeom.Imageable(stage.GetPrimAtPath("/Box")).MakeInvisible()


def crops_that_move(stage: Usd.Stage) -> None:
    """Volumes that move within the shutter."""
    crops(stage)
    move = UsdGeom.Xformable(stage.GetPrimAtPath("/Ball")).AddTranslateOp()
    for time in (1, 3):
        move.Set((time - 2.0, 0, 0), time)


def everything_that_changes(stage: Usd.Stage) -> None:
    """Volumes and a grade."""
    crops_that_move(stage)
    a_grade_that_changes(stage)


def motion(stage: Usd.Stage) -> None:
    """A transform that turns and moves, within the shutter."""
    prim = UsdGeom.Xformable(stage.GetPrimAtPath("/World"))
    move, turn = prim.AddTranslateOp(), prim.AddRotateYOp()
    for time in (1, 2, 3):
        move.Set((0.7 * (time - 2), 0.1 * time, 0), time)
        turn.Set(40.0 * time, time)


def point_instances_that_move(stage: Usd.Stage) -> None:
    """Point instances with velocities."""
    point_instances(stage)
    many = UsdGeom.PointInstancer(stage.GetPrimAtPath("/Many"))
    many.GetPositionsAttr().Set([(0, 0, 0), (1.5, 0.2, -2), (3, 0, 0)], 2)
    many.CreateVelocitiesAttr().Set([(9, 0, 0), (0, 7, 0), (0, 0, 0)], 2)


def variants(stage: Usd.Stage) -> None:
    """A variant with a grade, a transform and another sorting mode."""
    prim = stage.GetPrimAtPath(TREE)
    looks = prim.GetVariantSets().AddVariantSet("look")
    for name in ("plain", "bright"):
        looks.AddVariant(name)
    looks.SetVariantSelection("bright")
    with looks.GetVariantEditContext():
        schema.author_grade(prim, exposure=1.0)
        UsdGeom.Xformable(prim).AddTranslateOp().Set((0.3, 0, 0))
        prim.CreateAttribute("sortingModeHint", Sdf.ValueTypeNames.Token).Set("cameraDistance")


def hints(**values: object):
    """Return an edit that authors drawing hints."""
    return lambda stage: schema.DrawingHints(**values).author(stage.GetPrimAtPath(TREE))


def surfaces(stage: Usd.Stage) -> None:
    """An opaque ball within the splats."""
    UsdGeom.Sphere.Define(stage, "/Ball").CreateRadiusAttr(0.6)


EDITS = {
    "nothing": lambda stage: None,
    "native instances": native_instances,
    "point instances": point_instances,
    "instances of instances": native_instances_of_point_instances,
    "shear": shear,
    "flat": flat,
    "purpose": purpose,
    "visibility": visible_in_frame_two,
    "grades": grades,
    "changing grade": a_grade_that_changes,
    "crops": crops,
    "moving crops": crops_that_move,
    "moving crops and grade": everything_that_changes,
    "motion": motion,
    "moving point instances": point_instances_that_move,
    "variants": variants,
    "distance": hints(sorting_mode="cameraDistance"),
    "ray hit": hints(sorting_mode="rayHitDistance"),
    "tangential": hints(projection_mode="tangential"),
    "antialiased": hints(rasterize_mode="antialiased"),
    "footprint": hints(footprint=0.05),
    "surfaces": surfaces,
}
"""Name -> what is done to a stage with a tree, or a field, at /World/Tree."""


def framed(stage: Usd.Stage, edit) -> Usd.Stage:
    """The stage with an edit, and a camera with a shutter."""
    camera = add_camera(stage, eye=(0.5, 0.2, 7.0))
    camera.CreateShutterOpenAttr(-0.5)
    camera.CreateShutterCloseAttr(0.5)
    edit(stage)
    return stage


def pictures(stage: Usd.Stage, settings: RenderSettings, aovs=AOVS) -> dict[str, np.ndarray]:
    """All AOVs of frame 2, after one of frame 1 in the same engine."""
    with Engine(stage, device="cpu", time=1.0, purposes=PURPOSES[:2]) as engine:
        view = engine.view("/Camera", resolution=(48, 36))
        engine.picture(view, settings)
        engine.set_time(2.0)
        view = engine.view("/Camera", resolution=(48, 36))
        return {k: v.copy() for k, v in engine.picture(view, settings, aovs).items()}


def assert_same(found, expected) -> None:
    """All AOVs but those of surfaces, which trees do not have."""
    for name in expected.keys() - OF_SURFACES:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)


@pytest.fixture(scope="module")
def tree() -> Made:
    """A tree of 200 splats with strays and four levels."""
    return made(3, n=200, leaf=40, strays=3)


@pytest.mark.parametrize("settings", [LEAVES, MOVING], ids=["one sample", "blur"])
@pytest.mark.parametrize("name", EDITS)
def test_what_acts_on_a_field_acts_on_a_tree(tmp_path, tree, name, settings) -> None:
    """Oracle: a field of the same splats with the same edit, in every AOV and bit for bit."""
    stage, _ = tree_stage(tmp_path, tree)
    found = pictures(framed(stage, EDITS[name]), settings)
    assert_same(found, pictures(framed(field_stage(tree), EDITS[name]), settings))
    assert (found["color"][..., 3] > 0).any() or name == "flat"


@pytest.mark.parametrize("form", ["float", "packed"])
@pytest.mark.parametrize("degree", range(5))
def test_every_degree_and_form_of_chunks(tmp_path, degree: int, form) -> None:
    """Oracle: the field of the same splats: bit for bit, or within the error of packing."""
    tree = made(4, n=150, degree=degree, leaf=40)
    stage, _ = tree_stage(tmp_path, tree, form=form)
    found = pictures(framed(stage, shear), LEAVES)
    expected = pictures(framed(field_stage(tree), shear), LEAVES)
    if form == "float":
        assert_same(found, expected)
    else:
        difference = np.abs(found["color"] - expected["color"])
        assert 0 < difference.max() < 0.1 and difference.mean() < 2e-3


@pytest.mark.parametrize("mode", ["zDepth", "rayHitDistance"])
def test_deep_samples_and_ids_of_instances(tmp_path, tree, mode) -> None:
    """Oracle: the field of the same splats, sample by sample."""

    def deep(stage: Usd.Stage):
        with Engine(stage, device="cpu", time=2.0) as engine:
            view = engine.view("/Camera", resolution=(48, 36))
            settings = replace(MOVING, sorting=mode)
            strips = engine.render_deep(view, settings, ("primId", "instanceId", "elementId"))
            return [(each.depth.copy(), each.color.copy(), each.ids.copy()) for *_, each in strips]

    def edit(stage: Usd.Stage) -> None:
        point_instances_that_move(stage)
        a_grade_that_changes(stage)
        crops(stage)

    stage, _ = tree_stage(tmp_path, tree)
    found, expected = deep(framed(stage, edit)), deep(framed(field_stage(tree), edit))
    assert sum(len(each[0]) for each in found) > 100
    for mine, theirs in zip(found, expected, strict=True):
        for a, b in zip(mine, theirs, strict=True):
            np.testing.assert_array_equal(a, b)


def test_splats_that_no_picture_shows_well_are_those_of_a_field(tmp_path) -> None:
    """Oracle: the field of the same splats: opaque and invisible ones, of no size, huge, flat, far
    away, and many at one place."""
    cloud = random_cloud(5, 160)
    cloud.opacities[:20], cloud.opacities[20:40] = 1.0, 0.0
    cloud.scales[40:50], cloud.scales[50:55] = 0.0, 20.0
    cloud.scales[55:70, 2] = 1e-9
    cloud.positions[70:80], cloud.positions[80:100] = 1e6, 0.25
    tree = Made(cloud, leaf=40)
    stage, _ = tree_stage(tmp_path, tree)
    for edit in (EDITS["nothing"], EDITS["tangential"]):
        found = pictures(framed(stage, edit), LEAVES)
        assert_same(found, pictures(framed(field_stage(tree), edit), LEAVES))
        stage.RemovePrim("/Camera")
