"""Tests of `usdsplat relight`, from the command line to pictures of its layer."""

from __future__ import annotations

import gc
import json
import re
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

from tests.cli.test_main import shell
from tests.delegate.scene_delegate.test_lights import sky_picture
from tests.kernels.points.splat_shapes import sphere
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.engine import Engine
from usdsplat.images.color import decode
from usdsplat.interchange.placement import set_op
from usdsplat.render.frame_buffers import FrameBuffers
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import Framing

pytestmark = pytest.mark.usefixtures("compiled")

FIELD = "/World/Ball"
FAST = ("-q", "--dome-samples", "4", "--light-samples", "1")


@pytest.fixture
def shot(tmp_path):
    """Return a function that makes a stage with a sphere of splats, a sun and a camera."""

    def make(form="float", *, times=(None,), degree=1, at=FIELD):
        path = tmp_path / "in" / "shot.usda"
        path.parent.mkdir(exist_ok=True)
        stage = Usd.Stage.CreateNew(str(path))
        stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        UsdGeom.SetStageUpAxis(stage, "Y")
        shape = sphere(500)
        rng = np.random.default_rng(4)
        sh = rng.uniform(-0.1, 0.1, (500, (degree + 1) ** 2, 3)).astype(np.float32)
        names = ("positions", "rotations", "scales", "opacities")
        cloud = SplatCloud(**dict(zip(names, shape.splats, strict=True)), sh=sh)
        for time in times:
            schema.author(stage, at, cloud, form=form, time=time)
            schema.author_surface(
                stage.GetPrimAtPath(at), normals=shape.normals, confidence=np.ones(500),
                occlusion=np.zeros(500), time=time,
            )  # fmt: skip
        sun = UsdLux.DistantLight.Define(stage, "/World/Sun")
        sun.CreateAngleAttr(0.0)
        sun.CreateIntensityAttr(4.0)
        sun.CreateColorAttr(Gf.Vec3f(1.0, 0.7, 0.4))
        UsdGeom.Xformable(sun).AddRotateYOp().Set(40.0)
        camera = UsdGeom.Camera.Define(stage, "/World/Cam")
        UsdGeom.Xformable(camera).AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
        camera.GetClippingRangeAttr().Set(Gf.Vec2f(0.1, 100))
        stage.Save()
        return path

    return make


def picture_of(path, lighting="captured"):
    """Straight colours where the picture of a stage is opaque, and their mask."""
    settings = RenderSettings(lighting=lighting, dome_samples=4, light_samples=1)
    with Engine(Usd.Stage.Open(str(path))) as engine:
        view = engine.view("/World/Cam", framing=Framing(resolution=(40, 30)))
        found = engine.picture(view, settings, ("color",))["color"].copy()
    return found


def named_hdri(path, picture):
    """Name a hidden dome as the light of the photographs."""
    stage = Usd.Stage.Open(str(path))
    dome = UsdLux.DomeLight_1.Define(stage, "/World/Set")
    dome.CreateTextureFileAttr(picture)
    dome.MakeInvisible()
    prim = stage.GetPrimAtPath(FIELD)
    prim.CreateRelationship("splat:lighting:captured", custom=False).SetTargets(["/World/Set"])
    stage.Save()


@pytest.mark.parametrize("form", ["float", "half", "packed"])
def test_the_layer_shows_what_render_shows_relit(run_json, shot, tmp_path, form):
    """Oracle: the relit picture of the stage; a picture of the layer needs no light. The file of
    the stage stays, and so does all but the colours."""
    path, target = shot(form), tmp_path / "relit.usda"
    named_hdri(path, sky_picture(tmp_path))
    before = path.read_bytes()
    report = run_json("relight", path, "-o", target, *FAST)
    assert path.read_bytes() == before
    (field,) = report["fields"]
    assert (field["path"], field["splats"], field["residual"]) == (FIELD, 500, None)
    assert field["error"] < 0.01
    expected, plain, found = (
        picture_of(path, "relit"), picture_of(path), picture_of(target)
    )  # fmt: skip
    assert np.abs(expected - plain).max() > 0.1
    # directions in which colours are not fitted exactly, and what the form rounds
    assert np.abs(found - expected).max() < 0.03
    layer = Sdf.Layer.FindOrOpen(str(target))
    names = {each.name for each in layer.GetPrimAtPath(FIELD).properties}
    assert "positions" not in names and "scales" not in names
    stage = Usd.Stage.Open(str(target))
    stage.MuteLayer(layer.identifier) if layer != stage.GetRootLayer() else None
    layer.GetPrimAtPath(FIELD).nameParent.nameChildren.clear()
    with Engine(stage) as engine:
        view = engine.view("/World/Cam", framing=Framing(resolution=(40, 30)))
        again = engine.picture(view, RenderSettings(), ("color",))["color"]
        np.testing.assert_array_equal(again, plain)


def test_the_set_s_hdri_on_the_command_line_is_that_of_a_named_dome(run_json, shot, tmp_path):
    """Oracle: the colours with a dome that the field names; the stage keeps no trace."""
    path, picture = shot(), sky_picture(tmp_path)
    run_json("relight", path, "-o", tmp_path / "a.usda", "--captured-hdri", picture, *FAST)
    text = (tmp_path / "a.usda").read_text()
    assert "SplatCapturedLight" not in text and "lighting:captured" not in text
    named_hdri(path, picture)
    run_json("relight", path, "-o", tmp_path / "b.usda", *FAST)
    a, b = (colors(tmp_path / f"{name}.usda") for name in "ab")
    np.testing.assert_array_equal(a, b)


def test_a_prim_without_a_field_is_refused(run, shot, tmp_path):
    """Oracle: one sentence with the path and the fields, also beside a right path; nothing is
    written."""
    for paths in (["/World/Bal"], [FIELD, "/World/Bal"]):
        words = [word for path in paths for word in ("--prim", path)]
        status, _, err = run("relight", shot(), "-o", tmp_path / "a.usda", *words, *FAST)
        assert status == 2 and f"--prim: found /World/Bal, expected a field: {FIELD}" in err
        assert not (tmp_path / "a.usda").exists()


def test_a_prim_without_a_field_names_a_few_of_many(run, shot, tmp_path):
    """Oracle: the first three of 300 fields by hand, and the count of the others."""
    path = shot()
    stage = Usd.Stage.Open(str(path))
    for i in range(299):
        stage.DefinePrim(f"/World/Other{i}", "ParticleField3DGaussianSplat")
    stage.GetRootLayer().Save()
    words = ("-o", tmp_path / "a.usda", "--prim", "/World/Bal")
    status, _, err = run("relight", path, *words, *FAST)
    expected = f"expected a field: {FIELD}, /World/Other0, /World/Other1 and 297 more\n"
    assert status == 2 and err.endswith(expected)


@pytest.mark.parametrize("target", ["/World/Gone", "/World/Cam", "/World/Set"])
def test_the_hdri_is_used_where_no_named_prim_is_a_light(run_json, shot, tmp_path, target):
    """Oracle: the colours of a field that names nothing; a dome that is named counts."""
    path, picture = shot(), sky_picture(tmp_path)
    words = ("--captured-hdri", picture, *FAST)
    run_json("relight", path, "-o", tmp_path / "a.usda", *words)
    named_hdri(path, sky_picture(tmp_path, "other.exr", spot=(0.2, 0.3)))
    stage = Usd.Stage.Open(str(path))
    stage.GetPrimAtPath(FIELD).GetRelationship("splat:lighting:captured").SetTargets([target])
    stage.Save()
    report = run_json("relight", path, "-o", tmp_path / "b.usda", *words)
    assert report["fields"][0]["residual"] is None
    a, b = (colors(tmp_path / f"{name}.usda") for name in "ab")
    assert np.array_equal(a, b) == (target != "/World/Set")


def test_a_picture_that_no_field_needs_must_be_one(run, shot, tmp_path):
    """Oracle: the sentence; the only field names its dome."""
    path, target = shot(), tmp_path / "relit.usda"
    named_hdri(path, sky_picture(tmp_path))
    status, _, err = run("relight", path, "-o", target, "--captured-hdri", tmp_path / "none.exr")
    assert status == 2 and "--captured-hdri: found " in err and not target.exists()


def test_the_axes_of_a_capture_do_not_turn_the_hdri(run_json, shot, tmp_path):
    """Oracle: the colours with a dome that stands upright in the world, where the field has axes
    with y down, as most captures have."""
    path, picture = shot(), sky_picture(tmp_path)
    stage = Usd.Stage.Open(str(path))
    set_op(stage.GetPrimAtPath(FIELD), np.diag([1.0, -1.0, -1.0, 1.0]))
    stage.Save()
    run_json("relight", path, "-o", tmp_path / "a.usda", "--captured-hdri", picture, *FAST)
    named_hdri(path, picture)
    run_json("relight", path, "-o", tmp_path / "b.usda", *FAST)
    a, b = (colors(tmp_path / f"{name}.usda") for name in "ab")
    np.testing.assert_allclose(a, b, atol=1e-6)


def test_the_hdri_turns_with_the_capture(run_json, shot, tmp_path):
    """Oracle: the colours before the capture, and the sun with it, were turned; those with a dome
    that did not turn are others."""
    path, picture = shot(), sky_picture(tmp_path)
    words = ("--captured-hdri", picture, *FAST)
    run_json("relight", path, "-o", tmp_path / "a.usda", *words)
    stage = Usd.Stage.Open(str(path))
    UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddRotateYOp().Set(70.0)
    stage.Save()
    run_json("relight", path, "-o", tmp_path / "b.usda", *words)
    a, b = (colors(tmp_path / f"{name}.usda") for name in "ab")
    np.testing.assert_allclose(b, a, atol=2e-3)
    dome = UsdLux.DomeLight_1.Define(stage, "/Still")
    dome.CreateTextureFileAttr(picture)
    dome.MakeInvisible()
    prim = stage.GetPrimAtPath(FIELD)
    prim.CreateRelationship("splat:lighting:captured", custom=False).SetTargets(["/Still"])
    stage.Save()
    run_json("relight", path, "-o", tmp_path / "c.usda", *FAST)
    assert np.abs(colors(tmp_path / "c.usda") - a).max() > 0.1


def test_the_example_of_the_page_is_relit_once(run_json, shot, tmp_path):
    """Oracle: its picture, relit; the layer looks the same in all modes."""
    path, target = shot(at="/Statue/splats"), tmp_path / "in" / "relit.usda"
    page = Path(__file__).parents[2] / "docs" / "lighting.md"
    (example,) = (
        each for each in re.findall("```usda\n(.*?)```", page.read_text(), re.DOTALL)
        if "splat:lighting:captured" in each
    )  # fmt: skip
    sky_picture(path.parent, "set.exr")
    named = path.parent / "named.usda"
    named.write_text(f"#usda 1.0\n(subLayers = [@shot.usda@])\n{example}")
    run_json("relight", named, "-o", target, *FAST)
    expected = picture_of(named)
    assert np.abs(expected - picture_of(path)).max() > 0.1
    for mode in ("captured", "shadowed", "relit"):
        assert np.abs(picture_of(target, mode) - expected).max() < 0.03, mode


def colors(path, time=None):
    stage = Usd.Stage.Open(str(path))
    return schema.fetch(stage.GetPrimAtPath(FIELD), time).sh


def test_the_same_light_in_and_out_changes_no_bit(run_json, shot, tmp_path):
    """Oracle: the harmonics of the capture."""
    path = shot()
    stage = Usd.Stage.Open(str(path))
    names = stage.GetPrimAtPath(FIELD).CreateRelationship("splat:lighting:captured", custom=False)
    names.SetTargets(["/World/Sun"])
    stage.Save()
    report = run_json("relight", path, "-o", tmp_path / "same.usda", "-q")
    np.testing.assert_array_equal(colors(tmp_path / "same.usda"), colors(path))
    assert report["fields"][0]["error"] == 0.0


def test_without_a_named_light_it_is_estimated_and_the_residual_reported(run, shot, tmp_path):
    """Oracle: the sentence, and brighter splats towards the sun than away from it."""
    path, target = shot(degree=0), tmp_path / "relit.usda"
    status, out, _ = run("relight", path, "-o", target)
    assert status == 0 and "estimated light, which leaves" in out
    normals = sphere(500).normals
    ratio = decode(0.2820948 * colors(target)[:, 0] + 0.5, "srgb_rec709_scene") / decode(
        0.2820948 * colors(path)[:, 0] + 0.5, "srgb_rec709_scene"
    )
    towards = normals @ [np.sin(np.radians(40)), 0, np.cos(np.radians(40))]
    lit, dark = ratio[towards > 0.7], ratio[towards < -0.2]
    assert lit.mean() > 3 * dark.mean()
    assert lit[:, 0].mean() > 1.5 * lit[:, 2].mean()


def test_fields_with_samples_get_the_same_samples(run_json, shot, tmp_path):
    """Oracle: the times."""
    path, target = shot(times=(1.0, 3.0)), tmp_path / "relit.usda"
    stage = Usd.Stage.Open(str(path))
    UsdLux.LightAPI(stage.GetPrimAtPath("/World/Sun")).GetIntensityAttr().Set(1.0, 1.0)
    UsdLux.LightAPI(stage.GetPrimAtPath("/World/Sun")).GetIntensityAttr().Set(8.0, 3.0)
    stage.Save()
    report = run_json("relight", path, "-o", target, "-q")
    assert report["fields"][0]["samples"] == 2
    layer = Sdf.Layer.FindOrOpen(str(target))
    (attribute,) = (
        each for each in layer.GetPrimAtPath(FIELD).properties if each.name.endswith("Coefficients")
    )
    assert layer.ListTimeSamplesForPath(attribute.path) == [1.0, 3.0]
    assert colors(target, 3.0)[:, 0].mean() > colors(target, 1.0)[:, 0].mean() + 0.2


def test_buffers_of_a_sample_do_not_wait_for_garbage_to_be_collected(run_json, shot, tmp_path):
    """Oracle: no object of the renderer is left, although nothing is collected: buffers of light
    take hundreds of megabytes."""
    path = shot(times=(1.0, 3.0))
    gc.collect()
    before = sum(isinstance(each, FrameBuffers) for each in gc.get_objects())
    gc.disable()
    try:
        run_json("relight", path, "-o", tmp_path / "relit.usda", *FAST)
        after = sum(isinstance(each, FrameBuffers) for each in gc.get_objects())
    finally:
        gc.enable()
    assert after == before


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("-o", "relit.usdz"), "a .usda, .usdc or .usd layer"),
        (("-o", "relit.usda", "--prim", "/World/Cam"), "expected a field: /World/Ball"),
        (("-o", "relit.usda", "--captured-hdri", "none.exr"), "--captured-hdri: found "),
        (("-o", "relit.usda", "--captured-hdri", "in/shot.usda"), "--captured-hdri: found "),
    ],
)
def test_mistakes_are_one_sentence_and_write_nothing(shot, tmp_path, words, sentence):
    """Oracle: the sentence."""
    path = shot()
    found = shell("relight", path, *words, cwd=tmp_path)
    assert found.returncode == 2 and sentence in found.stderr
    assert "Traceback" not in found.stderr
    assert not list(tmp_path.glob("relit.*"))


def test_a_stage_without_lights_has_nothing_to_relight_by(run, shot, tmp_path):
    """Oracle: the sentence; JSON has findings in the form of other commands."""
    path = shot()
    stage = Usd.Stage.Open(str(path))
    stage.GetPrimAtPath("/World/Sun").SetActive(False)
    stage.Save()
    status, _, err = run("relight", path, "-o", tmp_path / "relit.usda")
    assert status == 2 and "expected a light to relight by" in err


def test_hidden_fields_are_findings(run, shot, tmp_path):
    """Oracle: the code and the path."""
    path = shot()
    stage = Usd.Stage.Open(str(path))
    other = "/World/Hidden"
    schema.author(stage, other, schema.fetch(stage.GetPrimAtPath(FIELD)))
    UsdGeom.Imageable(stage.GetPrimAtPath(other)).MakeInvisible()
    stage.Save()
    status, out, err = run("relight", path, "-o", tmp_path / "relit.usda", "--json")
    assert "[not-relit] /World/Hidden" in err, err
    assert status == 0
    codes = [each["code"] for each in json.loads(out)["findings"]]
    assert sorted(codes) == ["estimated-light", "not-relit"]


def test_samples_at_which_a_field_is_hidden_keep_their_colours(run_json, shot, tmp_path):
    """Oracle: the colours of the capture at 1, where it is hidden; other ones at 3, and no sample
    of the capture between those of the layer."""
    path, target = shot(times=(1.0, 3.0)), tmp_path / "relit.usda"
    stage = Usd.Stage.Open(str(path))
    visibility = UsdGeom.Imageable(stage.GetPrimAtPath(FIELD)).CreateVisibilityAttr()
    visibility.Set("invisible", 1.0)
    visibility.Set("inherited", 2.0)
    stage.Save()
    report = run_json("relight", path, "-o", target, *FAST)
    assert (report["fields"][0]["samples"], report["fields"][0]["splats"]) == (1, 500)
    np.testing.assert_array_equal(colors(target, 1.0), colors(path, 1.0))
    assert np.abs(colors(target, 3.0) - colors(path, 3.0)).max() > 0.1


@pytest.mark.parametrize("form", ["float", "packed"])
def test_a_field_that_grows_from_nothing_is_relit(run_json, shot, tmp_path, form):
    """Oracle: the number of samples, and colours as many as centres at both."""
    path, target = shot(form, times=(3.0,)), tmp_path / "relit.usda"
    stage = Usd.Stage.Open(str(path))
    whole = schema.fetch(stage.GetPrimAtPath(FIELD), 3.0)
    names = ("positions", "rotations", "scales", "opacities", "sh")
    nothing = SplatCloud(**{name: getattr(whole, name)[:0] for name in names})
    schema.author(stage, FIELD, nothing, form=form, time=1.0)
    stage.Save()
    run_json("relight", path, "-o", target, *FAST)
    assert [colors(target, time).shape for time in (1.0, 3.0)] == [(0, 4, 3), (500, 4, 3)]


def test_lights_and_findings_of_later_samples_count(run, shot, tmp_path):
    """Oracle: the finding on a light whose numbers are wrong at the second sample alone, at its
    time; the sun is hidden at the first."""
    path, target = shot(times=(1.0, 3.0)), tmp_path / "relit.usda"
    stage = Usd.Stage.Open(str(path))
    visibility = UsdGeom.Imageable(stage.GetPrimAtPath("/World/Sun")).CreateVisibilityAttr()
    visibility.Set("invisible", 1.0)
    visibility.Set("inherited", 3.0)
    lamp = UsdLux.DistantLight.Define(stage, "/World/Lamp")
    lamp.CreateIntensityAttr().Set(0.0, 1.0)
    lamp.MakeInvisible()
    lamp.GetVisibilityAttr().Clear()
    lamp.GetVisibilityAttr().Set("invisible", 1.0)
    lamp.GetVisibilityAttr().Set("inherited", 3.0)
    lamp.GetIntensityAttr().Set(float("inf"), 3.0)
    stage.Save()
    status, out, err = run("relight", path, "-o", target, "--json", *FAST[1:])
    assert status == 0, err
    (found,) = (each for each in json.loads(out)["findings"] if each["code"] == "bad-light")
    assert found["path"] == "/World/Lamp" and found["time"] == 3.0
    assert json.loads(out)["fields"][0]["samples"] == 1
    target.unlink()
    assert run("relight", path, "-o", target, "--strict", *FAST[1:])[0] != 0
    assert not target.exists()


@pytest.mark.parametrize("mode", ["captured", "hidden"])
def test_nothing_is_written_if_no_field_is_relit(run, shot, tmp_path, mode):
    """Oracle: the finding on the field, and the sentence."""
    path, target = shot(), tmp_path / "relit.usda"
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetPrimAtPath(FIELD)
    if mode == "hidden":
        UsdGeom.Imageable(prim).MakeInvisible()
    else:
        prim.CreateAttribute("splat:lighting", Sdf.ValueTypeNames.Token, custom=False).Set(mode)
    stage.Save()
    status, _, err = run("relight", path, "-o", target, *FAST[1:])
    assert status == 2 and not target.exists()
    assert f"[not-relit] {FIELD}" in err and "expected a visible splat field" in err


def test_an_estimate_is_a_note(run, shot, tmp_path):
    """Oracle: the code that render has."""
    _, _, err = run("relight", shot(), "-o", tmp_path / "relit.usda")
    assert f"note [estimated-light] {FIELD}" in err


def test_a_tree_is_one_finding_that_says_where_it_is_relit(run, shot, tmp_path):
    """Oracle: the sentence on the tree, and none on the fields that stand for it elsewhere."""
    path, tree, target = shot(), tmp_path / "t.usda", tmp_path / "relit.usda"
    assert run("lod", path, "-o", tree, "-q")[0] == 0
    stage = Usd.Stage.Open(str(path))
    stage.GetPrimAtPath(FIELD).SetActive(False)
    stage.DefinePrim("/World/T").GetReferences().AddReference(str(tree))
    stage.Save()
    status, _, err = run("relight", path, "-o", target, *FAST[1:])
    assert status == 2 and not target.exists()
    first, last = err.splitlines()
    assert first == (
        "usdsplat: warning [not-relit] /World/T/splats: found a splat tree, expected a splat "
        "field; render --lighting relit relights trees in the picture"
    )
    assert last == "usdsplat: fields: found none that can be relit, expected a visible splat field"
