"""Tests of the options of `usdsplat render` for the format of files."""

from __future__ import annotations

import numpy as np
import OpenEXR
import pytest
from pxr import Usd, UsdRender

from tests.cli.test_render import SMALL, header, read

pytestmark = pytest.mark.usefixtures("compiled")


@pytest.mark.parametrize(
    "compression", ["none", "rle", "zips", "zip", "zip:9", "piz", "dwaa:45", "dwab"]
)
def test_a_file_has_the_compression_that_is_asked_for(run, shot, tmp_path, compression):
    """Oracle: OpenEXR's reader; depth keeps its bits with every compression."""
    flags = ("--aovs", "color,Z", "--frames", 1, *SMALL)
    assert run("render", shot, "-o", tmp_path / "plain.exr", *flags)[0] == 0
    run("render", shot, "-o", tmp_path / "a.exr", *flags, "--compression", compression)
    found = OpenEXR.File(str(tmp_path / "a.exr")).header()["compression"]
    name = compression.split(":")[0].upper().replace("NONE", "NO")
    assert found == getattr(OpenEXR, f"{name}_COMPRESSION")
    depth, plain = read(tmp_path / "a.exr")[..., 4], read(tmp_path / "plain.exr")[..., 4]
    np.testing.assert_array_equal(depth, plain)


@pytest.mark.parametrize(
    "flags", [(), ("--multipart",), ("--crop", "3,5,45,30"), ("--overscan", 5)]
)
@pytest.mark.parametrize("size", [16, 32, 1000])
def test_tiles_hold_the_same_pixels(run, shot, tmp_path, size, flags):
    """Oracle: the scan lines of the same picture, by OpenImageIO's reader, in every part."""
    words = ("--aovs", "color,Z,id", "--frames", 1, *SMALL, *flags)
    assert run("render", shot, "-o", tmp_path / "lines.exr", *words)[0] == 0
    assert run("render", shot, "-o", tmp_path / "tiles.exr", *words, "--tile-size", size)[0] == 0
    spec = header(tmp_path / "tiles.exr")
    assert (spec.tile_width, spec.tile_height) == (size, size)
    for part in range(3 if "--multipart" in flags else 2):
        kind = "uint" if part else "float"
        both = [read(tmp_path / f"{name}.exr", part, kind) for name in ("lines", "tiles")]
        np.testing.assert_array_equal(*both)


@pytest.mark.parametrize(("choice", "value"), [("inf", np.inf), ("0", 0.0), ("far", 100.0)])
def test_empty_pixels_have_the_depth_that_is_asked_for(run, shot, tmp_path, choice, value):
    """Oracle: the camera's clipping range, 0.1 to 100; other pixels keep their depth."""
    words = ("--aovs", "color,Z,Zfront,Zexp", "--frames", 1, *SMALL)
    assert run("render", shot, "-o", tmp_path / "plain.exr", *words)[0] == 0
    assert run("render", shot, "-o", tmp_path / "a.exr", *words, "--empty-depth", choice)[0] == 0
    plain, found = read(tmp_path / "plain.exr")[..., 4:], read(tmp_path / "a.exr")[..., 4:]
    is_empty = np.isinf(plain)
    assert 0.2 < is_empty.mean() < 0.95
    np.testing.assert_array_equal(found, np.where(is_empty, np.float32(value), plain))
    meaning = header(tmp_path / "a.exr").getattribute("usdsplat:aov:Z")
    assert meaning.endswith(f"; {value:g} in empty pixels")


def test_a_stage_may_state_the_format(run, shot, tmp_path):
    """Oracle: OpenImageIO's header; the attributes of SplatRenderSettingsAPI."""
    stage = Usd.Stage.Open(str(shot))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    prim = settings.GetPrim()
    prim.ApplyAPI("SplatRenderSettingsAPI")
    prim.GetAttribute("splat:compression").Set("piz")
    prim.GetAttribute("splat:tileSize").Set(32)
    prim.GetAttribute("splat:emptyDepth").Set("far")
    product = UsdRender.Product.Define(stage, "/Render/a")
    product.GetProductNameAttr().Set(str(tmp_path / "a.exr"))
    settings.GetProductsRel().AddTarget(product.GetPath())
    stage.GetRootLayer().Save()
    assert run("render", shot, *SMALL)[0] == 0
    spec = header(tmp_path / "a.exr")
    assert (spec.getattribute("compression"), spec.tile_width) == ("piz", 32)


def test_the_old_name_of_the_compression_works(run, shot, tmp_path):
    """Oracle: OpenImageIO's header, and a hint on stderr."""
    words = ("--deep", "--no-compare", "--deep-compression", "zips", *SMALL)
    status, _, err = run("render", shot, "-o", tmp_path / "a.exr", *words)
    assert status == 0
    assert "--deep-compression zips is now --compression zips" in err
    assert header(tmp_path / "a.exr").getattribute("compression") == "zips"
