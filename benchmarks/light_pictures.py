"""Light a capture with a dome, and relight it: `docs/lighting.jpg`.

    python -m benchmarks.light_pictures [--scale N] [--folder DIR] [SHEET]

A marble statue of the test data, without its plinth, kneels on a backdrop. Stages, captures and
pictures are in DIR, and remain there if it is given. `--scale 3` is for looking at details.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Usd, UsdGeom, Vt

from benchmarks.scenes import DATA
from usdsplat.cli.main import main as usdsplat

CAPTURE = DATA / "splats" / "statue_angel.sog"
SKY = DATA / "usd" / "hdri" / "StinsonBeach.hdr"
SIZE = (496, 580)
"""Size of a picture on the sheet [pixel]. It is drawn twice as large."""
GAP, STRIP = 6, 30
"""Pixels between pictures, and height of the line of text below each [pixel]."""
LIMIT = 300_000
"""Maximum size of the sheet [byte]."""

HEAD = """#usda 1.0
(
    defaultPrim = "World"
    subLayers = [@./set.usda@]
    upAxis = "Y"
)
"""
DAY = """over "World"
{
    def DomeLight "Beach" (prepend apiSchemas = ["CollectionAPI:shadowLink"])
    {
        asset inputs:texture:file = @./StinsonBeach.hdr@
        float inputs:exposure = 1
        rel collection:shadowLink:excludes = </World/Backdrop>
        float xformOp:rotateY = -108
        uniform token[] xformOpOrder = ["xformOp:rotateY"]
    }
}
"""
EVENING = """over "World"
{
    def SphereLight "Key" (prepend apiSchemas = ["CollectionAPI:shadowLink"])
    {
        color3f inputs:color = (1, 0.52, 0.22)
        float inputs:intensity = 900
        float inputs:radius = 0.2
        rel collection:shadowLink:excludes = </World/Backdrop>
        double3 xformOp:translate = (-2.8, 1.1, 2.4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def RectLight "Rim" (prepend apiSchemas = ["CollectionAPI:shadowLink"])
    {
        color3f inputs:color = (0.3, 0.55, 1)
        float inputs:intensity = 90
        float inputs:width = 0.8
        float inputs:height = 1.6
        rel collection:shadowLink:excludes = </World/Backdrop>
        double3 xformOp:translate = (2.4, 2.2, -1.6)
        float3 xformOp:rotateXYZ = (-20, 123, 0)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    }

    def DomeLight "Night" (prepend apiSchemas = ["CollectionAPI:shadowLink"])
    {
        color3f inputs:color = (0.5, 0.65, 1)
        float inputs:intensity = 0.03
        rel collection:shadowLink:excludes = </World/Backdrop>
    }
}
"""
COMMANDS = """usdsplat convert statue_angel.sog angel.usdc --crop-box -1,-3,-1,1,0,1
usdsplat normals angel.usdc -o statue.usdc
usdsplat render day.usda -o captured.png
usdsplat render day.usda -o shadowed.png --lighting shadowed
usdsplat relight evening.usda -o relit.usdc --self-shadows
usdsplat render relit.usdc -o relit.png --lighting shadowed
"""
PICTURES = {
    "captured": "captured: lights, no shadows",
    "shadowed": "shadowed: the sun and the sky of an HDRI",
    "relit": "relit: a warm key and a cool rim",
}
"""Name of a picture -> what is written below it."""


def write_set(folder: Path, size: tuple[int, int]) -> None:
    """Write the stages: the statue, a backdrop and a camera, and two stages with lights over it.

    Args:
        size: Size of the pictures [pixel].
    """
    stage = Usd.Stage.CreateNew(str(folder / "set.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    statue = UsdGeom.Xform.Define(stage, "/World/Statue")
    statue.AddRotateYOp().Set(-112.0)
    field = stage.DefinePrim("/World/Statue/Capture")
    field.GetReferences().AddReference("./statue.usdc")
    _author_backdrop(UsdGeom.Mesh.Define(stage, "/World/Backdrop"))
    at, eye = Gf.Vec3d(0.28, 1.0, 0), Gf.Vec3d(0.28, 1.9, 7.4)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    view = Gf.Matrix4d().SetLookAt(eye, at, Gf.Vec3d(0, 1, 0))
    camera.AddTransformOp().Set(view.GetInverse())
    camera.CreateVerticalApertureAttr(24.0)
    camera.CreateHorizontalApertureAttr(24.0 * size[0] / size[1])
    camera.CreateFocalLengthAttr(66.0)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.1, 100.0))
    stage.Save()
    for name, lights in (("day", DAY), ("evening", EVENING)):
        (folder / f"{name}.usda").write_text(HEAD + lights)


def _author_backdrop(mesh: UsdGeom.Mesh) -> None:
    """Author a floor that curves up to a wall."""
    front, back, radius, half, top = 8.0, -3.0, 2.5, 14.0, 9.0
    turn = np.linspace(0, np.pi / 2, 33)
    y = np.concatenate([[0], radius - radius * np.cos(turn), [top]])
    z = np.concatenate([[front], back - radius * np.sin(turn), [back - radius]])
    turn = np.concatenate([turn[:1], turn, turn[-1:]])
    x, rows = np.repeat([-half, half], len(y)), np.arange(len(y) - 1)
    points = np.stack([x, np.tile(y, 2), np.tile(z, 2)], axis=1)
    normals = np.stack([0 * x, np.tile(np.cos(turn), 2), np.tile(np.sin(turn), 2)], axis=1)
    faces = np.stack([rows, rows + len(y), rows + len(y) + 1, rows + 1], axis=1)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateFaceVertexCountsAttr([4] * len(faces))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.ravel().astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDisplayColorAttr([(0.3, 0.26, 0.22)])


def draw(folder: Path, size: tuple[int, int]) -> None:
    """Run `COMMANDS` in a folder.

    Args:
        size: Size of the pictures [pixel].
    """
    for path in (CAPTURE, SKY):
        shutil.copyfile(path, folder / path.name)
    for line in COMMANDS.splitlines():
        _, name, *words = line.split()
        words = [
            str(folder / word) if word.endswith((".sog", ".usda", ".usdc", ".png")) else word
            for word in words
        ]
        if name == "render":
            words += ["--resolution", f"{size[0]}x{size[1]}"]
        if usdsplat([name, "-q", *words]):
            raise SystemExit(f"{line}: found an error")
        if name == "normals":
            write_set(folder, size)


def sheet_of(folder: Path) -> Any:
    """Return the pictures of a folder side by side, with a line about each."""
    from PIL import Image, ImageDraw, ImageFont

    width = len(PICTURES) * (SIZE[0] + GAP) - GAP
    sheet = Image.new("RGB", (width, SIZE[1] + STRIP), (24, 24, 24))
    font, write = ImageFont.load_default(16), ImageDraw.Draw(sheet)
    for column, (name, text) in enumerate(PICTURES.items()):
        x = column * (SIZE[0] + GAP)
        picture = Image.open(folder / f"{name}.png").convert("RGB")
        sheet.paste(picture.resize(SIZE, Image.Resampling.LANCZOS), (x, 0))
        write.text((x + 10, SIZE[1] + 5), text, (225, 225, 225), font)
    return sheet


def main() -> None:
    """Draw the pictures, and write the sheet."""
    parser = argparse.ArgumentParser(prog="light_pictures")
    parser.add_argument("sheet", nargs="?", type=Path, default=Path("docs") / "lighting.jpg")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--scale", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        draw(folder, (options.scale * SIZE[0], options.scale * SIZE[1]))
        sheet_of(folder).save(options.sheet, quality=90)
    if options.sheet.stat().st_size > LIMIT:
        raise SystemExit(f"{options.sheet}: found {options.sheet.stat().st_size} bytes")


if __name__ == "__main__":
    main()
