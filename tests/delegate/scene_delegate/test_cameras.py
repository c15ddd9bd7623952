from __future__ import annotations

import math

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from tests.delegate.stages import add_camera
from usdsplat.core.errors import StageError
from usdsplat.delegate.engine import Engine


@pytest.fixture
def stage():
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Xform.Define(stage, "/Rig").AddRotateXYZOp().Set(Gf.Vec3f(10, 20, 30))
    add_camera(stage, "/Rig/Camera", eye=(1.0, 2.0, 3.0))
    return stage


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_camera_is_what_gf_says_it_is(stage, projection):
    """Oracle: Gf.Camera's frustum: its window at distance 1 and its view matrix."""
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Rig/Camera"))
    camera.CreateProjectionAttr(projection)
    camera.CreateHorizontalApertureOffsetAttr(5.0)
    camera.CreateVerticalApertureOffsetAttr(2.0)
    frustum = camera.GetCamera(Usd.TimeCode.Default()).frustum
    window = frustum.GetWindow()
    with Engine(stage) as engine:
        spec = engine.view("/Rig/Camera").camera
    assert spec.window == pytest.approx((*window.GetMin(), *window.GetMax()))
    assert spec.orthographic == (projection == "orthographic")
    assert spec.clipping_range == pytest.approx((frustum.nearFar.min, frustum.nearFar.max))
    view = np.array(frustum.ComputeViewMatrix()).T
    np.testing.assert_allclose(np.reshape(spec.world_to_camera, (4, 4)), view, atol=1e-12)


def test_a_blocked_lens_is_the_fallback_lens(stage):
    """Oracle: UsdGeomCamera's documented fallback of 50 tenths."""
    stage.GetPrimAtPath("/Rig/Camera").GetAttribute("focalLength").Set(Sdf.ValueBlock())
    with Engine(stage) as engine:
        left, _, right, _ = engine.view("/Rig/Camera").camera.window
    assert right - left == pytest.approx(20.0 / 50.0)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("focalLength", 0.0, "focal length 0"),
        ("focalLength", math.nan, "focal length nan"),
        ("horizontalAperture", -1.0, "aperture -1 x 15"),
        ("verticalApertureOffset", math.inf, "focal length 20"),
        ("clippingRange", Gf.Vec2f(10, 10), "clippingRange"),
        ("clippingRange", Gf.Vec2f(math.nan, 10), "clippingRange"),
        ("xformOp:translate", Gf.Vec3d(math.nan, 0, 0), "without an inverse"),
        ("exposure:fStop", 0.0, "exposure with a scale of inf"),
        ("exposure:time", -1.0, "exposure with a scale of -1"),
    ],
)
def test_a_camera_without_an_image_is_a_warning_until_it_is_asked_for(stage, name, value, words):
    """Oracle: the sentence names the prim and what is wrong with it."""
    attribute = stage.GetPrimAtPath("/Rig/Camera").GetAttribute(name)
    sound = attribute.Get()
    attribute.Set(value)
    with Engine(stage) as engine:
        assert [warning for warning in engine.warnings if words in warning]
        with pytest.raises(StageError, match=f"/Rig/Camera: .*{words}"):
            engine.view("/Rig/Camera")
        attribute.Set(sound)
        assert engine.view("/Rig/Camera").camera.path == "/Rig/Camera"
        assert engine.warnings == ()


def test_a_flat_camera_has_no_inverse(stage):
    """Oracle: a matrix with a zero row."""
    UsdGeom.Xformable(stage.GetPrimAtPath("/Rig")).AddScaleOp().Set(Gf.Vec3f(1, 0, 1))
    with Engine(stage) as engine, pytest.raises(StageError, match="without an inverse"):
        engine.view("/Rig/Camera")


def test_a_path_that_is_no_camera_is_answered_with_those_there_are(stage):
    """Oracle: the sentence."""
    with Engine(stage) as engine, pytest.raises(StageError, match="one of /Rig/Camera"):
        engine.view("/Rig")
    with (
        Engine(Usd.Stage.CreateInMemory()) as engine,
        pytest.raises(StageError, match="no cameras"),
    ):
        engine.view("/Camera")


def test_animated_lens_and_rig_follow_time(stage):
    """Oracle: linear interpolation by hand."""
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Rig/Camera"))
    for time, focal, x in ((1, 20.0, 0.0), (3, 40.0, 8.0)):
        camera.GetFocalLengthAttr().Set(focal, time)
        camera.GetPrim().GetAttribute("xformOp:translate").Set(Gf.Vec3d(x, 0, 0), time)
    stage.GetPrimAtPath("/Rig").GetAttribute("xformOp:rotateXYZ").Set(Gf.Vec3f(0))
    with Engine(stage, time=1) as engine:
        engine.sync()
        engine.set_time(2)
        spec = engine.view("/Rig/Camera").camera
    assert spec.window[2] == pytest.approx(10.0 / 30.0)
    np.testing.assert_allclose(np.reshape(spec.world_to_camera, (4, 4))[:3, 3], [-4, 0, 0])


@pytest.mark.parametrize("scale", [(2.0, 2.0, 2.0), (0.01, 0.01, 0.01), (1.0, 3.0, 0.5)])
def test_a_scaled_camera_measures_in_scene_units(stage, scale):
    """Oracle: Gf.Camera's frustum, and the distance from the eye to a point in front of it."""
    UsdGeom.Xformable(stage.GetPrimAtPath("/Rig")).AddScaleOp().Set(Gf.Vec3f(scale))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Rig/Camera"))
    frustum = camera.GetCamera(Usd.TimeCode.Default()).frustum
    with Engine(stage) as engine:
        view = np.reshape(engine.view("/Rig/Camera").camera.world_to_camera, (4, 4))
    np.testing.assert_allclose(view, np.array(frustum.ComputeViewMatrix()).T, atol=1e-12)
    point = np.array(frustum.position + 7.0 * frustum.ComputeViewDirection())
    np.testing.assert_allclose((view @ [*point, 1.0])[:3], [0, 0, -7], atol=1e-9)


def test_exposure_is_what_usd_makes_of_its_attributes(stage):
    """Oracle: the formula of UsdGeomCamera's documentation; UsdGeom computes its 1 by default."""
    prim = stage.GetPrimAtPath("/Rig/Camera")
    with Engine(stage) as engine:
        assert engine.view("/Rig/Camera").camera.exposure == 1.0
        values = {"": 1.5, ":iso": 400.0, ":time": 0.5, ":fStop": 2.8, ":responsivity": 0.9}
        for name, value in values.items():
            prim.GetAttribute(f"exposure{name}").Set(value)
        expected = 0.9 * 0.5 * 4.0 * 2**1.5 / 2.8**2
        assert engine.view("/Rig/Camera").camera.exposure == pytest.approx(expected)


def test_a_lens_has_half_its_focal_length_over_its_f_number(stage):
    """Oracle: a focal length of 20 tenths at f/4 has a pupil of 0.5 across; the rules for none."""
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Rig/Camera"))
    UsdGeom.Xformable(stage.GetPrimAtPath("/Rig")).AddScaleOp().Set(Gf.Vec3f(3))
    with Engine(stage) as engine:
        assert engine.view("/Rig/Camera").camera.lens_radius == 0.0
        camera.CreateFStopAttr(4.0)
        assert engine.view("/Rig/Camera").camera.lens_radius == 0.0
        camera.CreateFocusDistanceAttr(7.0)
        spec = engine.view("/Rig/Camera").camera
        assert (spec.lens_radius, spec.focus_distance) == (pytest.approx(0.25), 7.0)
        camera.CreateProjectionAttr("orthographic")
        assert engine.view("/Rig/Camera").camera.lens_radius == 0.0
        camera.CreateProjectionAttr("perspective")
        for value in (0.0, -2.0, math.nan, math.inf):
            camera.CreateFStopAttr(value)
            assert engine.view("/Rig/Camera").camera.lens_radius == 0.0


def test_the_shutter_is_relative_to_the_frame(stage):
    """Oracle: the authored numbers, in time codes."""
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Rig/Camera"))
    with Engine(stage) as engine:
        assert engine.view("/Rig/Camera").camera.shutter == (0.0, 0.0)
        camera.CreateShutterOpenAttr(-0.25)
        camera.CreateShutterCloseAttr(0.25)
        assert engine.view("/Rig/Camera").camera.shutter == (-0.25, 0.25)


def test_a_shutter_that_closes_first_is_said_and_the_camera_is_still(stage):
    """Oracle: the sentence; the camera is of use all the same, and mended it says nothing."""
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Rig/Camera"))
    camera.CreateShutterOpenAttr(0.5)
    with Engine(stage) as engine:
        assert engine.view("/Rig/Camera").camera.shutter == (0.0, 0.0)
        (sentence,) = engine.warnings
        assert sentence.startswith("/Rig/Camera shutter:open and shutter:close: found (0.5, 0)")
        camera.CreateShutterCloseAttr(0.75)
        assert engine.warnings == ()
        camera.CreateShutterCloseAttr(math.nan)
        assert len(engine.warnings) == 1
        stage.RemovePrim("/Rig/Camera")
        assert engine.warnings == ()


@pytest.mark.parametrize(
    "name",
    ["fStop", "focusDistance", "shutter:open", "shutter:close"]
    + [f"exposure{part}" for part in ("", ":iso", ":time", ":fStop", ":responsivity")],
)
def test_all_of_a_lens_may_be_animated(stage, name):
    """Oracle: an engine that is at the second time from the start."""
    prim = stage.GetPrimAtPath("/Rig/Camera")
    for each, value in (("fStop", 2.0), ("focusDistance", 3.0), ("shutter:close", 1.5)):
        prim.GetAttribute(each).Set(value)
    prim.GetAttribute(name).Set(0.5, 1)
    prim.GetAttribute(name).Set(1.0, 2)
    with Engine(stage, time=1) as engine, Engine(stage, time=2) as there:
        first = engine.view("/Rig/Camera").camera
        engine.set_time(2)
        assert first != engine.view("/Rig/Camera").camera == there.view("/Rig/Camera").camera


def test_what_a_camera_asks_for_in_vain_is_said(stage):
    """Oracle: the attributes that are authored; without them nothing is said."""
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Rig/Camera"))
    with Engine(stage) as engine:
        assert engine.warnings == ()
        camera.CreateClippingPlanesAttr([Gf.Vec4f(0, 0, 1, 5)])
        camera.CreateProjectionAttr("fisheye")
        planes, projection = sorted(engine.findings, key=lambda each: each.attribute)
    assert {planes.code, projection.code} == {"unsupported-input"}
    assert "/Rig/Camera.clippingPlanes: found 1 plane, expected none" in planes.message
    assert "/Rig/Camera.projection: found 'fisheye'" in projection.message
