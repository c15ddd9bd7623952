"""Tests of `usdsplat render`, from the command line to the pixels of files."""

from __future__ import annotations

import json
import re

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdRender

from tests.cli.conftest import ball
from tests.cli.test_main import shell
from usdsplat import schema
from usdsplat.delegate.engine import Engine
from usdsplat.images.color import convert
from usdsplat.render.settings import RenderSettings

SMALL = ("--resolution", "48x32")


def read(path, subimage=0, kind="float"):
    """All channels of one part of a file, by OpenImageIO's reader, alpha as it is in the file."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(str(path), config)
    file.seek_subimage(subimage, 0)
    count = file.spec().nchannels
    pixels = file.read_image(subimage, 0, 0, count, kind)
    file.close()
    return pixels


def header(path):
    file = oiio.ImageInput.open(str(path))
    spec = file.spec()
    file.close()
    return spec


pytestmark = pytest.mark.usefixtures("compiled")


@pytest.fixture
def pictured(shot):
    """What the engine draws of the shot at a frame, in memory."""

    def picture(frame, camera="/World/Cam", resolution=(48, 32), **settings):
        with Engine(Usd.Stage.Open(str(shot)), time=frame) as engine:
            view = engine.view(camera, resolution=resolution)
            aovs = ("color", "depth", "primId", "elementId")
            found = engine.picture(view, RenderSettings(**settings), aovs)
            return {name: array.copy() for name, array in found.items()}

    return picture


def test_an_exr_holds_what_the_engine_draws(run, shot, tmp_path, pictured):
    """Oracle: the engine's own arrays; ids are the same 32 bits, -1 where nothing is."""
    out = tmp_path / "a.exr"
    status, printed, err = run(
        "render", shot, "-o", out, "--frames", 3, *SMALL, "--float", "--color-mode", "display",
        "--aovs", "color,Z,id,splatId",
    )  # fmt: skip
    assert (status, printed, err) == (0, f"{out}\n", "")
    expected = pictured(3.0, color_mode="display")
    main, ids = read(out), read(out, 1, "uint")
    assert expected["color"][..., 3].max() > 0.9
    np.testing.assert_array_equal(main[..., :4], expected["color"])
    np.testing.assert_array_equal(main[..., 4], expected["depth"])
    np.testing.assert_array_equal(ids[..., 0], expected["primId"].view(np.uint32))
    np.testing.assert_array_equal(ids[..., 1], expected["elementId"].view(np.uint32))
    assert ids.max() == 2**32 - 1


def test_exr_is_linear_and_png_is_what_a_viewer_shows(run, shot, tmp_path, pictured):
    """Oracle: the engine's display picture, by hand: straight 8 bits, and decoded to linear."""
    for name in ("a.png", "a.exr"):
        assert run("render", shot, "-o", tmp_path / name, "--frames", 1, *SMALL)[0] == 0
    color = pictured(1.0, color_mode="display")["color"]
    alpha = color[..., 3:]
    straight = color[..., :3] / np.maximum(alpha, 1e-9)
    expected = np.floor(np.clip(np.concatenate([straight, alpha], 2), 0, 1) * 255 + 0.5)
    png = read(tmp_path / "a.png", kind="uint8")
    assert np.abs(png.astype(int) - expected.astype(int)).max() <= 1
    assert np.mean(png != expected) < 0.001
    linear = convert(straight, "srgb_rec709_scene", "lin_rec709_scene") * alpha
    exr = read(tmp_path / "a.exr")
    np.testing.assert_allclose(exr[..., :3], linear, rtol=2e-3, atol=1e-3)
    assert header(tmp_path / "a.exr").channelformats == ()
    assert header(tmp_path / "a.exr").format == "half"


def test_the_header_says_how_it_was_drawn(run, shot, tmp_path):
    """Oracle: the stage and the flags; a point of the ball lands where worldToNDC says."""
    flags = ("--frames", 2, "--aovs", "color,id", "--sorting", "cameraDistance")
    flags += ("--rasterize-mode", "antialiased")
    assert run("render", shot, "-o", tmp_path / "a.exr", *flags, *SMALL)[0] == 0
    spec = header(tmp_path / "a.exr")
    entries = {item.name: item.value for item in spec.extra_attribs}
    assert entries["usdsplat:stage"] == str(shot)
    assert entries["usdsplat:frame"] == 2.0
    assert entries["usdsplat:camera"] == "/World/Cam"
    assert entries["usdsplat:sorting"] == "cameraDistance"
    assert entries["usdsplat:rasterizeMode"] == "antialiased"
    assert entries["usdsplat:colorMode"] == "scene"
    assert json.loads(entries["usdsplat:ids"]) == ["/World/Ball"]
    u, v, _, w = [0.2, 0, 0, 1] @ np.reshape(entries["worldToNDC"], (4, 4))
    covered = np.argwhere(read(tmp_path / "a.exr")[..., 3] > 0.5)
    middle = (covered.mean(axis=0) + 0.5) / (32, 48)
    np.testing.assert_allclose([v / w, u / w], middle, atol=0.02)


def test_a_sequence_is_one_file_a_frame(run, run_json, shot, tmp_path, pictured):
    """Oracle: the engine at each frame; without --frames the stage's range is drawn."""
    drawn = run_json("render", shot, "-o", tmp_path / "a.###.exr", *SMALL, "--float")["pictures"]
    assert [item["frame"] for item in drawn] == [1, 2, 3, 4]
    assert [item["splats"] for item in drawn] == [300] * 4
    for item in drawn:
        expected = pictured(item["frame"], color_mode="scene")["color"]
        np.testing.assert_array_equal(read(item["path"]), expected)
    status, out, _ = run("render", shot, "-o", tmp_path / "b.###.png", "--frames", "4-1x3", *SMALL)
    assert status == 0
    assert out.splitlines() == [str(tmp_path / "b.004.png"), str(tmp_path / "b.001.png")]


def test_a_capture_is_framed_by_a_camera_of_its_own(run_json, capture, tmp_path):
    """Oracle: the ball is whole: edges of the picture have nothing but its soft end, and it fills
    most of the height."""
    words = ("-o", tmp_path / "a.png", "--background", "transparent", *SMALL)
    (item,) = run_json("render", capture, *words)["pictures"]
    assert item["camera"] is None
    alpha = read(item["path"])[..., 3]
    edges = (alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1])
    assert max(edge.max() for edge in edges) < 0.15
    assert (alpha > 0.5).any(axis=1).sum() > 0.75 * 32


@pytest.fixture
def moving(tmp_path):
    """A ball that moves five units in three frames, and no camera."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "moving.usda"))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(3)
    move = UsdGeom.Xformable(schema.author(stage, "/Ball", ball())).AddTranslateOp()
    for frame, x in ((1, 0), (3, 5)):
        move.Set(Gf.Vec3d(x, 0, 0), frame)
    stage.GetRootLayer().Save()
    return tmp_path / "moving.usda"


def test_a_camera_that_frames_a_sequence_stands_still(run_json, moving, tmp_path):
    """Oracle: one matrix in all headers; the ball is whole in every frame and moves to the right
    by more than its own size; a run that resumes sees the same."""
    drawn = run_json("render", moving, "-o", tmp_path / "a.%d.exr", *SMALL)["pictures"]
    pictures = [read(item["path"])[..., 3] for item in drawn]
    matrices = {header(item["path"]).getattribute("worldToCamera") for item in drawn}
    assert (len(drawn), len(matrices)) == (3, 1)
    middles = [np.argwhere(alpha > 0.5).mean(axis=0)[1] for alpha in pictures]
    assert middles[0] + 8 < middles[1] < middles[2] - 8
    for alpha in pictures:
        assert max(edge.max() for edge in (alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1])) < 0.05
    (tmp_path / "a.3.exr").unlink()
    (again,) = run_json("render", moving, "-o", tmp_path / "a.%d.exr", *SMALL, "--resume")[
        "pictures"
    ]
    np.testing.assert_array_equal(read(again["path"])[..., 3], pictures[2])


def test_the_frame_of_a_capture_can_be_told(run, run_json, capture, tmp_path):
    """Oracle: a picture in the frame rub is the stage's own way up, and the other one upside down,
    so that they differ; a stage defines its own axes."""
    for frame in ("rdf", "rub"):
        run_json("render", capture, "-o", tmp_path / f"{frame}.png", *SMALL, "--axes", frame)
    run_json("render", capture, "-o", tmp_path / "own.png", *SMALL)
    told, other, own = (read(tmp_path / f"{name}.png") for name in ("rdf", "rub", "own"))
    np.testing.assert_array_equal(told, own)
    assert not np.array_equal(told, other)
    run("convert", capture, tmp_path / "a.usda")
    status, _, err = run("render", tmp_path / "a.usda", "-o", tmp_path / "a.png", "--axes", "rub")
    assert status == 2
    expected = "--axes: found a stage, which defines its own axes, expected a capture"
    assert err == f"usdsplat: {expected}\n"


def test_a_camera_goes_by_name_or_path(run, run_json, shot, tmp_path):
    """Oracle: the path in the report; a name that two cameras have is refused with both paths."""
    output = ("-o", tmp_path / "a.png", *SMALL)
    for name in ("Cam", "/World/Cam"):
        assert (
            run_json("render", shot, "--camera", name, *output)["pictures"][0]["camera"]
            == "/World/Cam"
        )
    stage = Usd.Stage.Open(str(shot))
    UsdGeom.Camera.Define(stage, "/Other/Cam")
    stage.GetRootLayer().Save()
    status, _, err = run("render", shot, "--camera", "Cam", *output)
    assert status == 2
    assert "--camera: found 'Cam', expected one of /Other/Cam, /World/Cam" in err


@pytest.fixture
def products(shot, tmp_path):
    """The shot with settings and two products: a half-size EXR with depth and a PNG."""
    stage = Usd.Stage.Open(str(shot))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    settings.GetResolutionAttr().Set(Gf.Vec2i(40, 20))
    settings.GetCameraRel().SetTargets(["/World/Cam"])
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Main")
    for name, suffix, sources in (("deep", "exr", ("Ci", "depth")), ("look", "png", ("Ci",))):
        product = UsdRender.Product.Define(stage, f"/Render/{name}")
        product.GetProductNameAttr().Set(str(tmp_path / f"{name}.####.{suffix}"))
        for source in sources:
            var = UsdRender.Var.Define(stage, f"/Render/{name}/{source}")
            var.GetSourceNameAttr().Set(source)
            product.GetOrderedVarsRel().AddTarget(var.GetPath())
        settings.GetProductsRel().AddTarget(product.GetPath())
    stage.GetPrimAtPath("/Render/look").GetAttribute("resolution").Set(Gf.Vec2i(20, 10))
    stage.GetRootLayer().Save()
    return shot


def test_a_stages_products_drive(run_json, products, tmp_path):
    """Oracle: the prims: two files a frame, each of the size and contents that its prim says."""
    drawn = run_json("render", products, "--frames", "1-2")["pictures"]
    assert [(item["path"].rsplit("/", 1)[-1], item["resolution"]) for item in drawn] == [
        ("deep.0001.exr", [40, 20]),
        ("look.0001.png", [20, 10]),
        ("deep.0002.exr", [40, 20]),
        ("look.0002.png", [20, 10]),
    ]
    named = [(item["product"], item["aovs"], item["device"]) for item in drawn[:2]]
    assert named == [
        ("/Render/deep", ["color", "Z"], "cpu"),
        ("/Render/look", ["color"], "cpu"),
    ]
    assert header(tmp_path / "deep.0001.exr").channelnames == ("R", "G", "B", "A", "Z")
    assert read(tmp_path / "look.0002.png").shape == (10, 20, 4)


def test_a_file_that_is_named_gets_the_first_product(run_json, products, tmp_path):
    """Oracle: the order of the settings' relationship, which begins with /Render/deep, 40 x 20."""
    (item,) = run_json("render", products, "-o", tmp_path / "a.exr", "--frames", 1)["pictures"]
    assert (item["path"], item["resolution"]) == (str(tmp_path / "a.exr"), [40, 20])
    assert header(item["path"]).channelnames == ("R", "G", "B", "A", "Z")


def test_flags_replace_what_products_say(run_json, products, tmp_path):
    """Oracle: the flags."""
    flags = ("--product", "/Render/deep", "--aovs", "color", *SMALL, "--frames", 1)
    (item,) = run_json("render", products, "-o", tmp_path / "a.exr", *flags)["pictures"]
    assert item["path"] == str(tmp_path / "a.exr")
    assert item["resolution"] == [48, 32]
    assert header(item["path"]).channelnames == ("R", "G", "B", "A")


def test_crops_keep_their_place(run_json, products, tmp_path, pictured):
    """Oracle: the same pixels of the whole picture, bit for bit, at their own data window."""
    stage = Usd.Stage.Open(str(products))
    prim = stage.GetPrimAtPath("/Render/deep")
    window = prim.GetAttribute("dataWindowNDC")
    window.Set(Gf.Vec4f(0.25, 0.0, 1.0, 0.5))
    stage.GetRootLayer().Save()
    flags = ("--product", "/Render/deep", "--frames", 2, "--float")
    (item,) = run_json("render", products, *flags)["pictures"]
    spec = header(item["path"])
    assert (spec.x, spec.y, spec.width, spec.height) == (10, 10, 30, 10)
    assert (spec.full_width, spec.full_height) == (40, 20)
    whole = pictured(2.0, resolution=(40, 20), color_mode="scene")["color"]
    np.testing.assert_array_equal(read(item["path"])[..., :4], whole[10:, 10:])


def test_purposes_decide_what_is_seen(run_json, shot, tmp_path):
    """Oracle: a ball of purpose guide is drawn only when it is asked for."""
    stage = Usd.Stage.Open(str(shot))
    guide = schema.author(stage, "/World/Guide", ball(50))
    UsdGeom.Imageable(guide).GetPurposeAttr().Set("guide")
    stage.GetRootLayer().Save()
    output = ("-o", tmp_path / "a.png", *SMALL)
    assert run_json("render", shot, *output)["pictures"][0]["splats"] == 300
    purposes = ("--purposes", "default, guide")
    assert run_json("render", shot, *output, *purposes)["pictures"][0]["splats"] == 350


def test_a_field_that_cannot_be_drawn_is_said(run, shot, tmp_path):
    """Oracle: the picture is drawn without it, and stderr has a sentence about it."""
    stage = Usd.Stage.Open(str(shot))
    bad = stage.DefinePrim("/World/Bad", "ParticleFieldPackedSplat")
    bad.CreateAttribute("positions", Sdf.ValueTypeNames.Point3fArray).Set([(0, 0, 0)])
    stage.GetRootLayer().Save()
    status, out, err = run("render", shot, "-o", tmp_path / "a.png", *SMALL)
    assert (status, out) == (0, f"{tmp_path}/a.png\n")
    assert err.startswith("usdsplat: error [not-drawn] /World/Bad")
    assert err.endswith("; it is not drawn\n")
    assert len(err.splitlines()) == 1


def test_no_camera_can_be_picked_of_none(run, moving, tmp_path):
    """Oracle: written out by hand."""
    status, _, err = run("render", moving, "-o", tmp_path / "a.png", "--camera", "/Nope")
    expected = "--camera: found '/Nope', expected no --camera, because the stage has none"
    assert (status, err) == (2, f"usdsplat: {expected}\n")


def test_both_parts_say_what_ids_stand_for_and_where_the_camera_is(run, shot, tmp_path):
    """Oracle: the first part's header, whose camera another test holds against the pixels."""
    flags = ("--aovs", "color,id", "--frames", 1, *SMALL)
    assert run("render", shot, "-o", tmp_path / "a.exr", *flags)[0] == 0
    file = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    main, ids = (file.spec(part, 0) for part in (0, 1))
    file.close()
    for name in ("usdsplat:ids", "worldToCamera", "worldToNDC", "screenWindowWidth"):
        assert main.getattribute(name) is not None
        assert ids.getattribute(name) == main.getattribute(name), name


@pytest.mark.parametrize(
    ("argv", "sentence"),
    [
        ([], "render: found no output file, expected -o FILE"),
        (["-o", "a.gif"], "a.gif: found suffix '.gif', expected one of .exr, .png, .jpg"),
        (["-o", "a.png", "--aovs", "color,Z"], "a.png: found AOVs color, Z, expected color"),
        (["-o", "a.png", "--float"], "a.png: found float pixels, expected uint8 or uint16"),
        (["-o", "a.png", "--color-mode", "x"], "--color-mode: found 'x', expected one of"),
        (["-o", "a.png", "--sh-degree", "9"], "--sh-degree: found 9, expected 0 to 4"),
        (["-o", "a.exr", "--aovs", "Ng"], "--aovs: found 'Ng', expected one of color, Z"),
        (["-o", "a.png", "--purposes", "x"], "--purposes: found 'x', expected one of default"),
        (["-o", "a.png", "--resolution", "9"], "--resolution: found '9', expected two numbers"),
        (["-o", "a.png", "--resolution", "99999x8"], "--resolution: found 99999x8, expected"),
        (["-o", "a.exr", "--resolution", "8x65537"], "--resolution: found 8x65537, expected"),
        (["-o", "a.png", "--frames", "1-2"], "a.png: found 2 frames, expected a place"),
        (["-o", "a.png", "--frames", "x"], "--frames: found 'x', expected a range"),
        (["-o", "a.png", "--camera", "/No"], "--camera: found '/No', expected one of /World/Cam"),
        (["-o", "a.png", "--camera", "No"], "--camera: found 'No', expected one of /World/Cam"),
        (["-o", "a.png", "--device", "abacus"], "--device: found 'abacus', expected auto or one"),
        (["-o", "a.png", "--threads", "0"], "--threads: found 0, expected 1 to"),
        (["-o", "a.png", "--settings", "/No"], "--settings: found /No, expected the path"),
        (["-o", "a.png", "--product", "/No"], "--product: found /No, expected a product of"),
    ],
)
def test_what_cannot_be_drawn_is_one_sentence(run, shot, monkeypatch, argv, sentence):
    """Oracle: where: found X, expected Y; status 2; no file is left."""
    monkeypatch.chdir(shot.parent)
    before = sorted(shot.parent.iterdir())
    status, out, err = run("render", shot, *argv)
    assert (status, out) == (2, "")
    assert err.startswith(f"usdsplat: {sentence}")
    assert len(err.splitlines()) == 1
    assert sorted(shot.parent.iterdir()) == before


def test_products_in_each_others_way_are_refused(run, products, tmp_path):
    """Oracle: one file cannot hold two products, nor can we draw a kind we do not know."""
    stage = Usd.Stage.Open(str(products))
    name = stage.GetPrimAtPath("/Render/look").GetAttribute("productName")
    name.Set(str(tmp_path / "deep.####.exr"))
    stage.GetRootLayer().Save()
    status, _, err = run("render", products, "--frames", 1)
    assert status == 2
    assert "found two products with this file" in err
    stage.GetPrimAtPath("/Render/look").GetAttribute("productType").Set("voxels")
    stage.GetRootLayer().Save()
    status, _, err = run("render", products, "--frames", 1)
    assert (status, "/Render/look: found productType voxels" in err) == (2, True)
    stage.GetPrimAtPath("/Render/deep").GetAttribute("productName").Set("")
    stage.GetRootLayer().Save()
    status, _, err = run("render", products, "--product", "/Render/deep")
    assert (status, "/Render/deep: found no output file, expected -o" in err) == (2, True)


def test_a_process_is_quiet_and_reports_its_threads(shot, tmp_path):
    """Oracle: streams and status of a shelled-out run; stderr may announce compilation, and how far
    a run is that takes longer than a second."""
    run = shell("render", shot, "-o", tmp_path / "a.exr", "--threads", 1, *SMALL, "--json")
    assert run.returncode == 0
    assert json.loads(run.stdout)["pictures"][0]["path"] == str(tmp_path / "a.exr")
    said = [line for line in run.stderr.splitlines() if "compiling kernels" not in line]
    assert [line for line in said if re.fullmatch(r"usdsplat: .* \d+/\d+.*", line) is None] == []
