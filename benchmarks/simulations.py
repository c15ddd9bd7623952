"""Simulate real captures, and make a strip of pictures of each: `docs/sim_*.png`.

    python -m benchmarks.simulations [NAME ...]

The examples show the same on a small generated capture; here captures of the test data are used.
All meshes that push or attract splats are visible in the pictures.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, Vt

from benchmarks.scenes import DATA
from usdsplat import schema
from usdsplat.cli.main import main as usdsplat
from usdsplat.delegate.engine import Engine
from usdsplat.render.settings import RenderSettings
from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.torus import author_torus

CAMERA = "/Shot"
BACKGROUND = (0.09, 0.1, 0.12)
LIMIT = 300_000
"""Maximum size of a strip [byte]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Strip:
    """A simulation with the frames to show."""

    capture: str
    preset: str
    frames: tuple[int, ...]
    edit: Callable[[Usd.Stage], None]
    """Function that edits the preset's stage, including its camera."""
    size: tuple[int, int] = (480, 640)
    """Size of a picture [pixel], before the strip is reduced."""


def part(stage: Usd.Stage, name: str) -> Sdf.Path:
    """Return the path of a prim of the simulation that a preset authored."""
    return stage.GetDefaultPrim().GetPath().AppendPath(f"Simulation/{name}")


def shoot(
    stage: Usd.Stage, eye: tuple[float, ...], at: tuple[float, ...], angle: float = 30.0
) -> None:
    """Author a camera at an elevation of `angle` degrees, a light from above left, and a fainter
    one."""
    camera = UsdGeom.Camera.Define(stage, CAMERA)
    view = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*at), Gf.Vec3d(0, 1, 0))
    camera.AddTransformOp().Set(view.GetInverse())
    camera.CreateVerticalApertureAttr(24.0)
    camera.CreateHorizontalApertureAttr(18.0)
    camera.CreateFocalLengthAttr(12.0 / np.tan(np.radians(angle) / 2))
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1000))
    for name, strength, up, side in (("Key", 2.6, -50, -40), ("Fill", 0.7, -10, 60)):
        light = UsdLux.DistantLight.Define(stage, f"/{name}")
        light.CreateIntensityAttr(strength)
        light.CreateNormalizeAttr(True)
        place = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d.XAxis(), up))
        place *= Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d.YAxis(), side))
        light.AddTransformOp().Set(place * view.GetInverse())


def grow(stage: Usd.Stage) -> None:
    """Grow coral on a bust."""
    stage.GetPrimAtPath(part(stage, "Ball")).SetActive(False)
    shoot(stage, (-1.3, 1.6, -3.6), (0.0, 1.15, 0))


def push(stage: Usd.Stage) -> None:
    """Move a ball through a statue."""
    ball = UsdGeom.Sphere.Get(stage, part(stage, "Ball"))
    ball.GetDisplayColorAttr().Set([(0.75, 0.16, 0.05)])
    ball.GetRadiusAttr().Set(0.27)
    move = ball.GetTranslateOp()
    for frame in move.GetAttr().GetTimeSamples():
        move.GetAttr().ClearAtTime(frame)
    for frame, x in ((1, -1.2), (30, 1.4)):
        move.Set(Gf.Vec3d(x, 1.05, 0.22), frame)
    author(ball.GetPrim(), {"affector:friction": 0.05})
    shoot(stage, (2.2, 1.7, 4.9), (0.05, 1.0, 0))


def walk(stage: Usd.Stage) -> None:
    """Let a figure walk out of a flower bed."""
    stage.GetPrimAtPath(part(stage, "Ball")).SetActive(False)
    figure = stage.DefinePrim(part(stage, "Figure"))
    figure.GetReferences().AddReference(str(DATA / "usd" / "usdwg" / "CesiumMan.usdz"))
    place = UsdGeom.Xformable(figure)
    place.ClearXformOpOrder()
    move = place.AddTranslateOp()
    for frame, z in ((1, -0.13), (36, 0.17)):
        move.Set(Gf.Vec3d(-0.02, 0.022, z), frame)
    place.AddScaleOp().Set(Gf.Vec3f(0.115))
    for prim in Usd.PrimRange(figure):
        if prim.GetTypeName() == "Skeleton":
            author(prim, {"affector:friction": 0.0, "affector:radiusScale": 1.1})
    author(stage.GetPrimAtPath(part(stage, "Sim")), {"settle:omega": 6.0})
    shoot(stage, (0.1, 0.26, 0.64), (-0.015, 0.1, 0.03))


def conform(stage: Usd.Stage) -> None:
    """Conform a kettle to a doughnut."""
    select(stage, lambda points: points[:, 1] > -0.078)
    path = part(stage, "Ring")
    stage.RemovePrim(path)
    ring = author_torus(stage, path, radius=0.042, tube=0.023, axis="Y")
    ring.GetDisplayColorAttr().Set([(0.5, 0.3, 0.12)])
    turn = ring.AddRotateYOp()
    for frame, angle in ((1, 0.0), (48, 60.0)):
        turn.Set(angle, frame)
    author(
        stage.GetPrimAtPath(part(stage, "Sim")),
        {
            "conform:start": 0.1,
            "conform:duration": 1.0,
            "conform:stagger": 0.5,
            "conform:mode": "closest",
            "conform:scaleMode": "density",
        },
    )
    shoot(stage, (0.2, 0.26, 0.4), (0.005, -0.005, 0))


def dissolve(stage: Usd.Stage) -> None:
    """Dissolve a statue in the wind."""
    select(stage, lambda points: points[:, 1] > 0.03)
    shoot(stage, (2.5, 2.0, 5.3), (0.35, 1.05, 0))


def select(stage: Usd.Stage, which: Callable[[np.ndarray], np.ndarray]) -> None:
    """Select the splats at some positions in the stage's space for the simulation."""
    for prim in stage.Traverse():
        if schema.is_splat_field(prim):
            place = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0))
            points = schema.fetch(prim).positions @ place[:3, :3] + place[3, :3]
            mask = Vt.FloatArray.FromNumpy(which(points).astype(np.float32))
            name = "primvars:splatSim:weight"
            prim.CreateAttribute(name, Sdf.ValueTypeNames.FloatArray).Set(mask)


STRIPS = {
    "growth": Strip(
        capture="statue_massa.sog", preset="grow", frames=(1, 13, 25, 37, 50), edit=grow
    ),
    "affector": Strip(
        capture="statue_angel.sog", preset="push", frames=(4, 12, 16, 21, 40), edit=push
    ),
    "skeleton": Strip(
        capture="flowers_lod2_0.sog", preset="push", frames=(6, 15, 21, 28, 36), edit=walk
    ),
    "conform": Strip(capture="pod.spz", preset="conform", frames=(1, 14, 22, 30, 48), edit=conform),
    "dissolve": Strip(
        capture="statue_angel.sog", preset="dissolve", frames=(1, 18, 30, 42, 58), edit=dissolve
    ),
}


def bake(strip: Strip, folder: Path) -> Path:
    """Make the stage and simulate it. Return the layer of results."""
    made, baked = folder / "scene.usda", folder / "bake.usda"
    run(f"simulate --preset {strip.preset} {DATA / 'splats' / strip.capture} -o {made}")
    stage = Usd.Stage.Open(str(made))
    strip.edit(stage)
    stage.Save()
    run(f"simulate {made} -o {baked} --frames 1:{strip.frames[-1]}")
    return baked


def pictures(strip: Strip, baked: Path) -> np.ndarray:
    """Return the frames of the strip side by side, shape (h, w, 3)."""
    shot = Usd.Stage.Open(str(baked))
    row = []
    with Engine(shot, time=strip.frames[0]) as engine:
        for frame in strip.frames:
            engine.set_time(frame)
            view = engine.view(CAMERA, resolution=strip.size)
            color = engine.picture(view, RenderSettings(color_mode="display", samples=4))["color"]
            row.append(color[..., :3] + (1 - color[..., 3:]) * np.float32(BACKGROUND))
    return np.concatenate(row, axis=1)


def run(command: str) -> None:
    """Run a command of usdsplat, which must succeed."""
    if usdsplat(command.split()):
        raise SystemExit(f"usdsplat {command} failed")


def save(image: np.ndarray, path: Path) -> None:
    """Write an 8-bit PNG with a palette, as large as the limit allows."""
    from PIL import Image

    rgb = Image.fromarray(np.uint8(np.clip(image, 0, 1) * 255 + 0.5))
    height, size = rgb.height, LIMIT + 1
    while size > LIMIT:
        small = rgb.resize((round(rgb.width * height / rgb.height), height), Image.LANCZOS)
        small.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=1, dither=Image.Dither.NONE).save(
            path, optimize=True
        )
        size = path.stat().st_size
        height = round(0.98 * height * min(1, LIMIT / size) ** 0.5)
    print(f"{path}: {small.width}x{small.height}, {size // 1000} kB")


def main(names: list[str]) -> None:
    """Make the strips of these names, or all."""
    for name in names or STRIPS:
        with tempfile.TemporaryDirectory() as folder:
            baked = bake(STRIPS[name], Path(folder))
            save(pictures(STRIPS[name], baked), Path("docs") / f"sim_{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
