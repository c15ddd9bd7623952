"""Tests that ids in files identify prims over a sequence and between runs."""

from __future__ import annotations

import json

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Usd, UsdGeom

from tests.cli.conftest import ball
from usdsplat import main, schema

pytestmark = pytest.mark.usefixtures("compiled")

NAMES = ("/World/A", "/World/Ball", "/World/C", "/World/Floor")


@pytest.fixture
def crowd(shot):
    """The shot with two more balls and a sphere, each at a place of its own; A hides at frame 2."""
    stage = Usd.Stage.Open(str(shot))
    for name, x in (("A", -1.0), ("C", 1.0)):
        prim = schema.author(stage, f"/World/{name}", ball(100))
        UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(x, 0, 0))
    floor = UsdGeom.Sphere.Define(stage, "/World/Floor")
    floor.AddTranslateOp().Set(Gf.Vec3d(0, 0, 0.9))
    floor.GetRadiusAttr().Set(0.1)
    seen = UsdGeom.Imageable(stage.GetPrimAtPath("/World/A")).GetVisibilityAttr()
    seen.Set("inherited", 1)
    seen.Set("invisible", 2)
    stage.GetRootLayer().Save()
    return shot


def seen_in(path):
    """Paths of the prims in a picture, by its ids and its table."""
    file = oiio.ImageInput.open(str(path))
    table = json.loads(file.spec().getattribute("usdsplat:ids"))
    file.seek_subimage(1, 0)
    ids = np.unique(file.read_image(1, 0, 0, 1, "uint"))
    file.close()
    return tuple(table), {table[number] for number in ids if number != 2**32 - 1}


def drawn(stage, tmp_path, *flags):
    words = ("render", stage, "-o", tmp_path / "a.$F.exr", "--aovs", "color,id", *flags)
    assert main([str(word) for word in (*words, "--resolution", "60x40")]) == 0


def test_a_hidden_prim_moves_no_other_id(crowd, tmp_path):
    """Oracle: the authored visibility; OpenImageIO's reader of ids and table."""
    drawn(crowd, tmp_path, "--frames", "1-2")
    assert seen_in(tmp_path / "a.1.exr") == (NAMES, set(NAMES))
    assert seen_in(tmp_path / "a.2.exr") == (NAMES, set(NAMES[1:]))


def test_another_run_has_the_same_ids(crowd, tmp_path):
    """Oracle: the first run's table, while another layer hides and purposes leave out prims."""
    stage = Usd.Stage.Open(str(crowd))
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/C")).GetPurposeAttr().Set("guide")
    UsdGeom.Imageable(stage.GetPrimAtPath("/World/Ball")).MakeInvisible()
    stage.GetRootLayer().Save()
    drawn(crowd, tmp_path, "--frames", 1)
    assert seen_in(tmp_path / "a.1.exr") == (NAMES, {"/World/A", "/World/Floor"})
    drawn(crowd, tmp_path, "--frames", 1, "--purposes", "guide")
    assert seen_in(tmp_path / "a.1.exr") == (NAMES, {"/World/C"})
