"""Tests of cameras in the viewer's coordinates.

The viewer's world is a stage with y up, turned by 180 degrees about y: (-x, y, -z).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdRender

from tests.delegate.stages import random_cloud, two_fields
from tests.products.page.pages import moving_stage, still_stage
from tests.render.test_subject import block, place
from usdsplat import schema
from usdsplat.core.errors import StageError, UsageError
from usdsplat.delegate.engine import Engine
from usdsplat.products.page.camera import MOST_KEYS, PageRequest, page_camera


@pytest.mark.parametrize(("up_axis", "position"), [("Y", (-1, 2, -10)), ("Z", (-1, 10, 2))])
def test_a_still_camera_stands_where_the_stage_has_it(up_axis, position):
    """Oracle: the turn by hand; the z of a stage with z up is up, its y goes away from the eye."""
    found = page_camera(still_stage(up_axis), PageRequest(resolution=(640, 480)), None)
    assert (found.path, found.frames, found.start) == ("/Camera", (0.0,), 0)
    np.testing.assert_allclose(found.positions, [position], atol=1e-6)
    ahead = (found.targets - found.positions) / np.linalg.norm(found.targets - found.positions)
    down = {"Y": ([[0, 0, 1]], [[0, 1, 0]]), "Z": ([[0, -1, 0]], [[0, 0, 1]])}[up_axis]
    np.testing.assert_allclose(ahead, down[0], atol=1e-6)
    np.testing.assert_allclose(found.ups, down[1], atol=1e-6)


@pytest.mark.parametrize(
    ("resolution", "half"), [((640, 480), 0.5), ((960, 480), 0.75), ((480, 640), 0.5 * 4 / 3)]
)
def test_the_field_of_view_is_that_of_the_longer_side(resolution, half):
    """Oracle: aperture 20 x 15 and focal length 20, enlarged to the picture's aspect ratio."""
    found = page_camera(still_stage(), PageRequest(resolution=resolution), None)
    np.testing.assert_allclose(found.fovs, 2 * math.degrees(math.atan(half)), rtol=1e-6)


def test_an_animated_camera_has_the_poses_of_its_frames():
    """Oracle: USD's own camera at each frame, turned by hand."""
    stage = moving_stage()
    found = page_camera(stage, PageRequest(resolution=(640, 480)), 4.0)
    assert (found.frames, found.rate, found.start) == (tuple(range(1, 13)), 24.0, 3)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Camera"))
    for k, frame in enumerate(found.frames):
        lens = camera.GetCamera(frame)
        eye, ahead = lens.frustum.position, lens.frustum.ComputeViewDirection()
        up = lens.frustum.ComputeUpVector()
        turn = np.array([-1, 1, -1])
        np.testing.assert_allclose(found.positions[k], turn * eye, atol=1e-5)
        way = found.targets[k] - found.positions[k]
        np.testing.assert_allclose(way / np.linalg.norm(way), turn * ahead, atol=1e-5)
        np.testing.assert_allclose(found.ups[k], turn * up, atol=1e-5)
        wide = lens.horizontalAperture / lens.focalLength  # 4:3 is taller than the aperture
        assert found.fovs[k] == pytest.approx(2 * math.degrees(math.atan(0.5 * wide)), rel=1e-5)


def test_the_target_is_as_far_away_as_the_subject():
    """Oracle: the camera is 10 in front of clouds around z = 0, with outliers."""
    found = page_camera(still_stage(), PageRequest(), None)
    assert np.linalg.norm(found.targets - found.positions) == pytest.approx(10, abs=1)


def test_frames_are_those_that_are_asked_for():
    """Oracle: the request, and its order."""
    found = page_camera(moving_stage(), PageRequest(frames=(7.0, 3.0, 5.0)), 1.0)
    assert (found.frames, found.start) == ((3.0, 5.0, 7.0), 0)


def test_a_camera_that_does_not_move_has_one_frame():
    """Oracle: a stage with a range, whose camera has no time samples."""
    stage = still_stage()
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(100)
    assert page_camera(stage, PageRequest(), 1.0).frames == (1.0,)


def test_a_stage_without_a_camera_gets_an_automatic_one():
    """Oracle: both clouds are in front of it."""
    found = page_camera(two_fields(), PageRequest(), None)
    assert (found.path, len(found.frames)) == ("", 1)
    ahead = (found.targets - found.positions)[0]
    assert all(
        (np.array(place) - found.positions[0]) @ ahead > 0 for place in ((0,) * 3, (-2, 0, 0))
    )


def test_an_automatic_camera_shows_the_subject_in_narrow_windows():
    """Oracle: a tall cloud, whose width and height at its distance are those of its box, about; in
    a window like the picture the field of view is that of the picture."""
    stage = Usd.Stage.CreateInMemory()
    cloud = random_cloud(1, n=500)
    positions = np.float32([0.5, 3, 0.5]) * np.clip(cloud.positions, -1, 1)
    schema.author(stage, "/A", replace(cloud, positions=positions))
    found = page_camera(stage, PageRequest(resolution=(1600, 900)), None)
    assert 0.15 < found.aspect < 0.5
    with Engine(stage) as engine:
        top = engine.view(resolution=(1600, 900)).camera.window[3]
    assert found.fovs[0] == pytest.approx(2 * math.degrees(math.atan(top)))


def test_an_automatic_camera_of_a_place_turns_around_what_it_frames():
    """Oracle: target and distance of `frame`; the place is around a block of 2 by 2 by 2. Of the
    block alone, narrow windows show no more than its diagonal."""
    stages = [Usd.Stage.CreateInMemory() for _ in range(2)]
    for stage, cloud in zip(stages, (place(), block()), strict=True):
        schema.author(stage, "/A", cloud)
    found, alone = (page_camera(stage, PageRequest(), None) for stage in stages)
    assert np.linalg.norm(found.targets) < 3
    size = np.linalg.norm(found.positions - found.targets)
    with Engine(stages[0]) as engine:
        spec = engine.view(resolution=(1920, 1080)).camera
        target, distance = engine.render_scene.seen().frame(
            np.reshape(spec.world_to_camera, (4, 4))[:3, :3], spec.window[2:]
        )
    assert size == pytest.approx(distance)
    np.testing.assert_allclose(found.targets, [target * (-1, 1, -1)], atol=1e-6)
    assert 0.9 < alone.aspect < 1.2


@pytest.mark.parametrize("last", [1e9, math.inf, -5.0, math.nan])
def test_a_range_that_is_none_is_one_sentence(last):
    """Oracle: the limit, and the flag that helps."""
    stage = moving_stage()
    stage.SetEndTimeCode(last)
    with pytest.raises(UsageError, match=f"expected 1 to {MOST_KEYS} frames, or --frames"):
        page_camera(stage, PageRequest(), 1.0)


def test_a_rate_of_zero_is_that_of_usd():
    """Oracle: USD's default."""
    stage = moving_stage()
    stage.SetTimeCodesPerSecond(0)
    assert page_camera(stage, PageRequest(), 1.0).rate == 24


def test_an_unknown_camera_is_an_error():
    """Oracle: the cameras there are."""
    with pytest.raises(StageError, match="found 'Cam', expected one of /Camera"):
        page_camera(still_stage(), PageRequest(camera="Cam"), None)


def test_what_the_viewer_cannot_show_is_noted():
    """Oracle: offsets and projection authored here; the narrow view has the width of the target."""
    stage = still_stage()
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/Camera"))
    camera.CreateHorizontalApertureOffsetAttr(2.0)
    camera.CreateProjectionAttr(UsdGeom.Tokens.orthographic)
    found = page_camera(stage, PageRequest(resolution=(640, 480)), None)
    assert [note[:23] for note in found.notes] == [
        "the viewer centres the ",
        "the viewer has no paral",
    ]
    distance = np.linalg.norm(found.targets - found.positions)
    wide = 2 * distance * math.tan(math.radians(found.fovs[0]) / 2)
    assert wide == pytest.approx(2.0, rel=1e-5)  # 20 tenths of a unit


def test_a_camera_on_the_subject_still_looks_ahead():
    """Oracle: the direction; the target is not behind the eye."""
    stage = still_stage()
    op = UsdGeom.Xformable(stage.GetPrimAtPath("/Camera")).GetOrderedXformOps()[0]
    op.Set(Gf.Vec3d(0, 0, -10))
    found = page_camera(stage, PageRequest(), None)
    way = (found.targets - found.positions)[0]
    assert way[2] > 0
    np.testing.assert_allclose(way[:2], 0, atol=1e-6)


def with_background(color: str) -> Usd.Stage:
    """A stage with a product of this background."""
    stage = still_stage()
    settings = UsdRender.Settings.Define(stage, "/Render")
    product = UsdRender.Product.Define(stage, "/Render/Product")
    settings.GetProductsRel().AddTarget(product.GetPath())
    stage.SetMetadata("renderSettingsPrimPath", "/Render")
    attribute = settings.GetPrim().CreateAttribute("splat:background", Sdf.ValueTypeNames.Token)
    attribute.Set(color)
    return stage


@pytest.mark.parametrize(
    ("authored", "asked", "is_capture", "expected"),
    [
        (None, None, False, (0, 0, 0)),
        (None, None, True, (56 / 255,) * 3),
        ("white", None, False, (1, 1, 1)),
        ("white", "0,0.5,1", False, (0, 0.5, 1)),
        ("white", "transparent", True, (0, 0, 0)),
        (" White ", None, False, (1, 1, 1)),
        ("white", " Auto ", True, (56 / 255,) * 3),
    ],
)
def test_the_background_is_that_of_the_picture(authored, asked, is_capture, expected):
    """Oracle: the colours by hand; grey is #383838, and where pictures are transparent, black."""
    stage = with_background(authored) if authored else still_stage()
    found = page_camera(stage, PageRequest(background=asked), None, is_capture=is_capture)
    assert found.background == pytest.approx(expected)


def test_a_background_that_is_no_colour_is_an_error():
    """Oracle: the words of `render`: who gave it, what was found, and what is possible."""
    expected = "expected auto, transparent, black, grey, white, #rrggbb"
    with pytest.raises(UsageError, match=f"^--background: found 'bright', {expected}"):
        page_camera(still_stage(), PageRequest(background="bright"), None)
    with pytest.raises(UsageError, match=f"^splat:background: found 'purple', {expected}"):
        page_camera(with_background("purple"), PageRequest(), None)
