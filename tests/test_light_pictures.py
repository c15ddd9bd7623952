"""Tests of the picture of lighting: what its page shows is what draws it."""

from __future__ import annotations

from pathlib import Path

from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

from benchmarks import light_pictures

PAGE = Path(__file__).resolve().parents[1] / "docs" / "lighting.md"


def test_the_page_shows_the_lights_and_the_commands() -> None:
    """Oracle: the constants from which the picture is made."""
    text = PAGE.read_text("utf-8")
    for shown in (light_pictures.DAY, light_pictures.EVENING, light_pictures.COMMANDS):
        assert f"\n{shown}```" in text


def test_the_stages_hold_together(tmp_path: Path) -> None:
    """Oracle: USD's own types, and the normals of the triangles of the backdrop."""
    usd = Usd.Stage.CreateNew(str(tmp_path / "statue.usdc"))
    usd.SetDefaultPrim(usd.DefinePrim("/Statue"))
    usd.Save()
    light_pictures.write_set(tmp_path, (200, 100))
    for name, count in (("day", 1), ("evening", 3)):
        stage = Usd.Stage.Open(str(tmp_path / f"{name}.usda"))
        lights = [prim for prim in stage.Traverse() if prim.HasAPI(UsdLux.LightAPI)]
        assert len(lights) == count and not stage.GetCompositionErrors()
        for light in lights:
            collection = UsdLux.LightAPI(light).GetShadowLinkCollectionAPI()
            members = collection.ComputeMembershipQuery()
            assert not members.IsPathIncluded(Sdf.Path("/World/Backdrop"))
            assert members.IsPathIncluded(Sdf.Path("/World/Statue"))
    mesh = UsdGeom.Mesh.Get(stage, "/World/Backdrop")
    points, normals = mesh.GetPointsAttr().Get(), mesh.GetNormalsAttr().Get()
    indices = mesh.GetFaceVertexIndicesAttr().Get()
    for first in range(0, len(indices), 4):
        a, b, c = (points[indices[first + corner]] for corner in range(3))
        facing = Gf.Cross(b - a, c - a).GetNormalized()
        assert Gf.Dot(facing, normals[indices[first]]) > 0.99
