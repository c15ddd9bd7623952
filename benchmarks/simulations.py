"""Simulate real captures, and make a strip of pictures of each: `docs/sim_*.jpg`.

    python -m benchmarks.simulations [NAME ...]

There is a strip for each look of growth, for three materials, for targets and for dissolving. Looks
were tuned on statue_massa; no constant of any simulation was tuned on statue_trumpet. Pieces of
stone were judged on statue_angel, and how splats travel in conform and morph on guitar and on
statue_angel; the constants of neither were changed for any other capture. What the pictures show
was chosen by eye for each capture: the camera, the frames, and in `onto_the_ball` and
`among_daffodils` also what moves, and where.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, Vt

from benchmarks.scenes import DATA
from usdsplat import schema
from usdsplat.cli.main import main as usdsplat
from usdsplat.delegate.engine import Engine
from usdsplat.interchange import import_capture
from usdsplat.interchange.files import open_stage
from usdsplat.render.settings import RenderSettings
from usdsplat.sim.stage.presets import author_preset

CAMERA = "/Shot"
BACKGROUND = (0.09, 0.1, 0.12)
LIMIT = 300_000
"""Maximum size of a strip [byte]."""
ANGLE = 30.0
"""Vertical angle of view [degree]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Strip:
    """A simulation with the frames to show."""

    capture: str
    preset: str
    frames: tuple[int, ...]
    options: Mapping[str, str] = field(default_factory=dict)
    """Options of the preset."""
    goal: Callable[[Path], None] | str | None = None
    """What to conform to: another capture, or a function that writes a stage."""
    turn: float = 25.0
    """Angle from which the camera looks, around the up axis from z towards x [degree]."""
    height: float = 1.25
    """Height of what the picture shows, in heights of the capture, or widths if it is wider."""
    raised: float = 0.0
    """How much higher than the middle of the capture the camera looks, in the same unit."""
    edit: Callable[[Usd.Stage], None] | None = None
    """Function that edits the preset's stage."""
    size: tuple[int, int] = (400, 480)
    """Size of a picture [pixel], before the strip is reduced."""


def shoot(stage: Usd.Stage, strip: Strip) -> None:
    """Author a camera on the capture, a light from above left, and a fainter one."""
    points = np.concatenate([at for _, at in fields(stage)])
    low, high = np.percentile(points, (5, 95), axis=0)
    size = float((high - low).max())
    at = (low + high) / 2 + (0, strip.raised * size, 0)
    turn = np.radians(strip.turn)
    way = np.array((np.sin(turn), 0.25, np.cos(turn)))
    eye = at + way * (strip.height * size / 2 / np.tan(np.radians(ANGLE) / 2) / np.linalg.norm(way))
    camera = UsdGeom.Camera.Define(stage, CAMERA)
    view = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*at), Gf.Vec3d(0, 1, 0))
    camera.ClearXformOpOrder()
    camera.AddTransformOp().Set(view.GetInverse())
    camera.CreateVerticalApertureAttr(24.0)
    camera.CreateHorizontalApertureAttr(24.0 * strip.size[0] / strip.size[1])
    camera.CreateFocalLengthAttr(12.0 / np.tan(np.radians(ANGLE) / 2))
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01 * size, 1000 * size))
    for name, strength, up, side in (("Key", 2.6, -50, -40), ("Fill", 0.7, -10, 60)):
        light = UsdLux.DistantLight.Define(stage, f"/{name}")
        light.CreateIntensityAttr(strength)
        light.CreateNormalizeAttr(True)
        place = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d.XAxis(), up))
        place *= Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d.YAxis(), side))
        light.ClearXformOpOrder()
        light.AddTransformOp().Set(place * view.GetInverse())


def fields(stage: Usd.Stage) -> list[tuple[Usd.Prim, np.ndarray]]:
    """Return the splat fields with the positions of their splats in the stage's space."""
    found = []
    for prim in stage.Traverse():
        if schema.is_splat_field(prim):
            place = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0))
            found.append((prim, schema.fetch(prim).positions @ place[:3, :3] + place[3, :3]))
    return found


def visible(stage: Usd.Stage) -> None:
    """Draw what pushes the splats."""
    for prim in stage.Traverse():
        purpose = UsdGeom.Imageable(prim).GetPurposeAttr() if prim.IsA(UsdGeom.Imageable) else None
        if purpose and purpose.HasAuthoredValue():
            purpose.Set(UsdGeom.Tokens.default_)


def standing(stage: Usd.Stage) -> None:
    """Select the statue, not its pedestal, for the simulation."""
    for prim, points in fields(stage):
        low, high = np.percentile(points[:, 1], (2, 98))
        select(prim, points[:, 1] > low + 0.5 * (high - low))


def simulation(field: Usd.Prim, name: str) -> UsdGeom.Xformable:
    """Return a prim that a preset authored beside a field."""
    return UsdGeom.Xformable(field.GetParent().GetPrimAtPath(f"Simulation/{name}"))


def select(prim: Usd.Prim, rows: np.ndarray) -> None:
    """Select splats of a field for the simulation, rows of shape (n,)."""
    weight = prim.CreateAttribute("primvars:splatSim:weight", Sdf.ValueTypeNames.FloatArray)
    weight.Set(Vt.FloatArray.FromNumpy(rows.astype("f4")))


def ball(path: Path) -> None:
    """Write a ball of radius 1."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    columns, rows = 96, 48
    turn, tilt = np.arange(columns) * 2 * np.pi / columns, np.linspace(0, np.pi, rows)[:, None]
    height = np.broadcast_to(np.cos(tilt), (rows, columns))
    points = np.stack([np.sin(tilt) * np.cos(turn), height, np.sin(tilt) * np.sin(turn)], axis=-1)
    number = np.arange(columns * rows).reshape(rows, columns)
    after = np.roll(number, -1, axis=1)
    faces = np.stack([number[:-1], after[:-1], after[1:], number[1:]], axis=-1)
    mesh = UsdGeom.Mesh.Define(stage, "/Ball")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.reshape(-1, 3).astype("f4")))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.ravel().astype("i4")))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray([4] * (faces.size // 4)))
    mesh.CreateExtentAttr([(-1, -1, -1), (1, 1, 1)])
    stage.SetDefaultPrim(mesh.GetPrim())
    stage.Save()


def onto_the_ball(stage: Usd.Stage) -> None:
    """Select the bust, not what it stands on, and put the ball in its place."""
    ((prim, points),) = fields(stage)
    low, high = np.percentile(points[:, 1], (2, 98))
    is_bust = points[:, 1] > low + 0.46 * (high - low)
    select(prim, is_bust)
    low, high = np.percentile(points[is_bust], (3, 97), axis=0)
    radius = 0.44 * (high[1] - low[1])
    middle = (low + high) / 2 - (0, 0.12 * radius, 0)
    place = Gf.Matrix4d().SetScale(radius) * Gf.Matrix4d().SetTranslate(Gf.Vec3d(*middle))
    target = simulation(prim, "Target")
    (move,) = target.GetOrderedXformOps()
    move.Set(place * target.ComputeParentToWorldTransform(0).GetInverse())


def among_daffodils(stage: Usd.Stage) -> None:
    """Take the sign away, and let the figure walk through the middle of the daffodils."""
    visible(stage)
    ((prim, points),) = fields(stage)
    sign = (points - (-0.02, 0.228, 0.021))[:, (0, 2)] @ ((0.842, 0.54), (0.54, -0.842))
    along, behind, y = np.abs(sign[:, 0]), sign[:, 1], points[:, 1]
    red, _, blue = schema.fetch(prim).sh[:, 0].T * 0.2821 + 0.5
    is_sign = (np.abs(behind) < 0.024) & ((y > 0.15) | ((along > 0.088) & (y > 0.022)))
    is_sign &= ~((red > 0.35) & (red > 1.6 * blue)) & (along < 0.15)
    is_stray = (y > 0.06) & ((along > 0.107) | (np.abs(behind - 0.025) > 0.085))
    gone = is_sign | is_stray | (y > 0.168)
    opacities = prim.GetAttribute("opacities")
    opacities.Set(Vt.FloatArray.FromNumpy(np.where(gone, 0, opacities.Get()).astype("f4")))
    figure = simulation(prim, "Figure")
    (move,) = figure.GetOrderedXformOps()
    start, end = move.GetTimeSamples()
    ground = move.Get(start)[1]
    for time, way in ((start, -0.35), (end, 0.35)):
        move.Set(Gf.Vec3d(-0.005 - 0.545 * way, ground, 0.839 * way), time)
    figure.AddRotateYOp().Set(-123)


GROWING = {"preset": "grow", "frames": (1, 14, 24, 34, 48)}
STRIPS = {
    "cells": Strip(capture="statue_trumpet.sog", options={"style": "cells"}, turn=205, **GROWING),
    "coral": Strip(
        capture="statue_massa.sog", options={"style": "coral"}, turn=205, height=1.3, raised=0.12,
        **{**GROWING, "frames": (1, 12, 18, 26, 48)},
    ),
    "veins": Strip(capture="pod.spz", options={"style": "veins"}, **GROWING),
    "moss": Strip(
        capture="guitar.compressed.ply", options={"style": "moss"}, turn=75,
        **{**GROWING, "frames": (1, 4, 7, 12, 48)},
    ),
    "crystals": Strip(capture="statue_angel.sog", options={"style": "crystals"}, **GROWING),
    "lichen": Strip(capture="statue_angel.sog", options={"style": "lichen"}, **GROWING),
    "push": Strip(
        capture="statue_trumpet.sog", preset="push", options={"material": "rubber"},
        frames=(1, 10, 16, 24, 40), turn=205, edit=visible,
    ),
    "wade": Strip(
        capture="flowers_lod2_0.sog", preset="wade", frames=(1, 18, 24, 26, 60),
        edit=among_daffodils, turn=17, height=0.74, raised=0.13,
    ),
    "shatter": Strip(
        capture="statue_trumpet.sog", preset="shatter", frames=(1, 8, 12, 17, 34), turn=205
    ),
    "conform": Strip(
        capture="statue_massa.sog", preset="conform", goal=ball, frames=(1, 26, 33, 40, 70),
        edit=onto_the_ball, turn=205, raised=0.1,
    ),
    "morph": Strip(
        capture="statue_trumpet.sog", preset="morph", goal="statue_massa.sog",
        frames=(1, 29, 35, 42, 80), turn=205,
    ),
    "dissolve": Strip(
        capture="statue_trumpet.sog", preset="dissolve", frames=(1, 18, 28, 40, 60), turn=205,
        edit=standing,
    ),
}  # fmt: skip
"""Name -> strip."""


def bake(strip: Strip, folder: Path) -> Path:
    """Make the stage and simulate it. Return the layer of results."""
    made, baked = folder / "scene.usda", folder / "bake.usda"
    goal = None if strip.goal is None else folder / "goal.usdc"
    if isinstance(strip.goal, str):
        import_capture(DATA / "splats" / strip.goal, goal)
    elif strip.goal is not None:
        strip.goal(goal)
    import_capture(DATA / "splats" / strip.capture, folder / "capture.usdc")
    author_preset(
        strip.preset, open_stage(folder / "capture.usdc"), made, last=strip.frames[-1],
        options=dict(strip.options), goal=None if goal is None else open_stage(goal),
    )  # fmt: skip
    stage = Usd.Stage.Open(str(made))
    if strip.edit is not None:
        strip.edit(stage)
    shoot(stage, strip)
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
            color = engine.picture(view, RenderSettings(color_mode="display", samples=2))["color"]
            row.append(color[..., :3] + (1 - color[..., 3:]) * np.float32(BACKGROUND))
    return np.concatenate(row, axis=1)


def run(command: str) -> None:
    """Run a command of usdsplat, which must succeed."""
    if usdsplat(command.split()):
        raise SystemExit(f"usdsplat {command} failed")


def save(image: np.ndarray, path: Path) -> None:
    """Write a JPEG as good, or a PNG with a palette as large, as the limit allows."""
    from PIL import Image

    rgb = Image.fromarray(np.uint8(np.clip(image, 0, 1) * 255 + 0.5))
    if path.suffix == ".png":
        height, size = rgb.height, LIMIT + 1
        while size > LIMIT:
            small = rgb.resize((round(rgb.width * height / rgb.height), height), Image.LANCZOS)
            few = small.quantize(
                256, Image.Quantize.MAXCOVERAGE, kmeans=1, dither=Image.Dither.NONE
            )
            few.save(path, optimize=True)
            size = path.stat().st_size
            height = round(0.98 * height * min(1, LIMIT / size) ** 0.5)
        return
    rgb = rgb.resize((rgb.width * 3 // 4, rgb.height * 3 // 4), Image.LANCZOS)
    for quality in range(92, 40, -4):
        rgb.save(path, quality=quality, optimize=True)
        if path.stat().st_size <= LIMIT:
            break
    print(f"{path}: {rgb.width}x{rgb.height}, {path.stat().st_size // 1000} kB")


def main(names: list[str]) -> None:
    """Make the strips of these names, or all."""
    for name in names or STRIPS:
        with tempfile.TemporaryDirectory() as folder:
            baked = bake(STRIPS[name], Path(folder))
            save(pictures(STRIPS[name], baked), Path("docs") / f"sim_{name}.jpg")


if __name__ == "__main__":
    main(sys.argv[1:])
