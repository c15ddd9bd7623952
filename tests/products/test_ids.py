"""Tests that ids in files identify prims over a sequence and between runs."""

from __future__ import annotations

import json

import OpenImageIO as oiio
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdRender

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


def ids_in(path):
    """The table of a picture, and the values of each channel in the pixels with an id."""
    file = oiio.ImageInput.open(str(path))
    table = json.loads(file.spec().getattribute("usdsplat:ids"))
    file.seek_subimage(1, 0)
    names = list(file.spec().channelnames)
    pixels = file.read_image(1, 0, 0, len(names), "uint").reshape(-1, len(names))
    file.close()
    here = pixels[pixels[:, names.index("id")] != 2**32 - 1]
    return table, {name: here[:, names.index(name)].tolist() for name in names}


def seen_in(path):
    """Paths of the prims in a picture, by its ids and its table."""
    table, channels = ids_in(path)
    return tuple(table), {table[number] for number in channels["id"]}


def drawn(stage, tmp_path, *flags):
    aovs = () if "--aovs" in flags else ("--aovs", "color,id")
    words = ("render", stage, "-o", tmp_path / "a.$F.exr", *aovs, *flags)
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


@pytest.fixture
def scattered(crowd):
    """The crowd with an instancer of two prototypes: an instance of each hides at frame 2."""
    stage = Usd.Stage.Open(str(crowd))
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Scatter")
    for name, color in (("P0", (1, 0, 0)), ("P1", (0, 1, 0))):
        leaf = UsdGeom.Sphere.Define(stage, f"/World/Scatter/{name}")
        leaf.GetRadiusAttr().Set(0.08)
        leaf.GetDisplayColorAttr().Set([color])
    targets = ["/World/Scatter/P0", "/World/Scatter/P1"]
    instancer.CreatePrototypesRel().SetTargets(targets)
    instancer.CreateProtoIndicesAttr([0, 1, 0, 1])
    instancer.CreateIdsAttr([10, 11, 12, 13])
    instancer.CreatePositionsAttr([(x, 0.3, 0.9) for x in (-0.6, -0.2, 0.2, 0.6)])
    hidden = instancer.CreateInvisibleIdsAttr()
    hidden.Set([], 1)
    hidden.Set([10, 11], 2)
    hidden.Set([10, 12], 3)
    stage.GetRootLayer().Save()
    return crowd


def instances_in(path):
    """Pairs (path of the prim, instance) of the instances in a picture."""
    table, channels = ids_in(path)
    prims = (table[number] for number in channels["id"])
    pairs = set(zip(prims, channels["instanceId"], strict=True))
    return {pair for pair in pairs if "/Scatter/" in pair[0]}


def test_hidden_instances_move_no_id(scattered, tmp_path):
    """Oracle: prototypes and invisibleIds as authored; an instance keeps its number, and a
    prototype of which no instance is left keeps its place in the table."""
    drawn(scattered, tmp_path, "--frames", "1-3", "--aovs", "color,id,instanceId")
    first, second = "/World/Scatter/P0", "/World/Scatter/P1"
    expected = {
        1: {(first, 0), (second, 1), (first, 2), (second, 3)},
        2: {(first, 2), (second, 3)},
        3: {(second, 1), (second, 3)},
    }
    for frame, pairs in expected.items():
        picture = tmp_path / f"a.{frame}.exr"
        assert instances_in(picture) == pairs
        assert seen_in(picture)[0] == tuple(sorted((*NAMES, first, second)))


def test_products_of_other_purposes_have_the_same_ids(scattered, tmp_path):
    """Oracle: a prim of each purpose; both products of one run, and a run of one product alone."""
    stage = Usd.Stage.Open(str(scattered))
    for name, purpose in (("A", "guide"), ("C", "proxy")):
        prim = UsdGeom.Imageable(stage.GetPrimAtPath(f"/World/{name}"))
        prim.GetPurposeAttr().Set(purpose)
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    settings.GetResolutionAttr().Set(Gf.Vec2i(60, 40))
    for name, purposes in (("beauty", ["default"]), ("helpers", ["guide", "proxy"])):
        product = UsdRender.Product.Define(stage, f"/Render/{name}")
        product.GetProductNameAttr().Set(str(tmp_path / f"{name}.$F.exr"))
        attribute = product.GetPrim().CreateAttribute(
            "includedPurposes", Sdf.ValueTypeNames.TokenArray
        )
        attribute.Set(purposes)
        for source in ("Ci", "primId"):
            var = UsdRender.Var.Define(stage, f"/Render/Vars/{source}")
            var.GetSourceNameAttr().Set(source)
            product.GetOrderedVarsRel().AddTarget(var.GetPath())
        settings.GetProductsRel().AddTarget(product.GetPath())
    stage.GetRootLayer().Save()
    assert main(["render", str(scattered), "--frames", "1-2"]) == 0
    beauty, helpers = (seen_in(tmp_path / f"{name}.1.exr") for name in ("beauty", "helpers"))
    assert beauty[0] == helpers[0] == seen_in(tmp_path / "helpers.2.exr")[0]
    prototypes = {"/World/Scatter/P0", "/World/Scatter/P1"}
    assert beauty[1] == {"/World/Ball", "/World/Floor", *prototypes}
    assert helpers[1] == {"/World/A", "/World/C"}
    assert seen_in(tmp_path / "helpers.2.exr")[1] == {"/World/C"}
    words = ["--product", "/Render/helpers", "-o", str(tmp_path / "alone.exr"), "--frames", "2"]
    assert main(["render", str(scattered), *words]) == 0
    assert seen_in(tmp_path / "alone.exr") == seen_in(tmp_path / "helpers.2.exr")
