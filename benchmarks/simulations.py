"""Simulations of real captures, a strip of pictures each: `docs/sim_*.png`.

    python -m benchmarks.simulations [NAME ...]

What the examples show on a small made-up capture, on captures of the test data. Everything that
pushes splats or draws them to it is in the pictures, as the mesh that it is.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdLux

from benchmarks.scenes import DATA
from usdsplat.cli.main import main as usdsplat
from usdsplat.delegate.engine import Engine
from usdsplat.delegate.render_settings import RenderSettings

CAMERA = "/Shot"
SIM = "/World/Simulation/Sim"
BACKGROUND = (0.09, 0.1, 0.12)
LIMIT = 300_000
"""[byte] of a strip."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Strip:
    """One simulation and which of its frames are shown."""

    capture: str
    preset: str
    frames: tuple[int, ...]
    edit: Callable[[Usd.Stage], None]
    """Makes the preset's stage what it is to be, its camera included."""
    size: tuple[int, int] = (480, 640)
    """[pixel] of a picture, before the strip is made smaller."""


def shoot(
    stage: Usd.Stage, eye: tuple[float, ...], at: tuple[float, ...], angle: float = 30.0
) -> None:
    """A camera, `angle` degrees high, and a light from above its left."""
    camera = UsdGeom.Camera.Define(stage, CAMERA)
    view = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*at), Gf.Vec3d(0, 1, 0))
    camera.AddTransformOp().Set(view.GetInverse())
    camera.CreateVerticalApertureAttr(24.0)
    camera.CreateHorizontalApertureAttr(18.0)
    camera.CreateFocalLengthAttr(12.0 / np.tan(np.radians(angle) / 2))
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1000))
    sun = UsdLux.DistantLight.Define(stage, "/Sun")
    sun.CreateIntensityAttr(2.6)
    turn = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d.XAxis(), -50))
    around = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d.YAxis(), -40))
    sun.AddTransformOp().Set(turn * around * Gf.Matrix4d(camera.GetLocalTransformation()))
    dome = UsdLux.DomeLight.Define(stage, "/Sky")
    dome.CreateIntensityAttr(0.5)


def grow(stage: Usd.Stage) -> None:
    """A labyrinth on a statue."""
    shoot(stage, (2.5, 1.9, 4.5), (0, 1.0, 0))


def push(stage: Usd.Stage) -> None:
    """A ball rolls through a flower bed."""
    shoot(stage, (0.3, 0.5, 0.9), (0, 0.05, 0))


def walk(stage: Usd.Stage) -> None:
    """A figure wades through it."""
    shoot(stage, (0.3, 0.5, 0.9), (0, 0.05, 0))


def conform(stage: Usd.Stage) -> None:
    """A statue becomes a ring."""
    shoot(stage, (2.5, 1.9, 4.5), (0, 1.0, 0))


def dissolve(stage: Usd.Stage) -> None:
    """The wind takes a statue."""
    shoot(stage, (2.5, 1.9, 4.5), (0, 1.0, 0))


STRIPS = {
    "growth": Strip(
        capture="statue_angel.sog", preset="grow", frames=(1, 25, 50, 75, 100), edit=grow
    ),
    "affector": Strip(
        capture="flowers_lod2_0.sog", preset="push", frames=(1, 25, 40, 55, 75), edit=push
    ),
    "conform": Strip(
        capture="statue_trumpet.sog", preset="conform", frames=(1, 25, 40, 60, 100), edit=conform
    ),
    "dissolve": Strip(
        capture="statue_angel.sog", preset="dissolve", frames=(1, 20, 35, 50, 65), edit=dissolve
    ),
}


def pictures(strip: Strip, folder: Path) -> np.ndarray:
    """The strip's frames side by side, shape (h, w, 3)."""
    made, baked = folder / "scene.usda", folder / "bake.usda"
    source = DATA / "splats" / strip.capture
    run(f"simulate --preset {strip.preset} {source} -o {made}")
    stage = Usd.Stage.Open(str(made))
    strip.edit(stage)
    stage.Save()
    run(f"simulate {made} -o {baked} --frames {strip.frames[0]}:{strip.frames[-1]}")
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
    """A command of usdsplat's that must succeed."""
    if usdsplat(command.split()):
        raise SystemExit(f"usdsplat {command} failed")


def save(image: np.ndarray, path: Path) -> None:
    """An 8-bit PNG with a palette of its own, as large as the limit allows."""
    from PIL import Image

    rgb = Image.fromarray(np.uint8(np.clip(image, 0, 1) * 255 + 0.5))
    for height in range(rgb.height, 100, -16):
        small = rgb.resize((round(rgb.width * height / rgb.height), height), Image.LANCZOS)
        small.quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size <= LIMIT:
            print(f"{path}: {small.width}x{small.height}, {path.stat().st_size // 1000} kB")
            return


def main(names: list[str]) -> None:
    """Make the strips of these names, or all."""
    for name in names or STRIPS:
        with tempfile.TemporaryDirectory() as folder:
            save(pictures(STRIPS[name], Path(folder)), Path("docs") / f"sim_{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
