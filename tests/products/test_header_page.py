"""Tests that the page on headers lists the entries of each kind of file, no more and no fewer."""

from __future__ import annotations

import re
from pathlib import Path

import OpenEXR
import pytest
from pxr import Gf, Usd, UsdGeom

from usdsplat import main

pytestmark = pytest.mark.usefixtures("compiled")

PAGE = Path(__file__).parents[2] / "docs" / "picture_headers.md"
OF_THE_FORMAT = {
    "channels", "chunkCount", "compression", "dataWindow", "displayWindow", "lineOrder", "name",
    "pixelAspectRatio", "type", "maxSamplesPerPixel", "version",
}  # fmt: skip
"""Attributes that OpenEXR requires, which describe the file."""
LENS = {"pinholeFocalLength", "sensorOverallDimensions", "aperture", "focus"}
VIEW = {"usdsplat:view", "usdsplat:ocioConfig"}
SPECIAL = {"usdsplat:shown:NAME", "usdsplat:background"}
EXTRA = ("--aovs", "color,Z,id,cryptoObject")


def listed(*kinds):
    """Names of the page's table in these places."""
    rows = re.findall(r"^\| `([^`]+)` \| [^|]+ \| (parts|first|exr) \|", PAGE.read_text(), re.M)
    assert len(rows) > 30
    return {name for name, kind in rows if kind in kinds}


def shortened(names):
    """Names as the page has them."""
    names = {re.sub(r"(usdsplat:aov:).*", r"\1NAME", name) for name in names}
    return {re.sub(r"cryptomatte/.*", "cryptomatte/KEY/…", name) for name in names}


@pytest.fixture
def rendered(shot, tmp_path, monkeypatch):
    """Return a function that renders with a camera and returns the entries' names of each part."""
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    stage = Usd.Stage.Open(str(shot))
    for name, projection in (("Cam", "perspective"), ("Flat", "orthographic")):
        camera = UsdGeom.Camera.Define(stage, f"/World/{name}")
        camera.GetProjectionAttr().Set(projection)
        camera.GetFStopAttr().Set(2.8)
        camera.GetFocusDistanceAttr().Set(400.0)
        camera.GetShutterOpenAttr().Set(-0.25)
        camera.GetShutterCloseAttr().Set(0.25)
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 3))
    stage.SetFramesPerSecond(24)
    stage.GetRootLayer().Save()

    def parts(camera, *flags, suffix="exr"):
        if camera is None:
            stage.RemovePrim("/World/Cam")
            stage.RemovePrim("/World/Flat")
            stage.GetRootLayer().Save()
        file = tmp_path / f"a.{suffix}"
        words = ("render", shot, "-o", file, "--resolution", "24x16", "--frames", 1, *flags)
        words += ("--camera", camera) if camera else ()
        assert main([str(word) for word in words]) == 0
        if suffix == "png":
            from PIL import Image

            with Image.open(file) as picture:
                return [set(picture.text)]
        found = OpenEXR.File(str(file), header_only=True).parts
        return [shortened(set(part.header) - OF_THE_FORMAT) for part in found]

    return parts


def test_an_exr_has_what_the_page_lists(rendered):
    """Oracle: OpenEXR's reader, for a camera with lens and shutter, and for its part of ids."""
    main_part, ids = rendered("/World/Cam", *EXTRA)
    assert main_part == listed("parts", "first", "exr") - VIEW - SPECIAL
    assert ids == listed("parts", "exr") - {"cryptomatte/KEY/…"}


def test_later_parts_have_what_the_page_lists(rendered):
    """Oracle: OpenEXR's reader: of the entries that are not for all parts, only those of dates,
    channels and colours."""
    first, *later = rendered("/World/Cam", "--multipart", *EXTRA)
    assert first == listed("parts", "first", "exr") - VIEW - SPECIAL
    expected = listed("parts", "exr")
    without = expected - {"cryptomatte/KEY/…"}
    assert sorted(later, key=len) == [without, without, expected]


def test_other_cameras_lack_what_the_page_says(rendered):
    """Oracle: OpenEXR's reader, for an orthographic camera and for one that frames the scene."""
    everything = listed("parts", "first", "exr") - VIEW - SPECIAL
    assert rendered("/World/Flat", *EXTRA)[0] == everything - LENS
    shutter = {"expTime", "usdsplat:shutter"}
    assert rendered(None, *EXTRA)[0] == everything - {"aperture", "focus"} - shutter


def test_a_deep_exr_has_what_the_page_lists(rendered):
    """Oracle: OpenEXR's reader: no date, no ids and no Cryptomatte."""
    (found,) = rendered("/World/Cam", "--deep", "--no-compare")
    absent = {"capDate", "usdsplat:ids", "cryptomatte/KEY/…"}
    assert found == listed("parts", "first", "exr") - VIEW - SPECIAL - absent


@pytest.mark.parametrize("camera", ["/World/Cam", "/World/Flat"])
def test_a_png_has_what_the_page_lists(rendered, camera):
    """Oracle: Pillow's reader."""
    absent = {"usdsplat:ids"}
    if camera == "/World/Flat":
        absent |= LENS | {"screenWindowCenter", "screenWindowWidth"}
    assert rendered(camera, suffix="png") == [listed("parts", "first") - VIEW - SPECIAL - absent]


def test_a_view_is_named_with_its_config(rendered):
    """Oracle: OpenEXR's reader; only where the pixels depend on the view."""
    words = ("--config", "ocio://default", "--bake-view")
    assert rendered("/World/Cam", *words)[0] >= VIEW
    assert not VIEW & rendered("/World/Cam", *words[:2])[0]
