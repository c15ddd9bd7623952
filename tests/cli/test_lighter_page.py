"""Tests of the recipes of docs/howto/lighter.md: their stages and commands, as they stand there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Usd

from tests.cli.conftest import ball
from tests.delegate.scene_delegate.test_lights import sky_picture
from usdsplat import schema

pytestmark = pytest.mark.usefixtures("compiled")

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "lighter.md"
SMALL = ("--resolution", "32x24", "--light-samples", "1", "--dome-samples", "4", "-q")


def block(language: str, named: str) -> str:
    """Return the only block of code of a language with a text in it."""
    found = re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text("utf-8"), re.DOTALL | re.M)
    (one,) = (each for each in found if named in each)
    return one


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """The stage to start from, with a capture and a sky, in the current folder."""
    monkeypatch.chdir(tmp_path)
    stage = Usd.Stage.CreateNew("scan_normals.usdc")
    schema.author(stage, "/Scan/splats", ball(100))
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Scan"))
    stage.Save()
    Path("shot.usda").write_text(block("usda", 'def DomeLight "Sky"'))
    sky_picture(tmp_path, "set.hdr")
    return tmp_path


def test_the_stage_to_start_from_has_no_warning(run, folder):
    """Oracle: --strict, and the count of `validate`."""
    status, _, err = run("render", "shot.usda", "-o", "a.exr", "--strict", *SMALL)
    assert (status, err) == (0, "")
    assert "shot.usda: 0 errors, 0 warnings" in run("validate", "shot.usda")[1]


def test_a_relit_layer_is_a_variant(run, folder):
    """Oracle: the coefficients of the layer and those of the capture, and a render of each stage
    alone."""
    Path("looks.usda").write_text(block("usda", "variantSet"))
    for line in block("sh", "looks.usda").splitlines():
        _, *words = shlex.split(line)
        size = SMALL[2:] if words[0] == "relight" else SMALL
        status, _, err = run(*words, *size)
        assert (status, err) == (0, ""), line
    looks = Usd.Stage.Open("looks.usda")
    found = {}
    for name, source in (("evening", "evening.usdc"), ("captured", "shot.usda")):
        looks.GetPrimAtPath("/Scan").GetVariantSet("light").SetVariantSelection(name)
        found[name] = harmonics(looks)
        np.testing.assert_array_equal(found[name], harmonics(Usd.Stage.Open(source)))
        assert run("render", source, "-o", "b.exr", "--lighting", "shadowed", *SMALL)[0] == 0
        pictures = [oiio.ImageBuf(each).get_pixels() for each in (f"{name}.exr", "b.exr")]
        np.testing.assert_array_equal(*pictures)
    assert np.abs(found["evening"] - found["captured"]).max() > 0.1


def harmonics(stage: Usd.Stage) -> np.ndarray:
    """Return the coefficients of the capture on a stage."""
    return schema.fetch(stage.GetPrimAtPath("/Scan/splats"), None).sh.copy()
