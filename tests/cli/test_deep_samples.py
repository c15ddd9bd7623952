"""Tests of `usdsplat render --deep` with samples, ids and Cryptomattes, by OpenImageIO's reading.

The shot has two balls, one of them instanced, a wall behind, a bar that passes in front of one,
and a camera with a shutter and a lens; the first ball moves.
"""

from __future__ import annotations

import json

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Usd, UsdGeom, UsdRender

from tests.cli.conftest import ball
from tests.cli.test_render import SMALL, header, read
from usdsplat import schema
from usdsplat.images.deep import DeepBand, DeepWriter
from usdsplat.images.layout import ImageLayout
from usdsplat.render import memory

pytestmark = pytest.mark.usefixtures("compiled")
BLURRED = ("--frames", 2, "--samples", 16, "--pixel-filter", "gaussian", "--no-compare")
IDS = ("--aovs", "color,id,instanceId,splatId,cryptoObject")


def quad(stage, path, size, depth):
    """A mesh: a rectangle that faces the camera."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    x, y = size
    mesh.GetPointsAttr().Set([(-x, -y, depth), (x, -y, depth), (x, y, depth), (-x, y, depth)])
    mesh.GetFaceVertexCountsAttr().Set([4])
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3])
    mesh.GetSubdivisionSchemeAttr().Set("none")
    mesh.GetDisplayColorAttr().Set([(0.7, 0.4, 0.2)])


@pytest.fixture
def blurred(shot):
    """The shot with all of this."""
    stage = Usd.Stage.Open(str(shot))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Cam"))
    camera.GetShutterOpenAttr().Set(-0.5)
    camera.GetShutterCloseAttr().Set(0.5)
    camera.GetFStopAttr().Set(20)
    camera.GetFocusDistanceAttr().Set(4)
    quad(stage, "/World/Wall", (0.8, 0.5), -0.6)
    quad(stage, "/World/Bar", (0.05, 2), 0.3)
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Many")
    schema.author(stage, "/World/Many/Small", ball(80, seed=3))
    instancer.GetPrototypesRel().AddTarget("/World/Many/Small")
    instancer.GetProtoIndicesAttr().Set([0, 0])
    instancer.GetPositionsAttr().Set([Gf.Vec3f(-0.7, 0.2, -0.2), Gf.Vec3f(0.7, -0.2, 0.4)])
    stage.GetRootLayer().Save()
    return shot


def flattened(path):
    """RGBA of a deep file, composited by OpenImageIO."""
    flat = oiio.ImageBufAlgo.flatten(oiio.ImageBuf(str(path)))
    names = list(flat.spec().channelnames)
    return flat.get_pixels(oiio.FLOAT)[..., [names.index(c) for c in "RGBA"]]


def decibels(found, expected):
    return -10 * np.log10(np.mean((found.astype(np.float64) - expected) ** 2))


def samples_of(path):
    """Values of each sample by channel, the pixel of each, and the weight of each in its pixel."""
    file = oiio.ImageInput.open(str(path))
    data = file.read_native_deep_image()
    file.close()
    counts = np.array([data.samples(pixel) for pixel in range(data.pixels)])
    values = {}
    for channel in range(data.channels):
        is_id = str(data.channeltype(channel)) == "uint"
        get = data.deep_value_uint if is_id else data.deep_value
        values[data.channelname(channel)] = np.array(
            [get(p, channel, k) for p, count in enumerate(counts) for k in range(count)]
        )
    pixel = np.repeat(np.arange(len(counts)), counts)
    weight, j = np.zeros(len(pixel)), 0
    for count in counts:
        through = 1.0
        for _ in range(count):
            weight[j] = through * values["A"][j]
            through *= 1 - values["A"][j]
            j += 1
    return values, pixel, weight


@pytest.mark.parametrize("sorting", ["zDepth", "rayHitDistance"])
@pytest.mark.parametrize(
    "flags",
    [(), ("--deep-error", "0.01"), (*IDS, "--deep-error", "0.01"), ("--crop", "7,3,41,30")],
)
@pytest.mark.parametrize("holdout", ["", "flat", "deep"])
def test_it_flattens_to_the_flat_picture_of_the_same_samples(
    run, blurred, tmp_path, sorting, flags, holdout
):
    """Blurred by shutter, lens and filter; a half file. Oracle: the flat picture, blended in the
    same space, 60 dB or more; one sample is far from it."""
    given = ("--sorting", sorting, *SMALL)
    if holdout:
        band = DeepBand(
            counts=np.ones((32, 48), np.uint32),
            depth=np.full(48 * 32, 4.0, np.float32),
            depth_back=np.full(48 * 32, 4.0, np.float32),
            color=np.full((48 * 32, 4), 0.4, np.float32),
        )
        with DeepWriter(tmp_path / "cg.exr", ImageLayout(resolution=(48, 32))) as writer:
            writer.write_band(0, band)
        flat_cg = oiio.ImageBufAlgo.flatten(oiio.ImageBuf(str(tmp_path / "cg.exr")))
        if holdout == "flat":
            flat_cg.write(str(tmp_path / "cg.exr"))
        given += ("--holdout", tmp_path / "cg.exr")
    crop = flags if "--crop" in flags else ()
    deep = ("render", blurred, "-o", tmp_path / "d.exr", "--deep", *flags, *given)
    flat = ("render", blurred, "-o", tmp_path / "f.exr", "--blend-space", "linear", *crop, *given)
    assert run(*deep, *BLURRED)[0] == 0
    assert run(*flat, "--float", *BLURRED)[0] == 0
    found, expected = flattened(tmp_path / "d.exr"), read(tmp_path / "f.exr")
    assert expected[..., 3].max() > 0.5
    assert decibels(found, expected) > 60
    if not (flags or holdout):
        assert run(*deep, *BLURRED, "--samples", 1)[0] == 0
        assert decibels(flattened(tmp_path / "d.exr"), expected) < 45


def test_overscan_of_the_beauty_flattens_to_the_flat_picture(run, blurred, tmp_path, monkeypatch):
    """Where bands begin above row 0, in memory that allows several bands. Oracle: the flat
    picture, 60 dB or more."""
    monkeypatch.setattr(memory, "resident", lambda: 300 << 20)
    flags = ("--overscan", 8, "--samples", 4, "--frames", 2, "--resolution", "96x64")
    beauty = ("--deep", "--deep-color", "beauty", "--memory-limit", "420M")
    deep, flat = tmp_path / "d.exr", tmp_path / "f.exr"
    assert run("render", blurred, "-o", deep, *beauty, *flags)[0] == 0
    assert run("render", blurred, "-o", flat, "--float", *flags)[0] == 0
    found, expected = flattened(deep), read(flat)
    assert found.shape == expected.shape == (80, 112, 4)
    assert decibels(found, expected) > 60


def test_each_sample_says_what_it_is_of(run, blurred, tmp_path):
    """Oracle: the header's tables; the weights of a prim's samples sum to its coverage in the flat
    picture's Cryptomatte, whose hashes are those of the samples; rows of arrays."""
    flags = (*IDS, *SMALL, *BLURRED, "--float")
    assert run("render", blurred, "-o", tmp_path / "d.exr", "--deep", *flags)[0] == 0
    assert run("render", blurred, "-o", tmp_path / "f.exr", *flags)[0] == 0
    values, pixel, weight = samples_of(tmp_path / "d.exr")
    entries = {item.name: item.value for item in header(tmp_path / "d.exr").extra_attribs}
    flat_entries = {item.name: item.value for item in header(tmp_path / "f.exr").extra_attribs}
    for name, value in flat_entries.items():
        if name.startswith("cryptomatte/"):
            assert entries[name] == value
    (manifest,) = (json.loads(entries[key]) for key in entries if key.endswith("/manifest"))
    paths = json.loads(entries["usdsplat:ids"])
    assert sorted(manifest) == sorted(paths) and len(paths) == 4
    mattes = read(tmp_path / "f.exr")[..., 4:].reshape(-1, 6, 2)
    ids = values["id"].astype(int)
    for number, path in enumerate(paths):
        hashed = np.uint32(int(manifest[path], 16)).view(np.float32)
        is_path = ids == number
        np.testing.assert_array_equal(np.float32(values["cryptoObject00.R"]) == hashed, is_path)
        found = np.bincount(pixel[is_path], weight[is_path], 48 * 32)
        expected = np.where(mattes[..., 0] == hashed, mattes[..., 1], 0).sum(axis=1)
        assert expected.max() > 0.1
        np.testing.assert_allclose(found, expected, atol=1e-4)
    np.testing.assert_array_equal(values["cryptoObject00.G"], values["A"])
    assert not values["cryptoObject00.B"].any() and not values["cryptoObject00.A"].any()
    assert "cryptoObject01.R" not in values
    many = ids == paths.index("/World/Many/Small")
    assert set(values["instanceId"][many]) == {0, 1}
    assert values["splatId"][many].max() < 80 < values["splatId"][~many].max() < 300


def test_the_matte_of_a_prim_is_that_of_its_samples(run, blurred, tmp_path):
    """As a compositor makes it: opacity where the hash is the prim's, flattened. Oracle: the
    picture's own A, where the others are mattes that are not drawn."""
    flags = (*SMALL, *BLURRED, "--float", "--deep")
    aovs = ("--aovs", "cryptoObject")
    assert run("render", blurred, "-o", tmp_path / "d.exr", *aovs, *flags)[0] == 0
    values, pixel, weight = samples_of(tmp_path / "d.exr")
    (manifest,) = (
        json.loads(item.value)
        for item in header(tmp_path / "d.exr").extra_attribs
        if item.name.endswith("/manifest")
    )
    hashed = np.uint32(int(manifest["/World/Ball"], 16)).view(np.float32)
    is_ball = np.float32(values["cryptoObject00.R"]) == hashed
    found = np.bincount(pixel[is_ball], weight[is_ball], 48 * 32).reshape(32, 48)
    others = "/World/Many,/World/Wall,/World/Bar"
    alone = ("render", blurred, "-o", tmp_path / "a.exr", "--matte", others)
    assert run(*alone, *flags)[0] == 0
    np.testing.assert_allclose(found, flattened(tmp_path / "a.exr")[..., 3], atol=1e-4)
    assert found.max() > 0.5


def test_a_product_and_its_settings_may_ask_for_all_of_it(run, blurred, tmp_path):
    """Oracle: the file of the flags, byte for byte but for its header."""
    stage = Usd.Stage.Open(str(blurred))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    product = UsdRender.Product.Define(stage, "/Render/deep")
    settings.GetPrim().AddAppliedSchema("SplatRenderSettingsAPI")
    settings.GetPrim().GetAttribute("splat:samples").Set(8)
    settings.GetPrim().GetAttribute("splat:tileSize").Set(32)
    product.GetProductTypeAttr().Set("deepRaster")
    product.GetProductNameAttr().Set(str(tmp_path / "p.exr"))
    settings.GetProductsRel().AddTarget(product.GetPath())
    for name in ("Ci", "primId", "elementId"):
        var = UsdRender.Var.Define(stage, f"/Render/{name}")
        var.GetSourceNameAttr().Set(name)
        product.GetOrderedVarsRel().AddTarget(var.GetPath())
    stage.GetRootLayer().Save()
    given = ("--camera", "/World/Cam", *SMALL, "--no-compare", "--frames", 2)
    status, _, err = run("render", blurred, *given)
    assert status == 0
    assert (
        "note [deep-settings] /Render/deep: found splat:tileSize 32, expected none of these; "
        "they have no effect on a deep picture" in err
    )
    flags = ("--deep", "--samples", 8, "--aovs", "color,id,splatId")
    assert run("render", blurred, "-o", tmp_path / "f.exr", *flags, *given)[0] == 0
    found, expected = (samples_of(tmp_path / name)[0] for name in ("p.exr", "f.exr"))
    assert list(found) == ["R", "G", "B", "A", "Z", "id", "splatId"]
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)
    assert header(tmp_path / "p.exr").getattribute("usdsplat:samples") == 8


@pytest.mark.parametrize(
    ("flags", "found"),
    [
        (("--color-mode", "display"), "splat:colorMode display"),
        (("--color-mode", "scene", "--empty-depth", "far"), "splat:emptyDepth far"),
        (("--multipart",), "splat:multipart True"),
        (("--tile-size", "32", "--inverse-max", "9"), "splat:inverseMax 9, splat:tileSize 32"),
        (("--config", "ocio://default"), "splat:ocioConfig ocio://default"),
        (("--crypto-rank", "4"), "splat:cryptoRank 4"),
        ((), ""),
    ],
)
def test_flags_without_effect_are_said(run, shot, tmp_path, flags, found):
    """Oracle: the sentence, and the bytes of a file that was made without them."""
    given = ("--deep", "--no-compare", "--frames", 1, *SMALL)
    status, _, err = run("render", shot, "-o", tmp_path / "a.exr", *flags, *given)
    assert status == 0
    if not found:
        assert "deep-settings" not in err
        return
    assert f"note [deep-settings] render: found {found}, expected none of these" in err
    assert "unused-view" not in err
    assert run("render", shot, "-o", tmp_path / "b.exr", *given)[0] == 0
    ours, theirs = (samples_of(tmp_path / name)[0] for name in ("a.exr", "b.exr"))
    for name, values in theirs.items():
        np.testing.assert_array_equal(ours[name], values)


def test_flags_of_deep_pictures_are_said_of_flat_ones(run, shot, tmp_path):
    """Oracle: the sentence, once; a deep picture, and default values, are no reason for it."""
    flags = ("--deep-color", "beauty", "--deep-error", "0.01", "--frames", 1, *SMALL)
    status, _, err = run("render", shot, "-o", tmp_path / "a.exr", *flags)
    assert status == 0 and err.count("flat-settings") == 1
    found = "splat:deepError 0.01, splat:deepColor beauty"
    assert f"note [flat-settings] render: found {found}, expected none of these" in err
    assert "they have no effect on a flat picture" in err
    for other in (("--deep", "--no-compare"), ("--deep-color", "scene", "--deep-error", "0")):
        status, _, err = run("render", shot, "-o", tmp_path / "a.exr", *flags, *other)
        assert status == 0 and "flat-settings" not in err


@pytest.mark.parametrize("on", ["settings", "product", "deep product"])
def test_settings_of_deep_pictures_are_said_of_flat_products_that_author_them(
    run, shot, tmp_path, on
):
    """A RenderSettings with a flat and a deep product. Oracle: the product's path, if it authors
    the value itself; a flag may be meant for the deep one."""
    stage = Usd.Stage.Open(str(shot))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    for name, kind in (("flat", "raster"), ("deep", "deepRaster")):
        product = UsdRender.Product.Define(stage, f"/Render/{name}")
        product.GetProductTypeAttr().Set(kind)
        product.GetProductNameAttr().Set(str(tmp_path / f"{name}.exr"))
        settings.GetProductsRel().AddTarget(product.GetPath())
    path = {"settings": "/Render/Main", "product": "/Render/flat", "deep product": "/Render/deep"}
    prim = stage.GetPrimAtPath(path[on])
    prim.AddAppliedSchema("SplatRenderSettingsAPI")
    prim.GetAttribute("splat:deepError").Set(0.01)
    stage.GetRootLayer().Save()
    given = ("--camera", "/World/Cam", *SMALL, "--no-compare", "--frames", 1)
    status, _, err = run("render", shot, *given)
    assert status == 0
    found = "note [flat-settings] /Render/flat: found splat:deepError 0.01" in err
    assert (found, err.count("flat-settings")) == ((True, 1) if on == "product" else (False, 0))
    status, _, err = run("render", shot, *given, "--deep-error", "0.02")
    assert status == 0 and "flat-settings" not in err


def test_blur_that_is_left_out_or_too_wide_is_said_of_deep_pictures_too(run, blurred, tmp_path):
    """Oracle: the findings on flat pictures."""
    stage = Usd.Stage.Open(str(blurred))
    UsdGeom.Camera(stage.GetPrimAtPath("/World/Cam")).GetFStopAttr().Set(0.5)
    stage.GetRootLayer().Save()
    for samples, code in ((1, "note [no-blur]"), (2, "warning [wide-lens]")):
        said = []
        for flags in ((), ("--deep", "--no-compare")):
            given = ("--samples", samples, "--frames", 1, *SMALL, *flags)
            status, _, err = run("render", blurred, "-o", tmp_path / "a.exr", *given)
            assert status == 0
            said.append([line for line in err.splitlines() if code in line])
        assert said[0] == said[1] and len(said[0]) == 1


def test_little_memory_changes_no_sample(run, blurred, tmp_path, monkeypatch):
    """Oracle: the file drawn without a limit; a limit that is too low says so."""
    monkeypatch.setattr(memory, "resident", lambda: 300 << 20)
    given = ("render", blurred, "--deep", "--aovs", "id", *BLURRED, "--resolution", "96x64")
    assert run(*given, "-o", tmp_path / "a.exr")[0] == 0
    assert run(*given, "-o", tmp_path / "b.exr", "--memory-limit", "420M")[0] == 0
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    status, _, err = run(*given, "-o", tmp_path / "c.exr", "--memory-limit", "100M")
    assert status == 2 and "--memory-limit: found 100 MiB, expected" in err
