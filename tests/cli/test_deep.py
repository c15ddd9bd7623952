"""Tests of `usdsplat render --deep`, from the command line to the samples in the file."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdRender

from tests.cli.test_holdouts import deep, smoke
from tests.cli.test_render import SMALL, header, read
from tests.flattening import over
from tests.images.test_deep import oiiotool
from usdsplat.images.deep_reader import read_deep

pytestmark = pytest.mark.usefixtures("compiled")


def test_a_deep_file_flattens_to_the_linear_picture(run, shot, tmp_path):
    """Oracle: the flat picture that is blended linearly; stderr says what is forced, and how far
    from the one that is not, by the two flat files themselves."""
    pictures = {"deep.exr": ("--deep", "--float"), "flat.exr": ("--float",)}
    pictures["linear.exr"] = ("--float", "--blend-space", "linear")
    said = {}
    for name, flags in pictures.items():
        status, _, said[name] = run("render", shot, "-o", tmp_path / name, *flags, *SMALL)
        assert status == 0
    band = read_deep(tmp_path / "deep.exr")
    flat, linear = read(tmp_path / "flat.exr"), read(tmp_path / "linear.exr")
    counts = np.diff(band.offsets).reshape(32, 48)
    found = over(counts, band.color)
    np.testing.assert_allclose(found, linear, atol=1e-3)
    first, second = said["deep.exr"].splitlines()
    assert "deep samples are linear, in lin_rec709_scene, and are blended in that space" in first
    decibels = -10 * np.log10(np.mean((found - flat)[..., :3] ** 2))
    told = re.search(r"([\d,]+) samples.* is ([\d.]+) dB \(at most ([\d.]+)\)", second)
    assert int(told[1].replace(",", "")) == counts.sum()
    assert float(told[2]) == pytest.approx(decibels, abs=0.06)
    assert float(told[3]) == pytest.approx(np.abs(found - flat)[..., :3].max(), rel=0.05)


def test_deep_sequences_resume_and_need_no_comparison(run, shot, tmp_path):
    """Oracle: the files; a frame that is there stays, and no flat picture is spoken of."""
    flags = ("--deep", "--no-compare", "--compression", "zips", *SMALL)
    output = ("-o", tmp_path / "a.%d.exr", "--json", "--frames")
    assert run("render", shot, *output, "1", *flags)[0] == 0
    before = (tmp_path / "a.1.exr").read_bytes()
    status, out, err = run("render", shot, *output, "1-4x2,2", "--resume", *flags)
    assert (status, "flattened" in err) == (0, False)
    assert [item["frame"] for item in json.loads(out)["pictures"]] == [3, 2]
    assert all(item["deep_samples"] > 1000 for item in json.loads(out)["pictures"])
    assert (tmp_path / "a.1.exr").read_bytes() == before
    assert header(tmp_path / "a.2.exr").getattribute("compression") == "zips"


def test_a_product_may_be_deep(run, shot, tmp_path):
    """Oracle: the prims; what a deep file cannot hold is said, and left out."""
    stage = Usd.Stage.Open(str(shot))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    product = UsdRender.Product.Define(stage, "/Render/deep")
    product.GetProductTypeAttr().Set("deepRaster")
    product.GetProductNameAttr().Set(str(tmp_path / "d.exr"))
    settings.GetProductsRel().AddTarget(product.GetPath())
    for name in ("Ci", "P"):
        var = UsdRender.Var.Define(stage, f"/Render/{name}")
        var.GetSourceNameAttr().Set(name)
        product.GetOrderedVarsRel().AddTarget(var.GetPath())
    stage.GetRootLayer().Save()
    status, _, err = run("render", shot, *SMALL, "--no-compare", "--frames", 1)
    assert status == 0
    assert header(tmp_path / "d.exr").deep
    assert "warning [deep-aovs] /Render/deep: found P in a deep picture, expected only" in err


def test_a_flat_product_may_be_drawn_deep(run, shot, tmp_path):
    """Oracle: the compression that Solaris authors for flat pictures is said, and left out."""
    stage = Usd.Stage.Open(str(shot))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    product = UsdRender.Product.Define(stage, "/Render/flat")
    product.GetProductNameAttr().Set(str(tmp_path / "d.exr"))
    name = "driver:parameters:OpenEXR:compression"
    product.GetPrim().CreateAttribute(name, Sdf.ValueTypeNames.String).Set("zip")
    settings.GetProductsRel().AddTarget(product.GetPath())
    stage.GetRootLayer().Save()
    flags = (*SMALL, "--no-compare", "--frames", 1)
    status, _, err = run("render", shot, "--deep", *flags)
    assert status == 0 and header(tmp_path / "d.exr").deep
    assert "warning [product-metadata] /Render/flat: found compression 'zip' in a deep" in err
    assert "product-metadata" not in run("render", shot, *flags)[2]


@pytest.mark.parametrize(
    ("argv", "sentence"),
    [
        (["-o", "a.png", "--deep"], "a.png: found a deep picture, expected the suffix .exr"),
        (
            ["-o", "a.exr", "--deep", "--aovs", "color,P"],
            "--aovs: found P, expected some of color, Z",
        ),
        (["-o", "a.exr", "--deep", "--bake-view"], "--bake-view: found a deep picture, expected"),
        (["-o", "a.exr", "--deep", "--compression", "zip"], "a.exr: found compression 'zip', exp"),
        (
            ["-o", "a.exr", "--compression", "x"],
            "a.exr: found compression 'x', expected one of none",
        ),
        (["-o", "a.exr", "--compression", "dwaa:x"], "a.exr: found compression 'dwaa:x', expected"),
        (["-o", "a.exr", "--deep", "--deep-error", "2"], "--deep-error: found 2.0, expected 0 to"),
    ],
)
def test_what_cannot_be_deep_is_one_sentence(run, shot, monkeypatch, argv, sentence):
    """Oracle: where: found X, expected Y; status 2; no file is left."""
    monkeypatch.chdir(shot.parent)
    before = sorted(shot.parent.iterdir())
    status, out, err = run("render", shot, *argv, *SMALL)
    assert (status, out) == (2, "")
    assert err.startswith(f"usdsplat: {sentence}")
    assert len(err.splitlines()) == 1
    assert sorted(shot.parent.iterdir()) == before


def test_deep_needs_an_order_of_planar_depths(run, shot, tmp_path):
    """Oracle: the orders in which a deep picture can be kept; no file is left."""
    flags = ("--deep", "--sorting", "cameraDistance", *SMALL)
    status, _, err = run("render", shot, "-o", tmp_path / "a.exr", *flags)
    assert status == 2
    assert err.splitlines()[-1].startswith("usdsplat: --sorting: found cameraDistance, expected z")
    assert not (tmp_path / "a.exr").exists()


@pytest.mark.parametrize("holdout", [False, True])
@pytest.mark.parametrize("flags", [(), ("--float",)])
def test_a_deep_file_flattens_to_the_beauty(run, shot, tmp_path, flags, holdout):
    """Half and float, also with a holdout. Oracle: `oiiotool --flatten` against the flat picture,
    60 dB or more, which stderr says; opacities are those of the deep picture without the flag;
    without a comparison, the file is the same."""
    flags = (*flags, "--frames", 1, *SMALL)
    if holdout:
        deep(tmp_path / "cg.exr", smoke)
        flags = (*flags, "--holdout", tmp_path / "cg.exr")
    names = {
        "scene": ("--deep",),
        "beauty": ("--deep", "--deep-color", "beauty"),
        "again": ("--deep", "--deep-color", "beauty", "--no-compare"),
        "flat": ("--float",) if "--float" not in flags else (),
    }
    said = {}
    for name, more in names.items():
        words = ("render", shot, "-o", tmp_path / f"{name}.exr", *flags, *more)
        status, _, said[name] = run(*words)
        assert status == 0
    flat = read(tmp_path / "flat.exr").astype(np.float64)
    error = {}
    for name in ("scene", "beauty"):
        oiiotool(tmp_path / f"{name}.exr", "--flatten", "-d", "float", "-o", tmp_path / "f.exr")
        error[name] = (read(tmp_path / "f.exr")[..., :3] - flat[..., :3]).ravel()
    decibels = {name: -10 * np.log10(np.mean(each**2)) for name, each in error.items()}
    assert decibels["beauty"] > 60 > decibels["scene"] + 10
    told = re.search(r"flattened it is ([\d.]+) dB", said["beauty"])
    assert float(told[1]) == pytest.approx(decibels["beauty"], abs=2)
    assert "scaled to flatten to the flat picture (--deep-color beauty)" in said["beauty"]
    scene, beauty, again = (read_deep(tmp_path / f"{k}.exr") for k in list(names)[:3])
    np.testing.assert_array_equal(beauty.color[:, 3], scene.color[:, 3])
    np.testing.assert_array_equal(beauty.depth, scene.depth)
    np.testing.assert_array_equal(beauty.color, again.color)
    assert "flattened" not in said["again"].splitlines()[-1]
    meaning = header(tmp_path / "beauty.exr").getattribute("usdsplat:aov:color")
    assert "scaled per pixel" in meaning


def test_the_beauty_may_be_blended_linearly(run, shot, tmp_path):
    """Oracle: the samples are those of `--deep-color scene`, which flatten to that picture, to
    half's rounding; stderr names the space."""
    words = ("render", shot, "--frames", 1, *SMALL, "--deep", "--blend-space", "linear")
    images, said = [], []
    for name in ("scene", "beauty"):
        status, _, err = run(*words, "-o", tmp_path / "d.exr", "--deep-color", name)
        assert status == 0
        images.append(read_deep(tmp_path / "d.exr").color)
        said.append(float(re.search(r"is ([\d.]+) dB .*the picture blended linearly", err)[1]))
    np.testing.assert_allclose(images[1], images[0], rtol=2e-3, atol=2e-6)
    assert min(said) > 80


def test_the_flat_picture_recolors_the_deep_one(run, shot, tmp_path):
    """The recipe of docs/deep.md. Oracle: its formula, colour by opacity, and the over operator."""
    words = ("render", shot, "--float", "--frames", 1, *SMALL)
    assert run(*words, "--deep", "--no-compare", "-o", tmp_path / "deep.exr")[0] == 0
    assert run(*words, "-o", tmp_path / "flat.exr")[0] == 0
    band, flat = read_deep(tmp_path / "deep.exr"), read(tmp_path / "flat.exr")
    counts = np.diff(band.offsets).reshape(32, 48)
    cover = np.where(flat[..., 3:] > 0, flat[..., 3:], 1)
    straight = np.repeat((flat / cover).reshape(-1, 4), counts.ravel(), axis=0)
    color = np.concatenate([straight[:, :3] * band.color[:, 3:], band.color[:, 3:]], axis=1)
    error = (over(counts, color) - flat)[..., :3]
    assert -10 * np.log10(np.mean(error**2)) > 60
