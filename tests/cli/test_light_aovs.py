"""Tests of `usdsplat render` with AOVs of light groups."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Sdf, Usd, UsdLux

from tests.cli.test_render import SMALL, header

pytestmark = pytest.mark.usefixtures("compiled")


@pytest.fixture
def lit(shot):
    """The shot with a key light and one without a group."""
    stage = Usd.Stage.Open(str(shot))
    for name, intensity in (("Key", 3.0), ("Other", 1.0)):
        light = UsdLux.DistantLight.Define(stage, f"/World/{name}")
        light.CreateIntensityAttr(intensity)
        light.CreateAngleAttr(0.0)
    key = stage.GetPrimAtPath("/World/Key")
    key.CreateAttribute("primvars:lightGroup", Sdf.ValueTypeNames.Token).Set("key")
    stage.Save()
    return shot


def layers(path):
    """Channels of an EXR, stacked by layer."""
    image, found = oiio.ImageBuf(str(path)), {}
    pixels = image.get_pixels(oiio.FLOAT)
    for k, name in enumerate(image.spec().channelnames):
        layer, _, _ = name.rpartition(".")
        found.setdefault(layer, []).append(pixels[..., k])
    return {layer: np.stack(each, axis=-1) for layer, each in found.items()}


@pytest.mark.parametrize("names", ["color,lights", "color,light_*", "color,light_key,lights"])
def test_all_light_groups_are_asked_for_by_one_word(run, lit, tmp_path, names):
    """Oracle: the layers of the file, whose sum is the beauty; the sentence on blending."""
    output = ("-o", tmp_path / "a.exr", "--frames", 1, "--float", *SMALL)
    status, _, err = run("render", lit, *output, "--aovs", names, "--lighting", "shadowed")
    assert status == 0 and "--blend-space linear" in err
    found = layers(tmp_path / "a.exr")
    assert found.keys() == {"", "light_default", "light_key", "light_captured"}
    total = found["light_default"] + found["light_key"] + found["light_captured"]
    np.testing.assert_allclose(total, found[""][..., :3], atol=1e-5)
    assert found["light_key"].max() > found["light_default"].max() > 0
    assert "group key" in header(tmp_path / "a.exr").getattribute("usdsplat:aov:light_key")


def test_an_unknown_group_is_one_sentence_with_those_of_the_stage(run, lit, tmp_path):
    """Oracle: the sentence; nothing is written."""
    status, _, err = run("render", lit, "-o", tmp_path / "a.exr", "--aovs", "light_rim")
    assert status == 2 and not (tmp_path / "a.exr").exists()
    expected = "a light group of the stage: light_default, light_key, light_captured"
    assert err == f"usdsplat: --aovs: found 'light_rim', expected {expected}\n"


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        (("-o", "a.exr", "--deep"), "expected some of color, Z"),
        (("-o", "a.exr", "--bake-view"), "expected an EXR in color mode scene"),
        (("-o", "a.exr", "--color-mode", "display"), "expected an EXR in color mode scene"),
        (("-o", "a.png"), "expected an EXR in color mode scene"),
    ],
)
def test_pictures_in_which_light_does_not_add_up_are_refused(run, lit, tmp_path, flags, sentence):
    """Oracle: one sentence, exit status 2, no file."""
    name, *others = flags[1:]
    output = ("-o", tmp_path / name, "--frames", 1, *SMALL)
    status, _, err = run("render", lit, *output, *others, "--aovs", "color,light_key")
    assert status == 2 and sentence in err and err.count("\n") == 1
    assert not (tmp_path / name).exists()


def test_all_aovs_leave_out_light_groups(run, lit, tmp_path):
    """Oracle: the layers of the file, and no sentence on blending."""
    output = ("-o", tmp_path / "a.exr", "--frames", 1, *SMALL)
    status, _, err = run("render", lit, *output, "--aovs", "all")
    assert (status, err) == (0, "")
    assert not any(layer.startswith("light_") for layer in layers(tmp_path / "a.exr"))


def test_tiles_are_those_of_the_whole_picture(run, lit, tmp_path):
    """Oracle: the picture without tiles, bit for bit."""
    flags = ("--frames", 1, "--float", *SMALL, "--aovs", "color,lights", "--lighting", "relit")
    assert run("render", lit, "-o", tmp_path / "a.exr", *flags)[0] == 0
    for tile in (1, 2, "join"):
        each = ("--tiles", "2x1", "--tile", tile)
        assert run("render", lit, "-o", tmp_path / "b.exr", *flags, *each)[0] == 0
    whole, joined = layers(tmp_path / "a.exr"), layers(tmp_path / "b.exr")
    assert whole.keys() == joined.keys()
    for name, pixels in whole.items():
        np.testing.assert_array_equal(joined[name], pixels)
