"""Tests of what users add to files of pictures: entries, time codes, 16 bits, an OCIO config."""

from __future__ import annotations

import json

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from pxr import Sdf, Usd, UsdRender

from tests.cli.test_render import SMALL, header, read
from tests.cli.test_views import CONFIG

pytestmark = pytest.mark.usefixtures("compiled")


@pytest.fixture
def timed(shot):
    """The shot at 24 frames a second, from frame 1001 on."""
    stage = Usd.Stage.Open(str(shot))
    stage.SetStartTimeCode(1001)
    stage.SetEndTimeCode(1010)
    stage.SetFramesPerSecond(24)
    stage.SetTimeCodesPerSecond(24)
    stage.GetRootLayer().Save()
    return shot


def exr(path):
    """The header of an EXR, by OpenEXR's own reader."""
    return OpenEXR.File(str(path), header_only=True).header()


@pytest.mark.parametrize("deep", [(), ("--deep", "--no-compare", "-q")])
def test_entries_of_users_are_in_the_header(run_json, shot, tmp_path, deep):
    """Oracle: OpenEXR's reader; a number is a number, and the last of two values counts."""
    words = [f"--metadata={each}" for each in ("shot=0010", "take=1", "take=7", "note=ü = 1")]
    run_json("render", shot, "-o", tmp_path / "a.exr", *words, *SMALL, *deep)
    found = exr(tmp_path / "a.exr")
    assert (found["shot"], found["take"], found["note"]) == ("0010", 7, "ü = 1")


def test_entries_of_users_are_in_pngs(run_json, shot, tmp_path):
    """Oracle: Pillow's reader of text; OpenImageIO's name in a PNG for the artist is Author."""
    from PIL import Image

    words = ("--metadata", "artist=Ada", "--metadata", "take=7")
    run_json("render", shot, "-o", tmp_path / "a.png", *words, *SMALL)
    with Image.open(tmp_path / "a.png") as picture:
        assert (picture.text["Author"], picture.text["take"]) == ("Ada", "7")


def test_an_entry_with_another_meaning_is_refused(run, shot, tmp_path):
    """Oracle: one line, status 2, and no file."""
    status, _, err = run("render", shot, "-o", tmp_path / "a.exr", "--metadata", "dataWindow=1")
    assert status == 2 and err.startswith("usdsplat: --metadata: found 'dataWindow', expected")
    assert not (tmp_path / "a.exr").exists()


def test_flags_add_to_what_a_product_adds(run_json, shot, tmp_path):
    """Oracle: OpenEXR's reader; attributes as Solaris authors them, and a flag that replaces."""
    stage = Usd.Stage.Open(str(shot))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    product = UsdRender.Product.Define(stage, "/Render/a")
    product.GetProductNameAttr().Set(str(tmp_path / "a.exr"))
    for name, value in (("artist", "Ada"), ("OpenEXR:show", "abc"), ("OpenEXR:compression", "piz")):
        attribute = f"driver:parameters:{name}"
        product.GetPrim().CreateAttribute(attribute, Sdf.ValueTypeNames.String).Set(value)
    settings.GetProductsRel().AddTarget(product.GetPath())
    stage.GetRootLayer().Save()
    run_json("render", shot, "--metadata", "show=xyz", *SMALL)
    found = exr(tmp_path / "a.exr")
    assert (found["artist"], found["show"]) == ("Ada", "xyz")
    assert header(tmp_path / "a.exr").getattribute("compression") == "piz"


def test_sixteen_bits_hold_more_than_eight(run_json, shot, tmp_path):
    """Oracle: OpenImageIO's reader: the same picture, rounded to 1/65535 and to 1/255."""
    for bits in ("8", "16"):
        run_json("render", shot, "-o", tmp_path / f"{bits}.png", "--png-bits", bits, *SMALL)
    coarse, fine = (oiio.ImageBuf(str(tmp_path / f"{bits}.png")) for bits in ("8", "16"))
    assert [str(each.spec().format) for each in (coarse, fine)] == ["uint8", "uint16"]
    steps = fine.get_pixels(oiio.UINT16)
    assert len(np.unique(steps)) > 1000
    np.testing.assert_allclose(
        read(tmp_path / "16.png"), read(tmp_path / "8.png"), atol=0.5 / 255 + 1e-5
    )


@pytest.mark.parametrize(
    ("frame", "expected"), [(1001, (1, 0, 0, 0)), (1004, (1, 0, 0, 3)), (977, (0, 59, 59, 0))]
)
def test_the_stages_first_frame_has_the_start_time_code(run, timed, tmp_path, frame, expected):
    """Oracle: OpenEXR's reader; whichever frames a run draws, so that tasks of a farm agree."""
    words = ("--frames", frame, "--start-timecode", "01:00:00:00", *SMALL)
    assert run("render", timed, "-o", tmp_path / "a.exr", *words)[0] == 0
    code = exr(tmp_path / "a.exr")["timeCode"]
    assert (code.hours, code.minutes, code.seconds, code.frame) == expected


@pytest.mark.parametrize("text", ["1:00", "00:00:00:24"])
def test_a_time_code_that_the_rate_does_not_have_is_refused(run, timed, tmp_path, text):
    """Oracle: 24 frames a second are numbered from 00 to 23; one line, status 2, no file."""
    status, _, err = run("render", timed, "-o", tmp_path / "a.exr", "--start-timecode", text)
    assert status == 2 and "usdsplat: --start-timecode: found" in err
    assert not (tmp_path / "a.exr").exists()


def test_frames_outside_of_the_range_are_noted(run, timed, tmp_path):
    """Oracle: a range of 1001 to 1010, and frames on both sides of its end; a note
    is no failure."""
    words = ("--frames", "1010-1012", "--strict", *SMALL)
    status, out, err = run("render", timed, "-o", tmp_path / "a.%d.exr", *words)
    assert (status, len(out.splitlines())) == (0, 3)
    note = "note [outside-range] frames: found frame 1011 (and 1 more frame), expected 1001 to 1010"
    assert note in err


def test_the_variable_names_the_config_of_a_view(run, shot, tmp_path, monkeypatch):
    """Oracle: the same files as with --config; the header names the config; without a view, a note,
    and the same PNG as without the variable."""
    plain, through = tmp_path / "plain.png", tmp_path / "through.exr"
    assert run("render", shot, "-o", plain, *SMALL)[0] == 0
    words = ("render", shot, "--bake-view", *SMALL)
    assert run(*words, "--config", CONFIG, "-o", tmp_path / "asked.exr")[0] == 0
    monkeypatch.setenv("OCIO", CONFIG)
    status, _, err = run(*words, "-o", through)
    assert status == 0 and "unused-config" not in err
    np.testing.assert_array_equal(read(through), read(tmp_path / "asked.exr"))
    assert exr(through)["usdsplat:ocioConfig"] == CONFIG
    status, out, err = run("render", shot, "-o", tmp_path / "b.png", "--json", *SMALL)
    assert status == 0 and "usdsplat: note [unused-config] $OCIO: found" in err
    assert [each["code"] for each in json.loads(out)["findings"]] == ["unused-config"]
    np.testing.assert_array_equal(read(tmp_path / "b.png"), read(plain))
    assert "unused-config" not in run("render", shot, "-o", tmp_path / "b.exr", *SMALL)[2]


def test_a_view_without_effect_and_a_broken_variable_are_said(run, shot, tmp_path, monkeypatch):
    """Oracle: the flag and the variable that are named; an EXR has no view without --bake-view."""
    words = ("render", shot, "-o", tmp_path / "a.exr", *SMALL)
    status, _, err = run(*words, "--config", CONFIG)
    assert status == 0 and f"note [unused-view] render: found {CONFIG}" in err
    monkeypatch.setenv("OCIO", str(tmp_path / "none.ocio"))
    status, _, err = run(*words, "--bake-view")
    assert status == 2 and err.startswith("usdsplat: $OCIO: found")


@pytest.mark.parametrize("compression", ["dwaa:0.1", "dwaa:0", "zip:x"])
def test_a_level_that_is_no_whole_number_is_refused_in_a_sentence(run, shot, tmp_path, compression):
    """Oracle: the sentence says what a level is."""
    words = ("-o", tmp_path / "a.exr", "--compression", compression)
    status, _, err = run("render", shot, *words)
    assert status == 2 and f"found compression '{compression}', expected a whole number" in err


def test_each_var_has_its_own_type(run_json, shot, tmp_path):
    """Oracle: OpenImageIO's reader of channel types: a float alpha leaves colour as it is."""
    stage = Usd.Stage.Open(str(shot))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    product = UsdRender.Product.Define(stage, "/Render/a")
    product.GetProductNameAttr().Set(str(tmp_path / "a.exr"))
    for source, kind in (
        ("Ci", "color3h"),
        ("a", "float"),
        ("depth", ""),
        ("N", "half3"),
        ("albedo", "color3f"),
    ):
        var = UsdRender.Var.Define(stage, f"/Render/a/{source}")
        var.GetSourceNameAttr().Set(source)
        if kind:
            var.GetDataTypeAttr().Set(kind)
        product.GetOrderedVarsRel().AddTarget(var.GetPath())
    settings.GetProductsRel().AddTarget(product.GetPath())
    stage.GetRootLayer().Save()

    def types():
        spec = header(tmp_path / "a.exr")
        kinds = [str(spec.channelformat(i)) for i in range(spec.nchannels)]
        return dict(zip(spec.channelnames, kinds, strict=True))

    run_json("render", shot, *SMALL)
    assert types() == {
        **dict.fromkeys("RGB", "half"), "A": "float", "Z": "float",
        **dict.fromkeys(("N.x", "N.y", "N.z"), "half"),
        **dict.fromkeys(("albedo.R", "albedo.G", "albedo.B"), "float"),
    }  # fmt: skip
    run_json("render", shot, "--half", *SMALL)
    assert types()["A"] == "half"
