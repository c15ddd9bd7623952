"""Tests of UsdLux lights in the renderer's form."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

from tests.delegate.surface_stages import add_light, write_picture
from tests.delegate.tree_stages import tree_stage
from usdsplat import procedural_capture, schema
from usdsplat.delegate.engine import Engine
from usdsplat.render.lights.dome import peak_lights
from usdsplat.render.matte import is_matte


@pytest.fixture
def light() -> Iterator[UsdLux.DistantLight]:
    stage = Usd.Stage.CreateInMemory()
    yield add_light(stage)


def shining(light: UsdLux.DistantLight):
    with Engine(light.GetPrim().GetStage()) as engine:
        assert engine.warnings == ()
        return engine.render_scene.lights


def test_a_light_without_angle_gives_its_intensity_as_irradiance(light) -> None:
    """Oracle: E = colour · intensity · 2^exposure; a `LightSpec` holds E / π."""
    light.CreateIntensityAttr(3.0)
    light.CreateExposureAttr(2.0)
    light.CreateColorAttr(Gf.Vec3f(1, 0.5, 0.25))
    (found,) = shining(light)
    assert found.irradiance == pytest.approx([12 / math.pi * each for each in (1, 0.5, 0.25)])
    assert found.direction == (0.0, 0.0, -1.0)


@pytest.mark.parametrize(("angle", "normalize"), [(0.53, False), (60.0, False), (60.0, True)])
def test_a_disc_in_the_sky_gives_what_the_integral_over_it_says(light, angle, normalize) -> None:
    """Oracle: midpoint sums of L cos θ over the cone; `normalize` divides by the same factor."""
    light.CreateAngleAttr(angle)
    light.CreateNormalizeAttr(normalize)
    steps = 20_000
    theta = (np.arange(steps) + 0.5) * math.radians(angle / 2) / steps
    whole = (2 * math.pi * np.sin(theta) * np.cos(theta)).sum() * math.radians(angle / 2) / steps
    (found,) = shining(light)
    expected = (1.0 if normalize else whole) / math.pi
    assert found.irradiance[0] == pytest.approx(expected, rel=1e-6)


def test_colour_temperature_counts_when_it_is_enabled(light) -> None:
    """Oracle: UsdLux.BlackbodyTemperatureAsRgb."""
    light.CreateColorTemperatureAttr(3000.0)
    (plain,) = shining(light)
    assert len(set(plain.irradiance)) == 1
    light.CreateEnableColorTemperatureAttr(True)
    (warm,) = shining(light)
    expected = np.array(UsdLux.BlackbodyTemperatureAsRgb(3000.0)) / math.pi
    assert warm.irradiance == pytest.approx(expected)


def test_a_light_shines_along_the_minus_z_of_its_transform(light) -> None:
    """Oracle: by hand; scale does not matter."""
    UsdGeom.Xformable(light).AddRotateXOp().Set(-90.0)
    UsdGeom.Xformable(light).AddScaleOp().Set(Gf.Vec3f(3))
    (found,) = shining(light)
    assert found.direction == pytest.approx((0, -1, 0), abs=1e-7)


def test_a_hidden_light_is_dark_and_one_without_a_direction_a_warning(light) -> None:
    """Oracle: USD's visibility; the sentence."""
    UsdGeom.Imageable(light).CreateVisibilityAttr("invisible")
    assert shining(light) == ()
    UsdGeom.Imageable(light).CreateVisibilityAttr("inherited")
    UsdGeom.Xformable(light).AddScaleOp().Set(Gf.Vec3f(0))
    with Engine(light.GetPrim().GetStage()) as engine:
        (warning,) = engine.warnings
        assert warning.startswith("/Light: found a transform") and not engine.render_scene.lights


def test_time_and_edits_move_a_light(light) -> None:
    """Oracle: the samples."""
    light.GetIntensityAttr().Set(1.0, 1)
    light.GetIntensityAttr().Set(3.0, 3)
    with Engine(light.GetPrim().GetStage(), time=1) as engine:
        for time in (1, 2, 3):
            engine.set_time(time)
            (found,) = engine.render_scene.lights
            assert found.irradiance[0] == pytest.approx(time / math.pi)
        assert engine.pulls["light"] == 3
        light.GetPrim().SetActive(False)
        assert engine.render_scene.lights == ()


@pytest.mark.parametrize(
    ("name", "kind", "held"),
    [
        ("inputs:colorTemperature", Sdf.ValueTypeNames.Float, math.nan),
        ("inputs:angle", Sdf.ValueTypeNames.String, "wide"),
        ("inputs:color", Sdf.ValueTypeNames.String, "red"),
    ],
)
def test_a_light_of_what_is_no_number_is_dark_and_a_warning(name, kind, held) -> None:
    """A light of what is no number is dark and a warning; of a temperature that is none USD itself
    would crash. Oracle: the sentence."""
    stage = Usd.Stage.CreateInMemory()
    light = UsdLux.DistantLight.Define(stage, "/Light")
    light.CreateEnableColorTemperatureAttr(True)
    spec = stage.GetRootLayer().GetPrimAtPath(light.GetPath())
    Sdf.AttributeSpec(spec, name, kind).default = held
    with Engine(stage) as engine:
        (warning,) = engine.warnings
        assert warning.startswith(f"{light.GetPath()}.{name}: found {held!r}, expected ")
        assert engine.render_scene.lights == ()


def test_lights_with_an_area_have_the_radiance_that_usdlux_says() -> None:
    """Oracle: UsdLux's documentation: L = intensity · 2^exposure, over the area in the world with
    `normalize`."""
    stage = Usd.Stage.CreateInMemory()
    rect = UsdLux.RectLight.Define(stage, "/A")
    rect.CreateWidthAttr(2.0)
    rect.CreateHeightAttr(3.0)
    rect.CreateIntensityAttr(5.0)
    rect.CreateExposureAttr(1.0)
    UsdGeom.Xformable(rect).AddScaleOp().Set(Gf.Vec3f(2.0))
    plain, ball, tube, flat = (
        UsdLux.SphereLight.Define(stage, "/B"),
        UsdLux.SphereLight.Define(stage, "/C"),
        UsdLux.CylinderLight.Define(stage, "/D"),
        UsdLux.DiskLight.Define(stage, "/E"),
    )
    plain.CreateTreatAsPointAttr(True)
    ball.CreateRadiusAttr(0.0)
    for light in (ball, tube, flat):
        light.CreateNormalizeAttr(True)
        light.CreateIntensityAttr(1.0)
    found = list(shining(rect))
    assert [each.kind for each in found] == ["rect", "sphere", "sphere", "cylinder", "disk"]
    assert found[0].radiance == pytest.approx((10.0,) * 3) and found[0].size == (2.0, 3.0)
    assert found[1].is_point and found[1].size[0] == 0.5
    assert found[2].radiance == (1.0, 1.0, 1.0) and found[2].size[0] == 0.0
    assert found[3].radiance[0] == pytest.approx(1 / (2 * math.pi * 0.5 * 1.0))
    assert found[4].radiance[0] == pytest.approx(1 / (math.pi * 0.25))
    rect.CreateNormalizeAttr(True)
    assert shining(rect)[0].radiance[0] == pytest.approx(10.0 / 24.0)


def test_shaping_shadows_and_angle_are_read(light) -> None:
    """Oracle: the authored values."""
    stage = light.GetPrim().GetStage()
    light.CreateAngleAttr(2.0)
    shadow = UsdLux.ShadowAPI.Apply(light.GetPrim())
    shadow.CreateShadowColorAttr(Gf.Vec3f(0.1, 0.2, 0.3))
    shadow.CreateShadowDistanceAttr(4.0)
    shadow.CreateShadowFalloffAttr(1.0)
    lamp = UsdLux.SphereLight.Define(stage, "/Spot")
    shaping = UsdLux.ShapingAPI.Apply(lamp.GetPrim())
    shaping.CreateShapingConeAngleAttr(30.0)
    shaping.CreateShapingConeSoftnessAttr(0.25)
    shaping.CreateShapingFocusAttr(2.0)
    sun, spot = shining(light)
    assert sun.angle == pytest.approx(math.radians(2))
    assert sun.shadow.color == pytest.approx((0.1, 0.2, 0.3))
    assert (sun.shadow.distance, sun.shadow.falloff, sun.shadow.enable) == (4.0, 1.0, True)
    assert spot.shaping.angle == pytest.approx(math.radians(30))
    assert (spot.shaping.softness, spot.shaping.focus) == (0.25, 2.0)


def test_links_are_those_of_the_collections(light) -> None:
    """Oracle: USD's membership query."""
    stage = light.GetPrim().GetStage()
    for name in ("/Group", "/Group/One", "/Group/Two", "/Other"):
        UsdGeom.Xform.Define(stage, name)
    api = UsdLux.LightAPI(light.GetPrim())
    api.GetLightLinkCollectionAPI().CreateExcludesRel().SetTargets(["/Group/Two"])
    shadows = api.GetShadowLinkCollectionAPI()
    shadows.CreateIncludeRootAttr(False)
    shadows.CreateIncludesRel().SetTargets(["/Group"])
    (found,) = shining(light)
    paths = ("/Group", "/Group/One", "/Group/Two", "/Other", "/New")
    assert [is_matte(path, found.linked) for path in paths] == [True, True, False, True, True]
    assert [is_matte(path, found.casters) for path in paths] == [True, True, True, False, False]


def test_a_profile_and_a_texture_of_a_light_are_findings() -> None:
    """Oracle: the sentences."""
    stage = Usd.Stage.CreateInMemory()
    rect = UsdLux.RectLight.Define(stage, "/Rect")
    rect.CreateTextureFileAttr("sky.exr")
    UsdLux.ShapingAPI.Apply(rect.GetPrim()).CreateShapingIesFileAttr("lamp.ies")
    with Engine(stage) as engine:
        found = [each for each in engine.findings if each.code == "unsupported-input"]
    assert [each.path for each in found] == ["/Rect", "/Rect"]
    assert all(name in f"{found}" for name in ("lamp.ies", "sky.exr"))
    cures = {each.attribute: each.cure for each in found}
    assert "cone:angle" in cures["inputs:shaping:ies:file"]
    assert "mean colour" in cures["inputs:texture:file"]


@pytest.mark.parametrize(
    ("kind", "strength", "code"),
    [
        ("DistantLight", 65400.0 * math.pi, None),
        ("DistantLight", 65600.0 * math.pi, "extreme-light"),
        ("DistantLight", 1e30, "extreme-light"),
        ("DomeLight", 65400.0, None),
        ("DomeLight", 65600.0, "extreme-light"),
        ("DomeLight", 1e30, "extreme-light"),
        ("SphereLight", 1e9, None),
        ("SphereLight", 1e29, "extreme-light"),
        ("DistantLight", 1e33, "bad-light"),
        ("DomeLight", 1e31, "bad-light"),
        ("SphereLight", 1e31, "bad-light"),
        ("DistantLight", -1.0, "negative-light"),
        ("DomeLight", -1.0, "negative-light"),
        ("SphereLight", -1.0, "negative-light"),
        ("SphereLight", 0.0, None),
    ],
)
def test_light_that_half_pictures_cannot_hold_is_a_finding(kind, strength, code) -> None:
    """Oracle: 65504, the largest half, on a white surface that faces the light: intensity / π of a
    distant light without an angle, the radiance of a dome; and 0. A light of `bad-light` is left
    out."""
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/Light", kind)
    prim.GetAttribute("inputs:intensity").Set(strength)
    if kind == "DistantLight":
        prim.GetAttribute("inputs:angle").Set(0.0)
    with Engine(stage) as engine:
        assert [each.code for each in engine.findings] == ([code] if code else [])
        assert len(engine.render_scene.lights) == (code != "bad-light")
        prim.GetAttribute("inputs:color").Set(Gf.Vec3f(1, 0, 0))
        assert [each.code for each in engine.findings] == ([code] if code else [])
        prim.GetAttribute("inputs:color").Set(Gf.Vec3f(1))
        prim.GetAttribute("inputs:intensity").Set(1.0)
        engine.sync()
        assert engine.findings == ()


@pytest.mark.parametrize("pole", [(0, 0), (90, 0), (0, 90)])
@pytest.mark.parametrize("factor", [0.995, 1.005])
@pytest.mark.parametrize(
    ("lit", "most"),
    [
        (slice(0, 32), 1.0),  # the upper half
        (slice(32, 64), 1.0),
        # 45 degrees about the pole: sin² of them
        (slice(0, 16), math.sin(math.radians(45)) ** 2),
        # two rows at the horizon, to a wall: (2 / π) ∫ cos² of their elevation
        (slice(31, 33), (math.radians(5.625) + math.sin(math.radians(5.625))) / math.pi),
    ],
)
def test_the_light_of_part_of_a_sky_is_that_of_its_solid_angle(
    tmp_path, lit, most, factor, pole
) -> None:
    """Oracle: closed forms of the irradiance of a band of a latlong picture with 64 rows, divided
    by π, on a white surface that faces the pole or stands upright; 65504 is the limit."""
    sky = np.zeros((64, 128, 3), np.float32)
    sky[lit] = 1.0
    stage = Usd.Stage.CreateInMemory()
    dome = UsdLux.DomeLight.Define(stage, "/Dome")
    dome.CreateTextureFileAttr(write_picture(tmp_path / "sky.exr", sky))
    dome.CreateIntensityAttr(factor * 65504 / most)
    for each, angle in zip((dome.AddRotateXOp(), dome.AddRotateZOp()), pole, strict=True):
        each.Set(angle)
    with Engine(stage) as engine:
        assert bool(engine.findings) == (factor > 1)


@pytest.mark.parametrize(
    ("kind", "sizes", "part"),
    [
        ("SphereLight", {"radius": 1}, 1.0),  # the radiance times r²
        ("CylinderLight", {"radius": 1, "length": 3}, 6 / math.pi),  # 2 r l / π
        ("DiskLight", {"radius": 2}, 4.0),
        ("RectLight", {"width": 2, "height": 3}, 6 / math.pi),
    ],
)
def test_a_light_with_an_area_lights_by_its_projection(kind, sizes, part) -> None:
    """Oracle: L · projected area / π at a distance of 1, and 65504 at one of 1e6; the number in the
    sentence."""
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/Light", kind)
    for name, size in sizes.items():
        prim.GetAttribute(f"inputs:{name}").Set(size)
    most = 65504e12 / part
    with Engine(stage) as engine:
        prim.GetAttribute("inputs:intensity").Set(0.999 * most)
        engine.sync()
        assert engine.findings == ()
        prim.GetAttribute("inputs:intensity").Set(1.001 * most)
        engine.sync()
        assert [each.code for each in engine.findings] == ["extreme-light"]
        prim.GetAttribute("inputs:intensity").Set(1e20 / part)
        engine.sync()
        assert engine.findings[0].expected.endswith("not 1e+20")


@pytest.mark.parametrize(
    ("name", "code", "said"),
    [
        ("inputs:intensty", "unknown-name", "such as inputs:intensity"),
        ("inputs:radius", "unknown-name", "an input of RectLight"),
        ("inputs:shadow:colour", "unknown-name", "such as inputs:shadow:color"),
        ("inputs:shaping:cone:angle", "unused", "ShapingAPI applied"),
        ("inputs:ri:light:gain", None, ""),
        ("inputs:exposure", None, ""),
    ],
)
def test_an_input_that_a_light_does_not_have_is_a_finding(name, code, said) -> None:
    """Oracle: UsdLux's schemas; inputs of other renderers are none. A hidden light has none."""
    stage = Usd.Stage.CreateInMemory()
    rect = UsdLux.RectLight.Define(stage, "/Rect")
    rect.GetPrim().CreateAttribute(name, Sdf.ValueTypeNames.Float).Set(1.0)
    with Engine(stage) as engine:
        found = [each for each in engine.findings if each.code in ("unknown-name", "unused")]
        assert [each.code for each in found] == ([code] if code else [])
        assert all(said in f"{each}" and name in f"{each}" for each in found)
        rect.MakeInvisible()
        engine.sync()
        assert not any(name in f"{each}" for each in engine.findings)


def test_an_input_of_an_applied_schema_is_known() -> None:
    """Oracle: UsdLux's schemas."""
    stage = Usd.Stage.CreateInMemory()
    light = UsdLux.SphereLight.Define(stage, "/Light").GetPrim()
    UsdLux.ShapingAPI.Apply(light).CreateShapingConeAngleAttr(30.0)
    UsdLux.ShadowAPI.Apply(light).CreateShadowColorAttr((0, 0, 1))
    with Engine(stage) as engine:
        assert not any(each.code in ("unknown-name", "unused") for each in engine.findings)


def test_light_of_splats_on_a_prim_without_splats_is_a_finding() -> None:
    """Oracle: one for the model above; none for the field, or for settings of a picture."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Xform.Define(stage, "/Model")
    schema.author(stage, "/Model/Splats", procedural_capture(2000))
    stage.DefinePrim("/Render", "RenderSettings")
    for path in ("/Model", "/Model/Splats", "/Render"):
        prim = stage.GetPrimAtPath(path)
        prim.CreateAttribute("splat:lighting", Sdf.ValueTypeNames.Token).Set("shadowed")
    with Engine(stage) as engine:
        found = [each for each in engine.findings if each.code == "unused"]
    assert [each.path for each in found] == ["/Model"]


def test_a_catcher_and_the_mode_of_a_field_are_read() -> None:
    """Oracle: the applied schema and the token; an edit is seen."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Splats", procedural_capture(2000))
    UsdGeom.Cube.Define(stage, "/Cube")
    with Engine(stage) as engine:
        assert engine.render_scene.catchers() == set()
        for path in ("/Splats", "/Cube"):
            stage.GetPrimAtPath(path).AddAppliedSchema("SplatShadowCatcherAPI")
        prim = stage.GetPrimAtPath("/Splats")
        prim.CreateAttribute("splat:lighting", Sdf.ValueTypeNames.Token).Set("shadowed")
        engine.sync()
        assert engine.render_scene.catchers() == {"/Splats", "/Cube"}
        assert engine.render_scene.visible_fields()[0].spec.lighting == "shadowed"


def test_the_mode_of_a_tree_and_its_light_of_photographs_are_read(tmp_path) -> None:
    """Oracle: the token, the path of the hidden light, and the catcher; edits are seen."""
    stage, _ = tree_stage(tmp_path)
    UsdLux.DistantLight.Define(stage, "/Set").MakeInvisible()
    with Engine(stage) as engine:
        [(_, tree)] = engine.render_scene.drawn_trees()
        assert (tree.spec.lighting, tree.spec.captured_lights) == ("auto", ())
        prim = stage.GetPrimAtPath("/World/Tree")
        prim.CreateAttribute("splat:lighting", Sdf.ValueTypeNames.Token).Set("relit")
        prim.CreateRelationship("splat:lighting:captured").SetTargets(["/Set"])
        prim.AddAppliedSchema("SplatShadowCatcherAPI")
        engine.sync()
        [(_, tree)] = engine.render_scene.drawn_trees()
        assert (tree.spec.lighting, tree.spec.captured_lights) == ("relit", ("/Set",))
        assert engine.render_scene.catchers() == {"/World/Tree"}
        assert engine.render_scene.light("/Set") is not None


def sky_picture(folder, name="sky.exr", *, spot=(0.5, 0.5), edit=lambda pixels: None):
    """A dark latlong picture with a bright pixel."""
    import OpenImageIO as oiio

    pixels = np.full((32, 64, 3), 0.01, np.float32)
    pixels[int(spot[1] * 32), int(spot[0] * 64)] = 500.0
    edit(pixels)
    path = folder / name
    file = oiio.ImageOutput.create(str(path))
    file.open(str(path), oiio.ImageSpec(64, 32, 3, "float"))
    file.write_image(pixels)
    file.close()
    return str(path)


@pytest.mark.parametrize(
    ("kind", "up", "pole", "to_center", "to_top"),
    [
        ("DomeLight", "Z", None, (0, 0, 1), (0, 1, 0)),
        ("DomeLight_1", "Y", None, (0, 0, 1), (0, 1, 0)),
        ("DomeLight_1", "Z", None, (0, -1, 0), (0, 0, 1)),
        ("DomeLight_1", "Y", "Z", (0, -1, 0), (0, 0, 1)),
        ("DomeLight_1", "Z", "Y", (0, 0, 1), (0, 1, 0)),
    ],
)
def test_a_dome_stands_on_its_pole(tmp_path, kind, up, pole, to_center, to_top) -> None:
    """Oracle: UsdLux: the pole is +y, or that of poleAxis; a quarter turn about x takes y to z."""
    for spot, towards in (((0.5, 0.5), to_center), ((0.5, 0.0), to_top)):
        stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(stage, up)
        prim = stage.DefinePrim("/Sky", kind)
        prim.GetAttribute("inputs:texture:file").Set(sky_picture(tmp_path, spot=spot))
        if pole:
            prim.GetAttribute("poleAxis").Set(pole)
        (light,) = shining(UsdLux.LightAPI(prim))
        (peak,) = peak_lights(light)
        assert np.dot(peak.direction, towards) < -math.cos(math.radians(6))


def test_intensity_exposure_and_colour_of_a_dome_are_its_radiance(tmp_path) -> None:
    """Oracle: colour · intensity · 2^exposure; normalize has no effect on a light without a
    size."""
    stage = Usd.Stage.CreateInMemory()
    sky = UsdLux.DomeLight.Define(stage, "/Sky")
    for name, value in (("intensity", 3.0), ("exposure", 1.0), ("normalize", True)):
        sky.GetPrim().GetAttribute(f"inputs:{name}").Set(value)
    sky.CreateColorAttr(Gf.Vec3f(1, 0.5, 0.25))
    sky.CreateTextureFormatAttr("latlong")
    sky.CreateTextureFileAttr(sky_picture(tmp_path))
    (found,) = shining(sky)
    assert found.kind == "dome" and found.radiance == pytest.approx((6.0, 3.0, 1.5))
    with Engine(stage) as engine:
        before = engine.render_scene.lights[0]
        UsdGeom.Xformable(sky).AddRotateYOp().Set(90.0)
        engine.sync()
        (after,) = engine.render_scene.lights
        assert after.sky is before.sky and after.to_world != before.to_world


@pytest.mark.parametrize(
    ("attribute", "value", "code", "sentence"),
    [
        ("texture:file", "none.exr", "bad-light", "none.exr"),
        ("texture:format", "mirroredBall", "bad-light", "automatic or latlong"),
        ("intensity", 1e31, "bad-light", "at most 1e+30"),
        ("intensity", math.inf, "bad-light", "a finite number"),
        ("texture:file", "broken", "bad-texels", "2 pixels of 2048"),
    ],
)
def test_mistakes_of_a_dome_are_findings(tmp_path, attribute, value, code, sentence) -> None:
    """Oracle: the sentences; broken pixels are black, and other mistakes leave the dome out."""

    def damage(pixels):
        pixels[3, 4], pixels[5, 6] = math.nan, -1.0

    stage = Usd.Stage.CreateInMemory()
    sky = UsdLux.DomeLight.Define(stage, "/Sky")
    sky.CreateTextureFileAttr(sky_picture(tmp_path))
    if value == "broken":
        value = sky_picture(tmp_path, "broken.exr", edit=damage)
    sky.GetPrim().GetAttribute(f"inputs:{attribute}").Set(value)
    with Engine(stage) as engine:
        (found,) = engine.findings
        assert (found.code, found.path) == (code, "/Sky") and sentence in found.message
        assert len(engine.render_scene.lights) == (code == "bad-texels")
        sky.GetPrim().SetActive(False)
        engine.sync()
        assert engine.findings == ()


def test_a_hidden_light_is_read_if_a_field_names_it_as_that_of_its_photographs() -> None:
    """Oracle: the relationship; edits of it and of the light are seen, and it lights nothing."""
    stage = Usd.Stage.CreateInMemory()
    prim = schema.author(stage, "/Splats", procedural_capture(2000))
    sky = UsdLux.DomeLight.Define(stage, "/Set")
    sky.MakeInvisible()
    with Engine(stage) as engine:
        scene = engine.render_scene
        assert scene.light("/Set") is None
        names = prim.CreateRelationship("splat:lighting:captured", custom=False)
        names.SetTargets(["/Set"])
        engine.sync()
        assert scene.visible_fields()[0].spec.captured_lights == ("/Set",)
        assert scene.light("/Set") is not None and scene.lights == ()
        sky.CreateIntensityAttr(3.0)
        engine.sync()
        assert scene.light("/Set").radiance == (3.0, 3.0, 3.0)
        sky.MakeVisible()
        engine.sync()
        assert len(scene.lights) == 1
        sky.MakeInvisible()
        names.ClearTargets(True)
        engine.sync()
        assert scene.light("/Set") is None
        assert scene.visible_fields()[0].spec.captured_lights == ()


def test_edits_of_a_forwarded_relationship_change_the_light_of_photographs() -> None:
    """Oracle: the targets of the relationship that is named, before and after an edit of it."""
    stage = Usd.Stage.CreateInMemory()
    prim = schema.author(stage, "/Splats", procedural_capture(2000))
    for path in ("/Day", "/Night"):
        UsdLux.DomeLight.Define(stage, path).MakeInvisible()
    other = stage.DefinePrim("/Other").CreateRelationship("lights")
    other.SetTargets(["/Day"])
    names = prim.CreateRelationship("splat:lighting:captured", custom=False)
    names.SetTargets(["/Other.lights"])
    with Engine(stage) as engine:
        scene = engine.render_scene
        assert scene.visible_fields()[0].spec.captured_lights == ("/Day",)
        other.SetTargets(["/Night"])
        engine.sync()
        assert scene.visible_fields()[0].spec.captured_lights == ("/Night",)
        assert scene.light("/Day") is None and scene.light("/Night") is not None


@pytest.mark.parametrize("kind", ["DistantLight", "SphereLight", "DomeLight"])
def test_a_negative_light_takes_no_light_away(kind) -> None:
    """Oracle: the picture of a mesh in which that light is black, bit for bit."""
    stage = Usd.Stage.CreateInMemory()
    add_light(stage)
    UsdGeom.Cube.Define(stage, "/Cube")
    other = stage.DefinePrim("/Other", kind)
    UsdGeom.Xformable(other).AddTranslateOp().Set(Gf.Vec3d(0, 0, 4))
    other.GetAttribute("inputs:intensity").Set(-0.5)
    if kind == "DistantLight":
        other.GetAttribute("inputs:angle").Set(0.0)
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    UsdGeom.Xformable(camera).AddTranslateOp().Set(Gf.Vec3d(0, 0, 8))
    with Engine(stage, device="cpu") as engine:
        view = engine.view("/Camera", resolution=(8, 8))
        found = engine.picture(view)["color"]
        other.GetAttribute("inputs:intensity").Set(0.0)
        alone = engine.picture(view)["color"]
    assert alone[4, 4, 0] > 0
    np.testing.assert_array_equal(found, alone)
