"""Tests of the public interface of the engine."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.delegate.stages import add_camera, random_cloud, two_fields
from usdsplat import schema
from usdsplat.core.errors import BackendError, StageError, UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.render.settings import RenderSettings
from usdsplat.render.specs import CameraSpec, Framing, View

SIZE = (32, 24)


def test_bands_are_the_picture():
    """Oracle: the rows of the one are the rows of the other."""
    with Engine(two_fields()) as engine:
        view = engine.view(resolution=SIZE)
        whole = engine.picture(view, aovs=("color", "depth"))
        for band in engine.render(view, aovs=("color", "depth")):
            for name, pixels in band.arrays.items():
                np.testing.assert_array_equal(pixels, whole[name][band.y0 : band.y1])
    assert whole["color"].shape == (24, 32, 4) and whole["depth"].shape == (24, 32)
    assert whole["color"][..., 3].max() > 0.5


def test_an_unchanged_picture_is_not_drawn_again():
    """Oracle: the statistics of a drawing are replaced by each drawing."""
    stage = two_fields()
    with Engine(stage) as engine:
        view = engine.view(resolution=SIZE)
        first = engine.picture(view)["color"]
        stats = engine.stats
        assert engine.picture(view)["color"].base is first.base
        assert engine.stats is stats
        UsdGeom.Imageable(stage.GetPrimAtPath("/World/A")).MakeInvisible()
        assert engine.picture(view)["color"].base is not first.base
        assert engine.stats is not stats


def test_a_picture_without_a_sync_is_of_what_was_synced():
    """What a host does that locks the stage while it syncs, and draws without the lock. Oracle: the
    count of what was read from the stage, and pictures before and after the edit."""
    stage = two_fields()
    with Engine(stage, time=1) as engine:
        view = engine.view(resolution=SIZE)
        before = engine.picture(view)["color"]
        UsdGeom.Imageable(stage.GetPrimAtPath("/World/A")).MakeInvisible()
        engine.set_time(2)
        pulls = engine.pulls
        assert engine.picture(view, sync=False)["color"].base is before.base
        other = replace(view, framing=Framing(resolution=SIZE, data_window=(4, 0, 32, 24)))
        cropped = engine.picture(other, RenderSettings(samples=3), sync=False)["color"]
        whole = engine.picture(view, RenderSettings(samples=3), sync=False)["color"]
        assert engine.pulls == pulls
        np.testing.assert_array_equal(cropped, whole[:, 4:])
        after = engine.picture(view, RenderSettings(samples=3))["color"]
        assert not np.array_equal(after, whole)
        assert engine.pulls != pulls


@pytest.mark.parametrize("sync", [True, False])
def test_a_picture_that_shows_other_times_follows_the_stage(sync):
    """Oracle: similar triangles: a ball that moves by 0.1 of a view one unit wide."""
    stage = Usd.Stage.CreateInMemory()
    move = UsdGeom.Sphere.Define(stage, "/Ball").AddTranslateOp()
    move.Set((0.0, 0.0, -11.0), 0.0)
    move.Set((1.0, 0.0, -11.0), 1.0)
    spec = CameraSpec(window=(-0.5, -0.5, 0.5, 0.5), clipping_range=(0.1, 100.0))
    view = View(camera=spec, framing=Framing(resolution=(65, 65)))
    with Engine(stage, time=0.0) as engine:
        engine.sync()
        found = engine.picture(view, aovs=("motionForward",), sync=sync)["motionForward"]
    assert found[32, 32] == pytest.approx((6.5, 0.0), abs=1e-4)


def test_a_camera_of_nobodys_needs_no_engine():
    """Oracle: the same camera taken from the stage, whatever is asked for."""
    stage = two_fields()
    add_camera(stage)
    with Engine(stage, time=1) as engine:
        theirs = engine.view("/Camera", resolution=SIZE)
        ours = View(camera=replace(theirs.camera, path=""), framing=theirs.framing)
        for settings in (RenderSettings(), RenderSettings(samples=2, sorting="rayHitDistance")):
            aovs = ("color", "P", "motionForward", "cryptoObject", "Neye")
            expected = engine.picture(theirs, settings, aovs)
            for name, pixels in engine.picture(ours, settings, aovs).items():
                np.testing.assert_array_equal(pixels, expected[name])
        assert engine.estimate(ours).splats == engine.estimate(theirs).splats


def test_views_are_values_at_a_time():
    """Oracle: equality of values; a view taken earlier still shows what it showed."""
    stage = two_fields()
    add_camera(stage)
    camera = stage.GetPrimAtPath("/Camera").GetAttribute("xformOp:translate")
    camera.Set((0, 0, 10), 1)
    camera.Set((0, 0, 20), 2)
    with Engine(stage, time=1) as engine:
        near = engine.view("/Camera", resolution=SIZE)
        picture = engine.picture(near)["color"]
        engine.set_time(2)
        far = engine.view("/Camera", resolution=SIZE)
        assert near != far
        assert not np.array_equal(engine.picture(far)["color"], picture)
        np.testing.assert_array_equal(engine.picture(near)["color"], picture)
        assert engine.time == 2


def test_a_resolution_takes_the_place_of_the_framings():
    """Oracle: the arguments."""
    framing = Framing(pixel_aspect_ratio=2.0, conform="cropAperture")
    with Engine(two_fields()) as engine:
        view = engine.view(framing=framing, resolution=SIZE)
        assert view.framing == Framing(
            resolution=SIZE, pixel_aspect_ratio=2.0, conform="cropAperture"
        )


def test_ids_name_the_prims_that_are_drawn():
    """Oracle: each prim's own picture: where it alone has coverage, the id is its own."""
    stage = two_fields()
    with Engine(stage) as engine:
        view = engine.view(resolution=SIZE)
        ids = engine.picture(view, aovs=("primId",))["primId"]
        names = engine.drawn_paths()
        assert names == ("/World/A", "/World/B")
        for number, path in enumerate(names):
            for other in names:
                imageable = UsdGeom.Imageable(stage.GetPrimAtPath(other))
                imageable.CreateVisibilityAttr("inherited" if other == path else "invisible")
            covered = engine.picture(view)["color"][..., 3] > 0
            assert covered[ids == number].all() and (ids == number).any()


@pytest.mark.parametrize("agreed", [True, False])
def test_auto_sorting_follows_the_visible_prims(agreed):
    """Oracle: pictures with the sorting named; hidden prims have no say."""
    stage = two_fields()
    schema.author(
        stage,
        "/World/A",
        random_cloud(1, n=80),
        drawing=schema.DrawingHints(sorting_mode="cameraDistance"),
    )
    if agreed:
        UsdGeom.Imageable(stage.GetPrimAtPath("/World/B")).MakeInvisible()
    with Engine(stage) as engine:
        camera = add_camera(stage, eye=(0.0, 0.0, 2.0))
        view = engine.view(str(camera.GetPath()), resolution=SIZE)
        pictures = {
            name: engine.picture(view, RenderSettings(sorting=name))["color"]
            for name in ("auto", "zDepth", "cameraDistance")
        }
    assert not np.array_equal(pictures["zDepth"], pictures["cameraDistance"])
    same = "cameraDistance" if agreed else "zDepth"
    np.testing.assert_array_equal(pictures["auto"], pictures[same])


def test_a_closed_engine_says_so_and_closes_twice_without_harm():
    """Oracle: the sentence."""
    engine = Engine(two_fields())
    view = engine.view(resolution=SIZE)
    engine.close()
    engine.close()
    uses = (
        engine.sync,
        engine.products,
        lambda: engine.picture(view),
        lambda: engine.picture(view, sync=False),
        lambda: engine.time,
    )
    for use in uses:
        with pytest.raises(UsageError, match="engine: found a closed one, expected an open one"):
            use()


def test_unknown_devices_are_refused():
    """Oracle: the error's class."""
    with pytest.raises(BackendError, match="device"):
        Engine(Usd.Stage.CreateInMemory(), device="abacus")


def test_an_empty_stage_makes_an_empty_picture():
    """Oracle: no splats, no light."""
    with Engine(Usd.Stage.CreateInMemory()) as engine:
        view = engine.view(resolution=SIZE)
        picture = engine.picture(view, aovs=("color", "depth", "primId"))
    assert not picture["color"].any()
    assert np.isinf(picture["depth"]).all()
    assert (picture["primId"] == -1).all()


def test_the_renderer_and_the_prims_do_without_usd():
    """Oracle: the modules that a fresh interpreter has loaded."""
    code = """
import sys
from usdsplat.delegate import (
    default_camera, instancing, product, render_index, render_pass, splat_field)
from usdsplat.render import framing, renderer
assert "pxr" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_prim_that_is_left_out_is_logged_once(caplog):
    """Oracle: the log records of Python's own logging."""
    stage = two_fields()
    schema.author(stage, "/World/A", random_cloud(1), form="packed")
    packing = stage.GetPrimAtPath("/World/A").GetAttribute(schema.tokens.PACKING)
    with Engine(stage) as engine:
        packing.Set("some_future_layout")
        engine.sync()
        engine.set_time(3)
        engine.sync()
        assert engine.drawn_paths() == ("/World/B",)
    (record,) = caplog.records
    assert record.name == "usdsplat" and "left out: /World/A" in record.getMessage()


@pytest.mark.parametrize(
    ("settings", "aovs"),
    [(RenderSettings(samples=2), ("color",)), (RenderSettings(), ("motionForward",))],
)
def test_a_picture_that_fails_at_another_time_leaves_the_time_as_it_was(
    settings: RenderSettings, aovs: tuple[str, ...]
) -> None:
    """A picture that fails at another time leaves the engine where it was: the camera has no focal
    length a frame later. Oracle: the time before."""
    stage = Usd.Stage.CreateInMemory()
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    camera.CreateShutterCloseAttr(1.5)
    camera.CreateFocalLengthAttr().Set(50.0, 0.0)
    camera.GetFocalLengthAttr().Set(0.0, 0.5)
    with Engine(stage, time=0.0) as engine:
        view = engine.view("/Camera", resolution=(8, 8))
        with pytest.raises(StageError, match="focal length"):
            engine.picture(view, settings, aovs)
        assert engine.time == 0.0


def test_what_was_replaced_of_a_camera_stays_at_other_times() -> None:
    """What was replaced of a camera stays at other times, the rest follows the stage: a wider
    window and a camera that moves by a unit. Oracle: the same window drawn without any time, and
    similar triangles."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Sphere.Define(stage, "/Ball")
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    camera.CreateClippingRangeAttr((0.1, 100.0))
    move = camera.AddTranslateOp()
    move.Set((0.0, 0.0, 11.0), 0.0)
    move.Set((1.0, 0.0, 11.0), 1.0)
    with Engine(stage, time=0.0) as engine:
        view = engine.view("/Camera", resolution=(65, 65))
        view = replace(view, camera=replace(view.camera, window=(-1.0, -1.0, 1.0, 1.0)))
        found = engine.picture(view, aovs=("motionForward",))["motionForward"]
        assert found[32, 32] == pytest.approx((-65 / 2 / 10, 0.0), abs=1e-4)


@pytest.mark.parametrize(
    ("holdout", "found"),
    [
        (np.ones((2, 2), np.float32), "depths of shape"),
        ((np.zeros(3, np.int64), np.empty(0), np.empty(0)), "3 offsets"),
        (
            (np.full(65, 9, np.int64), np.ones(9), np.ones(9)),
            "offsets that do not match the nodes",
        ),
        ((np.zeros(65, np.int64), np.empty(0), np.ones(1)), "1 transmittances"),
    ],
)
def test_a_holdout_of_another_shape_is_refused(holdout, found: str) -> None:
    """A holdout of another shape is refused: kernels would read what is not there. Oracle: the
    sentence."""
    with Engine(two_fields()) as engine:
        view = engine.view(resolution=(8, 8))
        with pytest.raises(UsageError, match=f"holdout: found {found}"):
            list(engine.render(view, holdout=lambda *_: holdout))


def test_an_engine_begins_at_the_first_frame():
    """Oracle: the range of the stage, and an engine that is told the time."""
    stage = two_fields()
    move = UsdGeom.Xformable(stage.GetPrimAtPath("/World/A")).AddTranslateOp(opSuffix="shot")
    move.Set((0.5, 0, 0), 1001)
    move.Set((-0.5, 0, 0), 1010)
    with Engine(stage) as engine:
        assert engine.time is None
    stage.SetStartTimeCode(1001)
    stage.SetEndTimeCode(1010)
    with (
        Engine(stage) as engine,
        Engine(stage, time=1001) as told,
        Engine(stage, time=None) as still,
    ):
        assert (engine.time, told.time, still.time) == (1001.0, 1001.0, None)
        view = told.view(resolution=SIZE)
        first, other, default = (each.picture(view)["color"] for each in (engine, told, still))
        np.testing.assert_array_equal(first, other)
        assert (first != default).any()
        engine.set_time(None)
        np.testing.assert_array_equal(engine.picture(view)["color"], default)
