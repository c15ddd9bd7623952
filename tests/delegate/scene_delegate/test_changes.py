"""Tests of which edits make the delegate read data again."""

from __future__ import annotations

from collections import Counter

import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.delegate.stages import add_camera, contents, random_cloud, two_fields
from usdsplat import schema
from usdsplat.delegate.engine import Engine


def pulled(engine, edit):
    """What the next sync reads after `edit`."""
    engine.sync()
    before = Counter(engine.pulls)
    edit()
    engine.sync()
    return Counter(engine.pulls) - before


@pytest.fixture
def stage():
    stage = two_fields()
    add_camera(stage, "/World/Camera")
    scattered = UsdGeom.PointInstancer.Define(stage, "/Scatter")
    scattered.CreatePrototypesRel().SetTargets(["/World/B"])
    scattered.CreateProtoIndicesAttr([0, 0])
    scattered.CreatePositionsAttr([Gf.Vec3f(0), Gf.Vec3f(5)])
    return stage


def attribute(stage, path):
    return stage.GetAttributeAtPath(path)


EDITS = {
    "nothing": (lambda stage: None, Counter()),
    "opacities": (
        lambda stage: attribute(stage, "/World/A.opacities").Set(Vt.FloatArray([0.5] * 12)),
        Counter(field=1),
    ),
    "a hint": (
        lambda stage: schema.author(
            stage, "/World/A", random_cloud(), drawing=schema.DrawingHints(sorting_mode="zDepth")
        ),
        Counter(field=1),
    ),
    "extent": (
        lambda stage: attribute(stage, "/World/A.extent").Set(Vt.Vec3fArray(2)),
        Counter(),
    ),
    "somebody's attribute": (
        lambda stage: stage.GetPrimAtPath("/World/A").CreateAttribute(
            "note", Sdf.ValueTypeNames.String
        ),
        Counter(),
    ),
    "a transform": (
        lambda stage: attribute(stage, "/World/B.xformOp:translate").Set((1, 1, 1)),
        Counter(transforms=1),
    ),
    "a transform above": (
        lambda stage: UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddRotateXOp().Set(10.0),
        Counter(transforms=2, camera=1),
    ),
    "visibility": (
        lambda stage: UsdGeom.Imageable(stage.GetPrimAtPath("/World/A")).MakeInvisible(),
        Counter(visible=1),
    ),
    "purpose": (
        lambda stage: UsdGeom.Imageable(stage.GetPrimAtPath("/World")).CreatePurposeAttr("guide"),
        Counter(visible=2),
    ),
    "instances": (
        lambda stage: attribute(stage, "/Scatter.positions").Set(Vt.Vec3fArray(2)),
        Counter(instancer=1),
    ),
    "inactive ids": (
        lambda stage: UsdGeom.PointInstancer(stage.GetPrimAtPath("/Scatter")).DeactivateId(0),
        Counter(instancer=1),
    ),
    "prototypes": (
        lambda stage: stage.GetRelationshipAtPath("/Scatter.prototypes").SetTargets(["/World/A"]),
        Counter(placements=2, transforms=2, visible=2, instancer=1),
    ),
    "a lens": (
        lambda stage: attribute(stage, "/World/Camera.focalLength").Set(30.0),
        Counter(camera=1),
    ),
    "a new field": (
        lambda stage: schema.author(stage, "/World/C", random_cloud()),
        Counter(field=1, placements=1, transforms=1, visible=1),
    ),
    "a new prim of no interest": (lambda stage: stage.DefinePrim("/World/Group"), Counter()),
    "a removed field": (lambda stage: stage.RemovePrim("/World/A"), Counter()),
    "the end of the shot": (lambda stage: stage.SetEndTimeCode(100), Counter()),
    "time codes per second": (
        lambda stage: stage.SetTimeCodesPerSecond(10),
        Counter(field=2, placements=2, transforms=2, visible=2, instancer=1, camera=1),
    ),
    "colour space above": (
        lambda stage: (
            Usd.ColorSpaceAPI(stage.GetPrimAtPath("/World/A"))
            .GetColorSpaceNameAttr()
            .Set("lin_rec709_scene")
        ),
        Counter(field=1),
    ),
    "the session layer": (
        lambda stage: stage.GetSessionLayer().ImportFromString(
            '#usda 1.0\nover "World"\n{\nover "A"\n{\ntoken visibility = "invisible"\n}\n}\n'
        ),
        Counter(visible=1),
    ),
}


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_pulls_what_it_changed_and_no_more(stage, name):
    """Oracle: the list above, written from the meaning of each edit; and a fresh engine's picture
    of the stage."""
    edit, expected = EDITS[name]
    with Engine(stage) as engine:
        assert pulled(engine, lambda: edit(stage)) == expected
        with Engine(stage) as fresh:
            assert contents(engine) == contents(fresh)


def test_time_pulls_only_what_varies(stage):
    """Oracle: the samples authored here."""
    attribute(stage, "/World/B.xformOp:translate").Set((0, 0, 0), 1)
    attribute(stage, "/World/B.xformOp:translate").Set((5, 0, 0), 2)
    with Engine(stage, time=1) as engine:
        assert pulled(engine, lambda: engine.set_time(2)) == Counter(transforms=1)
        attribute(stage, "/World/A.opacities").Set(Vt.FloatArray([0.5] * 12), 1)
        assert pulled(engine, lambda: engine.set_time(3)) == Counter(transforms=1)
        attribute(stage, "/World/A.opacities").Set(Vt.FloatArray([0.2] * 12), 2)
        assert pulled(engine, lambda: engine.set_time(4)) == Counter(transforms=1, field=1)
        assert pulled(engine, lambda: engine.set_time(4)) == Counter()

        def there_and_back():
            engine.set_time(5)
            engine.set_time(4)

        assert pulled(engine, there_and_back) == Counter()
        everything = Counter(field=2, transforms=2, visible=2, instancer=1, camera=1)
        assert pulled(engine, lambda: engine.set_time(None)) == everything


def test_value_clips_are_followed(tmp_path):
    """Oracle: the clips' own numbers, one file for each frame."""
    for frame in (1, 2, 3):
        clip = Usd.Stage.CreateNew(str(tmp_path / f"clip.{frame}.usda"))
        cloud = random_cloud(frame, n=frame + 3)
        schema.author(clip, "/Splats", cloud, time=frame)
        clip.Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    prim = stage.DefinePrim("/Splats", "ParticleField3DGaussianSplat")
    with Engine(stage, time=1) as engine:
        assert engine.drawn_paths() == ()
        clips = Usd.ClipsAPI(prim)
        clips.SetClipPrimPath("/Splats")
        clips.SetClipTemplateAssetPath("./clip.#.usda")
        clips.SetClipTemplateStartTime(1)
        clips.SetClipTemplateEndTime(3)
        clips.SetClipTemplateStride(1)
        for frame in (1, 2, 3, 2):
            engine.set_time(frame)
            assert engine.render_scene.splat_count == frame + 3


def test_purposes_pull_visibility_and_the_arrays_of_what_appears(stage):
    """Oracle: what each purpose is, by hand."""
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/A")).CreatePurposeAttr("guide")
    with Engine(stage) as engine:
        engine.sync()
        assert engine.pulls["field"] == 1
        assert engine.drawn_paths() == ("/World/B",)
        change = pulled(engine, lambda: engine.set_purposes(("guide",)))
        assert change == Counter(visible=2, field=1)
        assert engine.drawn_paths() == ("/World/A",)
        assert pulled(engine, lambda: engine.set_purposes(("guide",))) == Counter()


def test_a_hundred_edits_between_two_pictures_are_read_once(stage):
    """Oracle: the count."""
    with Engine(stage) as engine:

        def edits():
            for x in range(100):
                attribute(stage, "/World/B.xformOp:translate").Set((x, 0, 0))

        assert pulled(engine, edits) == Counter(transforms=1)


def test_muting_the_layer_that_sets_the_rate_of_time_is_noticed(stage):
    """Oracle: a fresh engine; USD sends no notice of what that changes."""
    sublayer = Sdf.Layer.CreateAnonymous(".usda")
    sublayer.timeCodesPerSecond = 48
    stage.GetRootLayer().subLayerPaths.append(sublayer.identifier)
    with Usd.EditContext(stage, sublayer):
        for time, x in ((0, 0), (48, 48)):
            UsdGeom.Xformable(stage.GetPrimAtPath("/World/A")).MakeMatrixXform().Set(
                Gf.Matrix4d().SetTranslate((x, 0, 0)), time
            )
    stage.GetSessionLayer().timeCodesPerSecond = 60
    with Engine(stage, time=10) as engine:
        before = contents(engine)
        stage.MuteLayer(stage.GetSessionLayer().identifier)
        with Engine(stage, time=10) as fresh:
            assert contents(engine) == contents(fresh) != before


def test_other_stages_are_none_of_its_business(stage):
    """Oracle: the count; the other stage has the same paths and edits of its own."""
    other = two_fields()
    with Engine(stage) as engine:
        change = pulled(engine, lambda: attribute(other, "/World/A.opacities").Clear())
        assert change == Counter()


def test_prims_that_cannot_be_drawn_are_skipped_with_one_sentence_each(stage):
    """Oracle: the sentences and what is left."""
    api = Usd.ColorSpaceAPI(stage.GetPrimAtPath("/World/A"))
    packed = schema.author(stage, "/World/C", random_cloud(), form="packed")
    moved = UsdGeom.Xformable(schema.author(stage, "/World/D", random_cloud())).AddTranslateOp()
    with Engine(stage) as engine:
        assert len(engine.drawn_paths()) == 4 and engine.warnings == ()
        api.GetColorSpaceNameAttr().Set("mauve")
        packed.GetAttribute("splat:packing").Set("tight")
        moved.Set(Gf.Vec3d(float("inf"), 0, 0))
        assert engine.drawn_paths() == ("/World/B",)
        one, two, three = engine.warnings
        assert "/World/A" in one and "'mauve'" in one
        assert "/World/C" in two and "'tight'" in two
        assert "/World/D" in three and "not finite" in three
        api.GetColorSpaceNameAttr().Set("lin_rec709_scene")
        stage.RemovePrim("/World/C")
        UsdGeom.Imageable(stage.GetPrimAtPath("/World/D")).MakeInvisible()
        moved.Set(Gf.Vec3d(0, 0, 0))
        assert engine.warnings == ()
        assert engine.drawn_paths() == ("/World/A", "/World/B")


@pytest.mark.parametrize("kind", ["StringArray", "Float2Array", "Token", "Matrix4d"])
@pytest.mark.parametrize("name", ["positions", "scales", "radiance:sphericalHarmonicsDegree"])
def test_attributes_of_other_types_spoil_only_their_own_prim(stage, name, kind):
    """Oracle: the other prim is still drawn, and nothing is said about it."""
    spec = stage.GetRootLayer().GetPrimAtPath("/World/A")
    del spec.properties[name]
    values = {"StringArray": ["a"] * 40, "Float2Array": [(1, 2)] * 40, "Token": "a"}
    wrong = Sdf.AttributeSpec(spec, name, getattr(Sdf.ValueTypeNames, kind))
    wrong.default = values.get(kind, Gf.Matrix4d(1))
    with Engine(stage) as engine:
        assert "/World/B" in engine.drawn_paths()
        assert all("/World/A" in warning for warning in engine.warnings)


def test_a_field_without_splats_is_drawn_by_nobody_and_no_mistake(stage):
    """Oracle: usdVol: no positions, no particles."""
    attribute(stage, "/World/A.positions").Set(Vt.Vec3fArray())
    with Engine(stage) as engine:
        assert engine.drawn_paths() == ("/World/B",)
        assert engine.warnings == ()
