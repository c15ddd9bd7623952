"""Fixtures for tests of commands: a small capture and a small stage."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from usdsplat import formats, schema
from usdsplat.cli import progress
from usdsplat.cli.main import main
from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.engine import Engine
from usdsplat.render import memory
from usdsplat.render.renderer import AOVS
from usdsplat.render.settings import RenderSettings
from usdsplat.sim.stage.authoring import author

SCENE = RenderSettings(color_mode="scene")


@pytest.fixture(autouse=True)
def _a_program_of_usual_size(monkeypatch):
    """What other tests left in memory, compilers above all, is none of a command's."""
    before, usual = memory.resident(), 300 << 20
    grown = memory.resident
    monkeypatch.setattr(memory, "resident", lambda: max(grown() - before, 0) + usual)


def nothing_held_out(x0, y0, x1, y1):
    """A flat holdout without anything in it."""
    return np.full((y1 - y0, x1 - x0), np.inf, np.float32)


def ball(count=300, seed=0):
    """Splats in a ball of radius 0.5 around the origin, degree 1."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    radii = 0.5 * rng.uniform(0, 1, (count, 1)) ** (1 / 3)
    quaternions = rng.normal(size=(count, 4))
    return SplatCloud(
        positions=np.float32(radii * directions / np.linalg.norm(directions, axis=1)[:, None]),
        scales=rng.uniform(0.02, 0.08, (count, 3)).astype(np.float32),
        rotations=np.float32(quaternions / np.linalg.norm(quaternions, axis=1)[:, None]),
        opacities=rng.uniform(0.3, 0.99, count).astype(np.float32),
        sh=rng.normal(0, 0.5, (count, 4, 3)).astype(np.float32),
    )


def passing_sphere(stage, path):
    """Define a sphere that pushes the splats of a simulation, through the origin at frame 2."""
    sphere = UsdGeom.Sphere.Define(stage, path)
    sphere.CreateRadiusAttr(0.2)
    move = sphere.AddTranslateOp()
    for frame in (1, 3):
        move.Set((0.5 * (frame - 2), 0, 0), frame)
    author(sphere.GetPrim(), {"affector:friction": 0.1})
    return sphere


@pytest.fixture
def sim(tmp_path):
    """A stage of 3 frames: 60 splats, a SplatSim prim, and a ball that comes to them."""
    path = tmp_path / "sim.usda"
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(3)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    schema.author(stage, "/World/Field", ball(60))
    author(stage.DefinePrim("/World/Sim", "SplatSim"), {"bake:checkpointEvery": 2})
    passing_sphere(stage, "/World/Sphere")
    stage.GetRootLayer().Save()
    return path


@pytest.fixture
def capture(tmp_path):
    """A .ply of 300 splats."""
    path = tmp_path / "ball.ply"
    formats.write(ball(), path)
    return path


@pytest.fixture
def shot(tmp_path):
    """A stage of 4 frames: a ball that moves one unit a frame, and a camera 4 units away."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(4)
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    prim = schema.author(stage, "/World/Ball", ball())
    move = UsdGeom.Xformable(prim).AddTranslateOp()
    for frame in range(1, 5):
        move.Set(Gf.Vec3d(0.2 * (frame - 1), 0, 0), frame)
    camera = UsdGeom.Camera.Define(stage, "/World/Cam")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 4))
    camera.GetClippingRangeAttr().Set(Gf.Vec2f(0.1, 100))
    stage.GetRootLayer().Save()
    return tmp_path / "shot.usda"


@pytest.fixture
def run(capsys, monkeypatch):
    """Run the command line in this process; returns status, stdout and stderr.

    Lines of progress are off, as they depend on how busy the machine is.
    """
    monkeypatch.setattr(progress, "INTERVALS", ((math.inf, math.inf),))

    def command(*argv):
        capsys.readouterr()
        status = main([str(word) for word in argv])
        out, err = capsys.readouterr()
        return status, out, err

    return command


@pytest.fixture
def run_json(run):
    """Run with --json, expect success without a word on stderr, and return what was printed."""

    def command(*argv):
        status, out, err = run(*argv, "--json")
        assert (status, err) == (0, "")
        return json.loads(out)

    return command


@pytest.fixture(scope="session")
def compiled():
    """Draw with every kernel once, so that no test is the one that hears of compilation."""
    stage = Usd.Stage.CreateInMemory()
    schema.author(stage, "/Ball", ball())
    with Engine(stage) as engine:
        view = engine.view(resolution=(16, 16))
        for mode in ("scene", "display"):
            engine.picture(view, RenderSettings(color_mode=mode), ("color", "depth", "primId"))
        engine.picture(view, RenderSettings(color_mode="scene", samples=2), AOVS)
        matte = replace(view, matte=(("/Ball", True),))
        for seen in (view, matte):
            for _ in engine.render(seen, SCENE, AOVS, holdout=nothing_held_out):
                pass
        for _ in engine.render_deep(view, SCENE):
            pass
