"""Tests of `usdsplat render --background`, and of pictures without alpha."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdRender

from tests.cli.test_render import SMALL, read

Image = pytest.importorskip("PIL.Image")

pytestmark = pytest.mark.usefixtures("compiled")


def pixels(path):
    with Image.open(path) as picture:
        return np.asarray(picture)


@pytest.fixture
def render(run):
    """Draw a picture and return its pixels; nothing is said."""

    def draw(source, path, *flags):
        assert run("render", source, "-o", path, "--frames", 1, *SMALL, *flags) == (
            0, f"{path}\n", "",
        )  # fmt: skip
        return pixels(path)

    return draw


def test_a_capture_by_itself_is_opaque_and_a_stage_is_not(render, run, capture, shot, tmp_path):
    """Oracle: the corner, which is empty: the window's grey, or nothing."""
    assert run("render", capture, "-o", tmp_path / "a.png", *SMALL)[0] == 0
    alone = pixels(tmp_path / "a.png")
    assert alone.shape == (32, 48, 3) and alone[0, 0].tolist() == [56, 56, 56]
    assert render(shot, tmp_path / "b.png")[0, 0].tolist() == [0, 0, 0, 0]
    assert render(shot, tmp_path / "b.webp")[0, 0, 3] == 0
    assert np.abs(render(shot, tmp_path / "b.jpg")[0, 0].astype(int) - 56).max() <= 1
    assert run("render", capture, "-o", tmp_path / "a.exr", *SMALL)[0] == 0
    assert read(tmp_path / "a.exr")[0, 0].tolist() == [0, 0, 0, 0]
    words = ("render", capture, "-o", tmp_path / "c.png", "--background", "transparent", *SMALL)
    assert run(*words)[0] == 0
    assert pixels(tmp_path / "c.png")[0, 0].tolist() == [0, 0, 0, 0]


def test_spaces_and_case_of_a_background_do_not_matter(render, run, shot, tmp_path):
    """Oracle: the pictures of the plain words; for an EXR both mean that there is no colour."""
    for word in (" Auto ", " Transparent "):
        loose = render(shot, tmp_path / "a.png", "--background", word)
        plain = render(shot, tmp_path / "b.png", "--background", word.strip().lower())
        np.testing.assert_array_equal(loose, plain)
        words = ("render", shot, "-o", tmp_path / "a.exr", "--frames", 1, "--background", word)
        assert run(*words, *SMALL)[0] == 0


@pytest.mark.parametrize("flags", [(), ("--view", "Un-tone-mapped")], ids=["captured", "view"])
def test_a_colour_is_behind_the_transparent_picture(render, shot, tmp_path, flags):
    """Oracle: Pillow's compositing of the transparent picture, in code values of the display; empty
    pixels have exactly the colour, in 16 bits too."""
    color = ("--background", "#2864c8")
    opaque = render(shot, tmp_path / "a.png", *color, *flags).astype(int)
    clear = Image.fromarray(render(shot, tmp_path / "b.png", *flags), "RGBA")
    sheet = Image.new("RGBA", clear.size, (40, 100, 200, 255))
    expected = np.asarray(Image.alpha_composite(sheet, clear)).astype(int)
    assert np.abs(opaque - expected[..., :3]).max() <= 1
    empty = np.asarray(clear)[..., 3] == 0
    assert empty.any() and (opaque[empty] == (40, 100, 200)).all()
    render(shot, tmp_path / "c.png", *color, "--png-bits", "16", *flags)
    fine = read(tmp_path / "c.png", kind="uint16")
    assert (fine[empty] == np.array((40, 100, 200)) * 257).all()


def test_a_crop_and_tiles_have_the_same_background(render, run, shot, tmp_path):
    """Oracle: the whole picture."""
    color = ("--background", "0.5,0.25,1")
    whole = render(shot, tmp_path / "a.png", *color)
    part = render(shot, tmp_path / "b.png", *color, "--crop", "0,0,20,32")
    np.testing.assert_array_equal(part, whole[:, :20])
    words = ("render", shot, "-o", tmp_path / "t.png", "--frames", 1, *SMALL, *color)
    for tile in (1, 2, "join"):
        assert run(*words, "--tiles", "2x1", "--tile", tile)[0] == 0
    np.testing.assert_array_equal(pixels(tmp_path / "t.png"), whole)


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.webp"])
def test_resume_draws_again_over_another_background(run, shot, tmp_path, name):
    """Oracle: the same command twice has nothing to do; another colour does, for every format."""
    words = ("render", shot, "-o", tmp_path / name, "--frames", 1, *SMALL, "--resume")
    assert run(*words, "--background", "white")[0] == 0
    status, out, err = run(*words, "--background", "#ffffff")
    assert (status, out) == (0, "") and "nothing to do" in err
    status, out, err = run(*words, "--background", "black")
    assert (status, out) == (0, f"{tmp_path / name}\n")
    assert "found a picture with another background; it is drawn again" in err
    assert pixels(tmp_path / name)[0, 0, :3].max() <= 1


@pytest.mark.parametrize("name", ["a.jpg", "a.webp"])
def test_resume_draws_truncated_files_again(run, shot, tmp_path, name):
    """Oracle: the sentence, after the last byte was cut off."""
    words = ("render", shot, "-o", tmp_path / name, "--frames", 1, *SMALL)
    assert run(*words)[0] == 0
    (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[:-1])
    status, _, err = run(*words, "--resume")
    assert status == 0 and "found a truncated file; it is drawn again" in err


def test_a_stage_says_what_is_behind_its_pictures(run_json, shot, tmp_path):
    """Oracle: the corner of a PNG; the EXR of the same settings keeps its alpha."""
    stage = Usd.Stage.Open(str(shot))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    name = Sdf.ValueTypeNames.String
    settings.GetPrim().CreateAttribute("splat:background", name).Set("#0a141e")
    for kind in ("png", "exr"):
        product = UsdRender.Product.Define(stage, f"/Render/{kind}")
        product.GetProductNameAttr().Set(str(tmp_path / f"a.{kind}"))
        settings.GetProductsRel().AddTarget(product.GetPath())
    stage.GetRootLayer().Save()
    run_json("render", shot, *SMALL)
    assert pixels(tmp_path / "a.png")[0, 0].tolist() == [10, 20, 30]
    assert read(tmp_path / "a.exr").shape[-1] == 4
    run_json("render", shot, "--background", "white", *SMALL)
    assert pixels(tmp_path / "a.png")[0, 0].tolist() == [255, 255, 255]


def test_the_header_names_the_background(render, shot, tmp_path):
    """Oracle: Pillow's reader of text and of Exif."""
    render(shot, tmp_path / "a.png", "--background", "white")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.text["usdsplat:background"] == "#ffffff"
    render(shot, tmp_path / "a.jpg")
    with Image.open(tmp_path / "a.jpg") as picture:
        assert json.loads(picture.getexif()[0x010E])["usdsplat:background"] == "#383838"


@pytest.mark.parametrize(
    ("name", "color", "sentence"),
    [
        ("a.exr", "white", "--background: found white for an EXR, expected a PNG, JPEG or WebP"),
        ("a.jpg", "transparent", "--background: found transparent for a JPEG, expected a colour"),
        (
            "a.png",
            "red",
            "--background: found 'red', expected auto, transparent, black, grey, white",
        ),
        ("a.png", "2,0,0", "--background: found '2,0,0', expected auto, transparent"),
    ],
)
def test_what_a_format_does_not_have_is_refused(run, shot, tmp_path, name, color, sentence):
    """Oracle: one line, status 2, no file."""
    words = ("-o", tmp_path / name, "--background", color, *SMALL)
    status, out, err = run("render", shot, *words)
    assert (status, out) == (2, "") and err.startswith(f"usdsplat: {sentence}")
    assert not (tmp_path / name).exists()
