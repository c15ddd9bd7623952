"""Tests of Cryptomatte in files of `usdsplat render`, read as compositors read them."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdRender, UsdShade

from tests.cli.conftest import ball
from tests.cli.test_render import SMALL
from usdsplat import schema

pytestmark = pytest.mark.usefixtures("compiled")

LAYERS = "cryptoObject,cryptoAsset,cryptoMaterial"
PRIMS = ("/World/Ball", "/World/Pair/One", "/World/Pair/Two", "/World/Floor")
GROUPS = {
    "cryptoObject": {path: (path,) for path in PRIMS},
    "cryptoAsset": {"/World/Pair": PRIMS[1:3], "/World": (PRIMS[0], PRIMS[3])},
    "cryptoMaterial": {"/World/Looks/moss": (PRIMS[1], PRIMS[3]), "default": (PRIMS[0], PRIMS[2])},
}
"""Layer -> name -> prims, of `set_dressed`."""


@pytest.fixture
def set_dressed(shot: Path) -> Path:
    """The shot with a pair of balls that is a component, and a floor; one of the pair and the floor
    have a material."""
    stage = Usd.Stage.Open(str(shot))
    pair = UsdGeom.Xform.Define(stage, "/World/Pair")
    Usd.ModelAPI(pair).SetKind("component")
    pair.AddTranslateOp().Set(Gf.Vec3d(0.3, 0.2, -0.5))
    schema.author(stage, "/World/Pair/One", ball(200, seed=1))
    two = schema.author(stage, "/World/Pair/Two", ball(200, seed=2))
    UsdGeom.Xformable(two).AddTranslateOp().Set(Gf.Vec3d(-0.5, -0.3, 0.2))
    floor = UsdGeom.Mesh.Define(stage, "/World/Floor")
    floor.CreatePointsAttr([(-1, -0.9, -0.2), (1, -0.9, -0.2), (1, 0.1, -0.4), (-1, 0.1, -0.4)])
    floor.CreateFaceVertexCountsAttr([4])
    floor.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    moss = UsdShade.Material.Define(stage, "/World/Looks/moss")
    surface = UsdShade.Shader.Define(stage, "/World/Looks/moss/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    output = surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    moss.CreateSurfaceOutput().ConnectToSource(output)
    for path in ("/World/Pair/One", "/World/Floor"):
        UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath(path)).Bind(moss)
    stage.GetRootLayer().Save()
    return shot


def mattes_of(path: Path) -> dict[str, dict[str, np.ndarray]]:
    """Layer -> name -> coverage, by the Cryptomatte specification 1.2 alone: layers and names are
    found in the header, ranks by channel names."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        entries = dict(file.header())
        channels = {name: each.pixels for name, each in file.channels().items()}
    found = {}
    for key in {name.split("/")[1] for name in entries if name.startswith("cryptomatte/")}:
        layer = entries[f"cryptomatte/{key}/name"]
        manifest = json.loads(entries[f"cryptomatte/{key}/manifest"])
        ranked = sorted({name[:-2] for name in channels if name.startswith(layer)})
        assert ranked == [f"{layer}{number:02d}" for number in range(len(ranked))]
        found[layer] = {}
        for name, digits in manifest.items():
            (wanted,) = struct.unpack("<f", struct.pack("<I", int(digits, 16)))
            found[layer][name] = sum(
                np.where(channels[f"{rank}.{a}"] == np.float32(wanted), channels[f"{rank}.{b}"], 0)
                for rank in ranked
                for a, b in ("RG", "BA")
            )
    return found


def alpha_of(path: Path) -> np.ndarray:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return file.channels()["A"].pixels


@pytest.mark.parametrize("flags", [(), ("--sorting", "rayHitDistance"), ("--samples", "3")])
def test_every_name_of_every_layer_selects_its_pixels(run, set_dressed, tmp_path, flags) -> None:
    """Oracle: a reader that knows the specification alone; the alpha of pictures in which all other
    prims hold out."""
    words = ("--frames", 1, "--float", *SMALL, *flags)
    out = ("-o", tmp_path / "a.exr", "--aovs", f"color,{LAYERS}")
    assert run("render", set_dressed, *out, *words)[0] == 0
    alone = {}
    for prim in PRIMS:
        others = ",".join(each for each in PRIMS if each != prim)
        target = tmp_path / f"alone{PRIMS.index(prim)}.exr"
        assert run("render", set_dressed, "-o", target, "--matte", others, *words)[0] == 0
        alone[prim] = alpha_of(target)
        assert alone[prim].max() > 0.5
    found = mattes_of(tmp_path / "a.exr")
    assert {layer: set(names) for layer, names in found.items()} == {
        layer: set(names) for layer, names in GROUPS.items()
    }
    for layer, names in GROUPS.items():
        for name, prims in names.items():
            expected = sum(alone[prim] for prim in prims)
            np.testing.assert_allclose(found[layer][name], expected, atol=2e-3, err_msg=name)
        np.testing.assert_allclose(
            sum(found[layer].values()), alpha_of(tmp_path / "a.exr"), atol=1e-5
        )


@pytest.mark.parametrize(("rank", "pairs"), [(2, 1), (5, 3), (16, 8)])
@pytest.mark.parametrize("source", ["flag", "stage"])
def test_the_rank_is_a_flag_and_an_attribute(
    run, set_dressed, tmp_path, source: str, rank: int, pairs: int
) -> None:
    """Oracle: the names of the channels; four of them hold two pairs."""
    flags = ("--crypto-rank", rank) if source == "flag" else ()
    if source == "stage":
        stage = Usd.Stage.Open(str(set_dressed))
        settings = UsdRender.Settings.Define(stage, "/Render/Main")
        product = UsdRender.Product.Define(stage, "/Render/One")
        product.GetProductNameAttr().Set(str(tmp_path / "a.exr"))
        settings.GetProductsRel().AddTarget(product.GetPath())
        assert settings.GetPrim().ApplyAPI("SplatRenderSettingsAPI")
        settings.GetPrim().GetAttribute("splat:cryptoRank").Set(rank)
        stage.GetRootLayer().Save()
    out = ("-o", tmp_path / "a.exr", "--aovs", "cryptoAsset")
    assert run("render", set_dressed, *out, "--frames", 1, *SMALL, *flags)[0] == 0
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = sorted(file.channels())
    assert channels == sorted(f"cryptoAsset{k:02d}.{c}" for k in range(pairs) for c in "RGBA")


@pytest.mark.parametrize("rank", ["1", "17"])
def test_a_rank_out_of_range_is_one_sentence(run, shot, tmp_path, rank: str) -> None:
    """Oracle: the range of the documentation; no file is left."""
    status, _, err = run("render", shot, "-o", tmp_path / "a.exr", "--crypto-rank", rank)
    assert status == 2
    assert err.startswith("usdsplat: --crypto-rank: found ") and len(err.splitlines()) == 1
    assert not (tmp_path / "a.exr").exists()


@pytest.mark.parametrize(
    "spelling", ["crypto{}", "crypto_{}", "Crypto{}"], ids=["ours", "Arnold's", "Blender's"]
)
def test_vars_ask_for_layers_in_several_spellings(
    run_json, set_dressed, tmp_path, spelling: str
) -> None:
    """Of a product of husk's kind. Oracle: the layers in the file's header, and the AOVs in the
    report."""
    stage = Usd.Stage.Open(str(set_dressed))
    settings = UsdRender.Settings.Define(stage, "/Render/Main")
    product = UsdRender.Product.Define(stage, "/Render/One")
    product.GetProductNameAttr().Set(str(tmp_path / "a.exr"))
    for word in ("Object", "Asset", "Material"):
        var = UsdRender.Var.Define(stage, f"/Render/{word}")
        name = spelling.format(word.lower() if spelling.endswith("_{}") else word)
        var.GetSourceNameAttr().Set(name)
        product.GetOrderedVarsRel().AddTarget(var.GetPath())
    settings.GetProductsRel().AddTarget(product.GetPath())
    stage.GetRootLayer().Save()
    (drawn,) = run_json("render", set_dressed, "--frames", 1, *SMALL)["pictures"]
    assert ",".join(drawn["aovs"]) == LAYERS
    assert mattes_of(tmp_path / "a.exr").keys() == GROUPS.keys()


@pytest.mark.parametrize("flags", [(), ("--deep",)])
def test_a_prim_that_is_hidden_at_the_frame_has_a_name(run, shot, tmp_path, flags):
    """Oracle: the authored visibility: `Late` is visible before the frame, in the first half of the
    shutter, so its hash is in the picture."""
    stage = Usd.Stage.Open(str(shot))
    seen = UsdGeom.Imageable(schema.author(stage, "/World/Late", ball(200))).GetVisibilityAttr()
    seen.Set("inherited", 1.5)
    seen.Set("invisible", 2.0)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Cam"))
    camera.CreateShutterOpenAttr(-0.5)
    camera.CreateShutterCloseAttr(0.5)
    stage.GetRootLayer().Save()
    words = ("--frames", 2, "--samples", 4, "--aovs", "color,cryptoObject", *flags)
    output = tmp_path / "a.exr"
    assert run("render", shot, "-o", output, "--camera", "/World/Cam", *words, *SMALL)[0] == 0
    entries = OpenEXR.File(str(output)).header()
    (manifest,) = (json.loads(entries[key]) for key in entries if key.endswith("/manifest"))
    assert list(manifest) == ["/World/Ball", "/World/Late"]
