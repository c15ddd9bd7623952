"""Tests of the names, folders and frames of the pictures that `usdsplat render` writes."""

from __future__ import annotations

import pytest
from pxr import Gf, Usd, UsdRender

from tests.cli.test_render import SMALL, header

pytestmark = pytest.mark.usefixtures("compiled")

SOLARIS = {1.0: "renders/hero.0001.exr", 2.0: "renders/hero.0002.exr", 3.0: "renders/hero.0003.exr"}
"""`productName` as Solaris exports `$HIP/renders/hero.$F4.exr`: a time sample for each frame."""


@pytest.fixture
def named(shot, monkeypatch):
    """Return a function that gives the shot a product with a name for each time code."""
    monkeypatch.chdir(shot.parent)

    def author(names, sources=("Ci", "depth")):
        stage = Usd.Stage.Open(str(shot))
        stage.SetStartTimeCode(1)
        stage.SetEndTimeCode(3)
        settings = UsdRender.Settings.Define(stage, "/Render/Main")
        settings.GetResolutionAttr().Set(Gf.Vec2i(40, 20))
        product = UsdRender.Product.Define(stage, "/Render/hero")
        for source in sources:
            var = UsdRender.Var.Define(stage, f"/Render/hero/{source}")
            var.GetSourceNameAttr().Set(source)
            product.GetOrderedVarsRel().AddTarget(var.GetPath())
        for time, name in names.items():
            code = Usd.TimeCode.Default() if time is None else time
            product.GetProductNameAttr().Set(name, code)
        settings.GetProductsRel().AddTarget(product.GetPath())
        stage.GetRootLayer().Save()
        return shot

    return author


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*.exr"))


def test_a_product_name_with_time_samples_names_each_frame(run, named, tmp_path):
    """Oracle: the authored samples; without --frames, the stage's whole range is drawn."""
    shot = named(SOLARIS)
    status, out, err = run("render", shot)
    assert (status, err) == (0, "")
    assert out.splitlines() == list(SOLARIS.values())
    assert files(tmp_path) == list(SOLARIS.values())


def test_folders_have_the_number_too(run, named, tmp_path):
    """Oracle: Houdini's names; the stage's range is drawn, because frames differ in a folder."""
    status, out, _ = run("render", named({None: "out.$F/<F4>/s.exr"}))
    expected = [f"out.{frame}/000{frame}/s.exr" for frame in (1, 2, 3)]
    assert (status, out.split()) == (0, expected)
    assert files(tmp_path) == expected


def test_a_sampled_name_holds_until_the_next_sample(run, named):
    """Oracle: USD's interpolation of tokens: held, and the first sample holds before itself."""
    shot = named({2.0: "a.####.exr", 3.0: "b.<F>.exr"})
    status, out, _ = run("render", shot, "--frames", "1-3")
    assert (status, out.split()) == (0, ["a.0001.exr", "a.0002.exr", "b.3.exr"])


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("new/folders/s.$F4.exr", "new/folders/s.0002.exr"),
        ("s.<F4>.exr", "s.0002.exr"),
        ("s.%04d.exr", "s.0002.exr"),
        ("take#3.$F.exr", "take#3.2.exr"),
    ],
)
def test_names_are_spelled_as_in_other_tools(run, named, tmp_path, name, expected):
    """Oracle: Houdini's $F4, husk's <F4>, printf; folders are made; a single # is a letter."""
    status, out, _ = run("render", named({None: name}), "--frames", 2)
    assert (status, out) == (0, f"{expected}\n")
    assert files(tmp_path) == [expected]


def test_frames_that_share_a_name_are_refused(run, named, tmp_path):
    """Oracle: the second picture would replace the first; no folder is made."""
    status, out, err = run("render", named({None: "out/####/s.exr"}), "--frames", "1-2")
    assert (status, out) == (2, "")
    assert err.startswith("usdsplat: out/####/s.exr: found 2 frames, expected a placeholder")
    assert not (tmp_path / "out").exists()


def test_the_stage_has_the_range(run, named):
    """Oracle: startTimeCode 1 and endTimeCode 3."""
    shot = named({None: "a.exr"})
    status, out, _ = run("render", shot, "-o", "b.$F.exr", "--frames", "stage")
    assert (status, out.split()) == (0, ["b.1.exr", "b.2.exr", "b.3.exr"])
    assert run("render", shot)[1] == "a.exr\n"


def test_a_stage_without_a_range_has_no_frames_to_offer(run, capture, tmp_path):
    """Oracle: one sentence that names the attributes."""
    status, _, err = run("render", capture, "-o", tmp_path / "a.png", "--frames", "stage", *SMALL)
    assert status == 2
    assert err.startswith("usdsplat: --frames: found a stage without a range, expected startTime")


def test_a_png_of_a_product_with_several_vars_has_its_colour(run, named):
    """Oracle: the product's vars, colour and depth: an EXR has both, a PNG says what it lacks."""
    shot = named(SOLARIS)
    status, out, err = run("render", shot, "-o", "a.png", "--frames", 1)
    assert (status, out) == (0, "a.png\n")
    assert "warning [png-aovs] /Render/hero: found Z in a PNG, expected only color" in err
    status, out, err = run("render", shot, "-o", "a.exr", "--frames", 1)
    assert (status, out, err) == (0, "a.exr\n", "")
    assert header("a.exr").channelnames == ("R", "G", "B", "A", "Z")


def test_names_of_two_formats_are_refused(run, named):
    """Oracle: a picture is planned once, for one format."""
    status, _, err = run("render", named({1.0: "a.exr", 2.0: "a.png"}))
    assert status == 2
    assert "/Render/hero.productName: found .exr and .png, expected one suffix" in err


def test_a_folder_that_cannot_be_made_is_one_sentence(run, named, tmp_path):
    """Oracle: a file stands where the folder would; nothing is written."""
    (tmp_path / "renders").write_text("mine")
    status, out, err = run("render", named(SOLARIS), "--frames", 1)
    assert (status, out) == (2, "")
    assert err.startswith("usdsplat: renders")
    assert len(err.splitlines()) == 1
    assert (tmp_path / "renders").read_text() == "mine"
