"""Tests that other programs can use the camera, the time and the origin in a picture's header."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from fractions import Fraction

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Usd, UsdGeom, UsdRender

from tests.products import reprojection
from usdsplat import main

pytestmark = pytest.mark.usefixtures("compiled")

SIZE = ("--resolution", "60x40")
CROP, OVERSCAN = (0.1, 0.2, 0.7, 0.9), (-0.2, -0.1, 1.15, 1.3)
"""Values of dataWindowNDC."""


@pytest.fixture
def filmed(shot):
    """Return a function that sets the shot's camera; the stage is in centimetres, at 23.976."""

    def author(offset=(0.0, 0.0), projection="perspective", window=None):
        stage = Usd.Stage.Open(str(shot))
        stage.SetFramesPerSecond(23.976)
        stage.SetTimeCodesPerSecond(23.976)
        stage.SetStartTimeCode(1001)
        stage.SetEndTimeCode(1001)
        UsdGeom.SetStageMetersPerUnit(stage, 0.01)
        camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Cam"))
        camera.GetPrim().GetAttribute("xformOp:translate").Set(Gf.Vec3d(1.5, 1.0, 3.5))
        camera.AddRotateXYZOp().Set(Gf.Vec3f(-14.0, 23.0, 5.0))
        camera.GetFocalLengthAttr().Set(35.0)
        camera.GetHorizontalApertureAttr().Set(36.0)
        camera.GetVerticalApertureAttr().Set(24.0)
        camera.GetHorizontalApertureOffsetAttr().Set(offset[0])
        camera.GetVerticalApertureOffsetAttr().Set(offset[1])
        camera.GetProjectionAttr().Set(projection)
        camera.GetFStopAttr().Set(2.8)
        camera.GetFocusDistanceAttr().Set(450.0)
        camera.GetShutterOpenAttr().Set(-0.25)
        camera.GetShutterCloseAttr().Set(0.25)
        if projection == "orthographic":
            camera.GetHorizontalApertureAttr().Set(24.0)
            camera.GetVerticalApertureAttr().Set(16.0)
        if window:
            settings = UsdRender.Settings.Define(stage, "/Render/Main")
            product = UsdRender.Product.Define(stage, "/Render/Own")
            product.CreateDataWindowNDCAttr().Set(Gf.Vec4f(*window))
            settings.GetProductsRel().AddTarget(product.GetPath())
        stage.GetRootLayer().Save()
        return shot

    return author


def rendered(shot, tmp_path, *flags):
    file = tmp_path / "P.exr"
    words = ("render", shot, "-o", file, "--aovs", "color,P", "--float", *SIZE, *flags)
    assert main([str(word) for word in words]) == 0
    return file


@pytest.mark.parametrize(
    ("author", "flags"),
    [
        ({}, ()),
        ({"offset": (4.0, -3.0)}, ()),
        ({"projection": "orthographic"}, ()),
        ({"projection": "orthographic", "offset": (3.0, 2.0)}, ("--overscan", 8)),
        ({"window": CROP}, ()),
        ({"window": OVERSCAN, "offset": (4.0, -3.0)}, ()),
        ({"window": CROP, "offset": (4.0, -3.0), "projection": "orthographic"}, ()),
        ({}, ("--overscan", 8)),
        ({}, ("--crop", "10,5,50,35")),
        ({}, ("--pixel-aspect", 2, "--resolution", "30x40")),
    ],
)
def test_positions_fall_on_their_own_pixels(filmed, tmp_path, author, flags):
    """Oracle: `reprojection`, which reads with OpenEXR and knows nothing of ours."""
    header, channels = reprojection.read(rendered(filmed(**author), tmp_path, *flags))
    is_seen = channels["A"] > 0.5
    assert is_seen.sum() > 50
    x, y = reprojection.to_pixels(header, reprojection.positions(channels))
    across, down = reprojection.centres(header)
    assert np.hypot(x - across, y - down)[is_seen].max() < 2e-3


@pytest.mark.parametrize(
    ("author", "flags"),
    [
        ({}, ()),
        ({"offset": (4.0, -3.0)}, ()),
        ({"offset": (-2.0, 5.0), "window": OVERSCAN}, ()),
        ({"offset": (4.0, -3.0)}, ("--pixel-aspect", 2, "--resolution", "30x40")),
        ({"offset": (4.0, -3.0)}, ("--resolution", "40x40")),
    ],
)
def test_nuke_sees_positions_where_they_are(filmed, tmp_path, author, flags):
    """Oracle: `reprojection.through_nuke`: a camera that looks down -z, with focal length,
    haperture and win_translate as the recipe of the page on headers has them."""
    header, channels = reprojection.read(rendered(filmed(**author), tmp_path, *flags))
    is_seen = channels["A"] > 0.5
    x, y = reprojection.through_nuke(header, reprojection.positions(channels))
    across, down = reprojection.centres(header)
    assert np.hypot(x - across, y - down)[is_seen].max() < 2e-3
    matrix, focal, _, _ = reprojection.nuke_camera(header)
    np.testing.assert_allclose(matrix[:3, 3], (1.5, 1.0, 3.5), atol=1e-5)
    assert focal == pytest.approx(35.0)


def test_the_film_back_and_its_offset_are_the_cameras(filmed, tmp_path):
    """Oracle: the authored apertures; an offset of 4 to the right on a half width of 18."""
    header, _ = reprojection.read(rendered(filmed(offset=(4.0, -3.0)), tmp_path))
    np.testing.assert_allclose(header["sensorOverallDimensions"], (36.0, 24.0), rtol=1e-6)
    *_, shift = reprojection.nuke_camera(header)
    np.testing.assert_allclose(shift, (4 / 18, -3 / 18), rtol=1e-6)


def test_a_camera_without_a_lens_has_its_field_of_view(tmp_path, filmed):
    """Oracle: `through_nuke` on a camera that frames the scene, with USD's default focal length."""
    stage = Usd.Stage.Open(str(filmed()))
    stage.RemovePrim("/World/Cam")
    stage.GetRootLayer().Save()
    header, channels = reprojection.read(rendered(stage.GetRootLayer().realPath, tmp_path))
    assert header["pinholeFocalLength"] == 50.0
    assert not {"aperture", "focus"} & set(header)
    x, y = reprojection.through_nuke(header, reprojection.positions(channels))
    across, down = reprojection.centres(header)
    is_seen = channels["A"] > 0.5
    assert is_seen.sum() > 50
    assert np.hypot(x - across, y - down)[is_seen].max() < 2e-3


def test_lens_shutter_and_time_are_in_standard_units(filmed, tmp_path):
    """Oracle: OpenEXR's reader; mm, m, s and ratios worked out by hand from the stage."""
    header, _ = reprojection.read(rendered(filmed(), tmp_path))
    assert header["framesPerSecond"] == Fraction(24000, 1001)
    code = header["timeCode"]
    assert (code.hours, code.minutes, code.seconds, code.frame) == (0, 0, 41, 17)
    assert header["aperture"] == pytest.approx(2.8)
    assert header["focus"] == pytest.approx(4.5)
    assert header["expTime"] == pytest.approx(0.5 / 23.976)
    np.testing.assert_allclose(header["usdsplat:shutter"], (-0.25, 0.25))


def test_an_orthographic_camera_has_no_focal_length(filmed, tmp_path):
    """Oracle: OpenEXR's reader."""
    header, _ = reprojection.read(rendered(filmed(projection="orthographic"), tmp_path))
    assert not {"pinholeFocalLength", "sensorOverallDimensions", "aperture"} & set(header)


def test_a_stage_is_identified_by_its_files(filmed, tmp_path):
    """Oracle: SHA-256 of hashlib; a copy elsewhere has the same, an edit another."""
    shot = filmed()
    digest = hashlib.sha256(shot.read_bytes()).hexdigest()
    expected = hashlib.sha256(digest.encode()).hexdigest()
    assert reprojection.read(rendered(shot, tmp_path))[0]["usdsplat:stageHash"] == expected
    copy = tmp_path / "copy.usda"
    copy.write_bytes(shot.read_bytes())
    assert reprojection.read(rendered(copy, tmp_path))[0]["usdsplat:stageHash"] == expected
    copy.write_bytes(shot.read_bytes().replace(b"23.976", b"23.98"))
    assert reprojection.read(rendered(copy, tmp_path))[0]["usdsplat:stageHash"] != expected


@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_builds_can_be_repeated(filmed, tmp_path, monkeypatch, suffix):
    """Oracle: two files have the same bytes; OpenImageIO's reader finds neither date nor machine,
    but finds the machine without the variable."""
    shot = filmed()
    words = ["render", str(shot), "-o", str(tmp_path / f"a.{suffix}"), *SIZE]

    def entries():
        assert main(words) == 0
        spec = oiio.ImageInput.open(words[3]).spec()
        return {item.name for item in spec.extra_attribs}

    of_the_moment = {"HostComputer", "DateTime", "capDate"}
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    assert "HostComputer" in entries()
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1000000000")
    assert not entries() & of_the_moment
    first = (tmp_path / f"a.{suffix}").read_bytes()
    entries()
    assert (tmp_path / f"a.{suffix}").read_bytes() == first


def test_the_script_stands_alone(filmed, tmp_path):
    """Oracle: its own words, in a process that imports nothing of ours."""
    run = subprocess.run(
        [sys.executable, reprojection.__file__, str(rendered(filmed(), tmp_path))],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "greatest distance" in run.stdout
