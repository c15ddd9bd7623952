"""Tests of `usdsplat render` for compositing: AOVs, overscan, holdouts, mattes, samples, memory."""

from __future__ import annotations

import json
import re

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Usd, UsdGeom, UsdRender

from tests.cli.conftest import ball
from tests.cli.test_render import SMALL, header, read
from usdsplat import schema
from usdsplat.images.aovs import AOVS
from usdsplat.images.cryptomatte import object_hash
from usdsplat.images.deep import DeepBand, DeepWriter
from usdsplat.images.layout import ImageLayout

pytestmark = pytest.mark.usefixtures("compiled")


def parts(path):
    """Names of the parts of an EXR, each with its channels."""
    file, found = oiio.ImageInput.open(str(path)), {}
    while file.seek_subimage(len(found), 0):
        spec = file.spec()
        found[spec.getattribute("oiio:subimagename")] = spec.channelnames
    file.geterror()
    file.close()
    return found


@pytest.fixture
def drawn(run, shot, tmp_path):
    """Draw the first frame with flags to a float EXR; returns its pixels."""

    def draw(name, *flags):
        output = ("-o", tmp_path / name, "--frames", 1, "--float", *SMALL)
        status, _, err = run("render", shot, *output, *flags)
        assert (status, err) == (0, "")
        return read(tmp_path / name)

    return draw


def test_every_aov_can_be_asked_for(drawn, tmp_path):
    """Oracle: the table of AOVs: all its channels are there, in one part and one of ids, or in one
    each."""
    names = ",".join(AOVS)
    drawn("a.exr", "--aovs", names, "-q")  # a note says that there are no lights
    drawn("b.exr", "--aovs", names, "--multipart", "-q")
    wanted = sorted(channel for aov in AOVS.values() for channel in aov.channels)
    for name, count in (("a.exr", 2), ("b.exr", 18)):
        found = parts(tmp_path / name)
        assert len(found) == count
        assert sorted(channel for each in found.values() for channel in each) == wanted
    assert header(tmp_path / "a.exr").getattribute("usdsplat:samples") == 1
    assert header(tmp_path / "a.exr").getattribute("usdsplat:exposure") == 1.0


def test_mattes_can_be_read_by_name(drawn, tmp_path):
    """Oracle: the manifest's own hash of the ball's path picks the pixels, whose coverage is A."""
    pixels = drawn("a.exr", "--aovs", "color,cryptoObject")
    entries = {item.name: item.value for item in header(tmp_path / "a.exr").extra_attribs}
    (manifest,) = (json.loads(entries[key]) for key in entries if key.endswith("/manifest"))
    assert list(manifest) == ["/World/Ball"]
    hashed = np.uint32(int(manifest["/World/Ball"], 16)).view(np.float32)
    assert hashed == object_hash("/World/Ball")
    is_ball = pixels[..., 4] == hashed
    np.testing.assert_array_equal(is_ball, pixels[..., 3] > 0)
    np.testing.assert_allclose(pixels[..., 5], pixels[..., 3], atol=1e-5)


def test_overscan_and_crop_are_the_same_pixels(drawn, tmp_path):
    """Oracle: the picture without them, bit for bit; the windows in the header."""
    whole = drawn("a.exr")
    over = drawn("b.exr", "--overscan", "3,2,5,1")
    np.testing.assert_array_equal(over[2:34, 3:51], whole)
    spec = header(tmp_path / "b.exr")
    assert (spec.x, spec.y, spec.width, spec.height) == (-3, -2, 56, 35)
    assert (spec.full_width, spec.full_height) == (48, 32)
    np.testing.assert_array_equal(drawn("c.exr", "--crop", "4,8,20,12"), whole[8:12, 4:20])
    np.testing.assert_array_equal(drawn("d.exr", "--crop", "-3,-2,53,33"), over)


def test_framing_flags_replace_what_the_product_says(run, shot, tmp_path):
    """Oracle: the header, the aperture's own window (20.955 x 15.2908) conformed by hand."""
    stage = Usd.Stage.Open(str(shot))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    product = UsdRender.Product.Define(stage, "/Render/one")
    product.GetAspectRatioConformPolicyAttr().Set("expandAperture")
    product.GetPixelAspectRatioAttr().Set(1.0)
    product.GetDataWindowNDCAttr().Set(Gf.Vec4f(0, 0, 0.5, 0.5))
    settings.GetProductsRel().AddTarget(product.GetPath())
    stage.GetRootLayer().Save()
    flags = ("--conform", "adjustApertureHeight", "--pixel-aspect", "2", "--crop", "1,2,3,4")
    assert run("render", shot, "-o", tmp_path / "a.exr", "--frames", 1, *flags, *SMALL)[0] == 0
    spec = header(tmp_path / "a.exr")
    assert (spec.x, spec.y, spec.width, spec.height) == (1, 2, 2, 2)
    assert spec.getattribute("PixelAspectRatio") == 2.0
    width = spec.getattribute("screenWindowWidth")
    assert width == pytest.approx(20.955 / 50, rel=1e-4)


def test_a_flat_holdout_hides_what_is_behind_it(drawn, tmp_path):
    """Oracle: a depth of 3 in the left half hides all of the ball there, which is at 4, and nothing
    in the right half."""
    whole = drawn("a.exr")
    spec = oiio.ImageSpec(48, 32, 1, "float")
    spec.channelnames = ("Z",)
    depth = np.full((32, 48, 1), np.inf, np.float32)
    depth[:, :24] = 3.0
    file = oiio.ImageOutput.create("openexr")
    file.open(str(tmp_path / "z.0001.exr"), spec)
    file.write_image(depth)
    file.close()
    held = drawn("b.exr", "--holdout", tmp_path / "z.####.exr")
    assert whole[:, :24, 3].max() > 0.9
    assert held[:, :24].max() == 0
    np.testing.assert_allclose(held[:, 24:], whole[:, 24:], atol=1e-6)


def test_a_deep_holdout_lets_through_what_it_does_not_cover(drawn, tmp_path):
    """Oracle: a veil of opacity one half in front of everything halves it."""
    whole = drawn("a.exr", "--blend-space", "linear")
    layout = ImageLayout(resolution=(48, 32), pixel_type="float")
    n = 48 * 32
    veil = DeepBand(
        counts=np.ones((32, 48), np.uint32),
        depth=np.full(n, 1, np.float32),
        depth_back=np.full(n, 1, np.float32),
        color=np.full((n, 4), 0.5, np.float32),
    )
    with DeepWriter(tmp_path / "veil.exr", layout) as writer:
        writer.write_band(0, veil)
    held = drawn("b.exr", "--blend-space", "linear", "--holdout", tmp_path / "veil.exr")
    np.testing.assert_allclose(held, 0.5 * whole, atol=2e-3)


def test_what_is_matte_is_not_in_the_picture(run, shot, tmp_path, drawn):
    """Oracle: the ball alone; a second one behind it, then matte, leaves it as it is, and takes the
    place of nothing where it is alone."""
    alone = drawn("a.exr")
    stage = Usd.Stage.Open(str(shot))
    prim = schema.author(stage, "/World/Behind", ball(100, seed=1))
    UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(0.3, 0, -2))
    stage.GetRootLayer().Save()
    np.testing.assert_allclose(drawn("b.exr", "--matte", "/World/Behind"), alone, atol=2e-3)
    assert drawn("c.exr", "--matte", "/World/Ball,/World/Behind").max() == 0


def test_a_lens_and_a_shutter_are_spoken_of_once(run, shot, tmp_path):
    """Oracle: one remark for four frames; none with samples, or without what blurs."""
    stage = Usd.Stage.Open(str(shot))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Cam"))
    camera.GetShutterCloseAttr().Set(0.5)
    camera.GetFStopAttr().Set(32.0)
    camera.GetFocusDistanceAttr().Set(4.0)
    stage.GetRootLayer().Save()
    output = ("-o", tmp_path / "a.%d.png", *SMALL)
    sentence = (
        "found one sample, which does not show the blur of the shutter and lens, expected several, "
        "for example --samples 64"
    )
    said = run("render", shot, *output)[2]
    assert said == f"usdsplat: note [no-blur] /World/Cam: {sentence}\n"
    assert run("render", shot, *output, "--samples", 2)[2] == ""
    flags = ("--no-motion-blur", "--no-depth-of-field")
    assert run("render", shot, *output, *flags)[2] == ""


def test_a_memory_limit_changes_no_pixel(run, shot, drawn, tmp_path):
    """Oracle: the picture without one, and numbers of one remark that add up to what it says."""
    whole = drawn("a.exr")
    output = ("-o", tmp_path / "b.exr", "--frames", 1, "--float", *SMALL)
    status, _, err = run("render", shot, *output, "--memory-limit", "20G")
    assert status == 0
    np.testing.assert_array_equal(read(tmp_path / "b.exr"), whole)
    numbers = [
        float(size) * (1024 if unit == "G" else 1)
        for size, unit in re.findall(r"([\d.]+) ([GM])iB", err)
    ]
    assert len(numbers) == 4
    assert numbers[0] == pytest.approx(sum(numbers[1:]), rel=0.02)
    assert err.endswith("for a band of 32 rows\n")


def test_too_little_memory_is_refused_with_the_number(run, shot, tmp_path):
    """Oracle: the sentence; no file is left."""
    output = ("-o", tmp_path / "a.exr", "--frames", 1, *SMALL)
    status, _, err = run("render", shot, *output, "--memory-limit", "10M")
    assert status == 2
    expected = (
        r"usdsplat: --memory-limit: found 10 MiB, expected [\d.]+ [MG]iB or more for 48x32 .*"
    )
    assert re.fullmatch(expected, err.strip())
    assert not (tmp_path / "a.exr").exists()


@pytest.mark.parametrize(
    ("argv", "sentence"),
    [
        (["--conform", "x"], "--conform: found 'x', expected one of expandAperture"),
        (["--pixel-aspect", "0"], "--pixel-aspect: found 0, expected 0.01 to 100"),
        (["--crop", "0,0,9"], "--crop: found '0,0,9', expected four whole numbers"),
        (["--crop", "0,0,70000,1"], "--resolution: found 70000x1, expected at most 65536"),
        (["--overscan", "x"], "--overscan: found 'x', expected 1, 2 or 4 whole numbers"),
        (["--overscan", "1", "--crop", "0,0,1,1"], "--crop: found --overscan too, expected one"),
        (["--memory-limit", "x"], "--memory-limit: found 'x', expected bytes such as 800M"),
        (["--holdout", "no.exr"], "--holdout: found no file no.exr, expected an EXR with depth"),
        (["--holdout", "shot.usda"], "shot.usda: found"),
        (["--matte", "/No"], "--matte: found '/No', expected the path of a prim"),
        (["--matte", "x y"], "--matte: found 'x y', expected the path of a prim"),
        (["--samples", "0"], "--samples: found 0, expected 1 to 4096"),
        (["--pixel-filter", "x"], "--pixel-filter: found 'x', expected one of box"),
        (["--filter-width", "99"], "--filter-width: found 99.0, expected 0 to 16 [pixel]"),
        (["--refinement", "9"], "--refinement: found 9, expected 0 to 5"),
        (["--blend-space", "x"], "--blend-space: found 'x', expected one of auto, linear"),
        (
            ["--multipart", "--no-multipart"],
            "render: found --multipart and --no-multipart, expected",
        ),
    ],
)
def test_what_cannot_be_asked_for_is_one_sentence(run, shot, monkeypatch, argv, sentence):
    """Oracle: where: found X, expected Y; status 2; no file is left."""
    monkeypatch.chdir(shot.parent)
    before = sorted(shot.parent.iterdir())
    status, out, err = run("render", shot, "-o", "a.exr", *SMALL, *argv)
    assert (status, out) == (2, "")
    assert err.startswith(f"usdsplat: {sentence}")
    assert len(err.splitlines()) == 1
    assert sorted(shot.parent.iterdir()) == before


def test_vars_say_how_precise_an_exr_is_and_nothing_of_a_png(run, shot, tmp_path):
    """Oracle: the prims: float, unless a flag says half; a PNG has 8 bits whatever they say."""
    stage = Usd.Stage.Open(str(shot))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    var = UsdRender.Var.Define(stage, "/Render/color")
    var.GetDataTypeAttr().Set("color4f")
    for suffix in ("exr", "png"):
        product = UsdRender.Product.Define(stage, f"/Render/{suffix}")
        product.GetProductNameAttr().Set(str(tmp_path / f"a.{suffix}"))
        product.GetOrderedVarsRel().AddTarget(var.GetPath())
        settings.GetProductsRel().AddTarget(product.GetPath())
    var.GetSourceNameAttr().Set("Ci")
    stage.GetRootLayer().Save()
    assert run("render", shot, "--frames", 1, *SMALL)[0] == 0
    assert (header(tmp_path / "a.exr").format, header(tmp_path / "a.png").format) == (
        "float",
        "uint8",
    )
    flags = ("--product", "/Render/exr", "--half", "--frames", 1)
    assert run("render", shot, *flags, *SMALL)[0] == 0
    assert header(tmp_path / "a.exr").format == "half"
