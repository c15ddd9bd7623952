"""Tests from a stage through the command to a picture: effects on splats are visible."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel

from tests.delegate.stages import random_cloud
from tests.renders import add_view, psnr, still, stills
from tests.sim.stage.stages import FIELD, SIM, add_rig, place, rigid, world
from usdsplat import schema
from usdsplat.cli.main import main
from usdsplat.core import edit
from usdsplat.delegate.engine import Engine
from usdsplat.sim.stage import simulating
from usdsplat.sim.stage.authoring import author

TIMES = (1.0, 2.0, 3.0, 4.0)


def make(folder: Path, values: Mapping[str, object], form: str = "float") -> Usd.Stage:
    """A saved stage with a field of degree 3, a simulation and a camera."""
    stage = Usd.Stage.CreateNew(str(folder / "shot.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(24)
    stage.SetStartTimeCode(TIMES[0])
    stage.SetEndTimeCode(TIMES[-1])
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    schema.author(stage, FIELD, random_cloud(0, n=30, degree=3), form=form)
    add_view(stage, eye=(0, 0, 12))
    author(stage.DefinePrim(SIM, "SplatSim"), dict(values))
    stage.Save()
    return stage


def simulated(stage: Usd.Stage) -> Path:
    """Simulate a stage by the command; returns the result."""
    stage.Save()
    source = Path(stage.GetRootLayer().realPath)
    target = source.with_name("bake.usda")
    assert main(["simulate", str(source), "-o", str(target)]) == 0
    return target


def pictures(
    target: Path, times: Sequence[float], matrices: Mapping[float, np.ndarray] | None = None
) -> list[np.ndarray]:
    """Of a stage at these times, the field placed by matrices if there are any."""
    stage = Usd.Stage.Open(str(target))
    stage.SetEditTarget(stage.GetSessionLayer())
    found = []
    with Engine(stage) as engine:
        for time in times:
            if matrices is not None:
                place(stage.GetPrimAtPath(FIELD), matrices[time])
            found.append(still(engine, time))
    return found


def turn(stage: Usd.Stage, rotate: Sequence[float], scale: Sequence[float]) -> None:
    """Animate the deformer `a` of a simulation, from nothing at the first time to all of it."""
    sim = stage.GetPrimAtPath(SIM)
    for name, value, nothing in (("rotate", rotate, 0.0), ("scale", scale, 1.0)):
        attribute = sim.CreateAttribute(f"splatSim:deform:a:{name}", Sdf.ValueTypeNames.Float3)
        for time in TIMES:
            mixed = [nothing + (each - nothing) * _part(time) for each in value]
            attribute.Set(Gf.Vec3f(*mixed), time)


def deformed(rotate: Sequence[float], scale: Sequence[float], time: float) -> np.ndarray:
    """What that does, a matrix for column vectors."""
    matrix = np.eye(4)
    for axis, angle in enumerate(rotate):
        c, s = np.cos(np.radians(angle * _part(time))), np.sin(np.radians(angle * _part(time)))
        one = np.eye(4)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        one[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
        matrix = one @ matrix
    return matrix @ np.diag([*(1 + (np.array(scale) - 1) * _part(time)), 1.0])


def _part(time: float) -> float:
    return (time - TIMES[0]) / (TIMES[-1] - TIMES[0])


@pytest.mark.parametrize(
    ("mode", "form", "near"),
    [
        ("dense", "float", 100),
        ("edit", "float", 100),
        ("dense", "half", 75),
        ("packed", "half", 60),
    ],
)
def test_a_turning_deformer_is_a_turning_xform(
    tmp_path: Path, mode: str, form: str, near: float
) -> None:
    """Oracle: the capture under an xform: harmonics of degree 3 turn with splats."""
    stage = make(tmp_path, {"deform:a:type": "transform", "bake:mode": mode}, form)
    prim = stage.GetPrimAtPath(FIELD)
    place(prim, rigid(8, 0.8))
    frame = UsdGeom.Xform.Define(stage, "/World/Frame").GetPrim()
    place(frame, rigid(2))
    stage.GetPrimAtPath(SIM).CreateRelationship("splatSim:deform:a:frame").SetTargets(
        [frame.GetPath()]
    )
    angles, ones = (30, 50, 20), (1, 1, 1)
    turn(stage, angles, ones)
    target = simulated(stage)
    pose = {
        time: rigid(2) @ deformed(angles, ones, time) @ np.linalg.inv(rigid(2)) @ world(prim)
        for time in TIMES
    }
    expected = pictures(tmp_path / "shot.usda", TIMES, pose)
    for found, each in zip(pictures(target, TIMES), expected, strict=True):
        assert psnr(found, each) > near
    assert psnr(expected[0], expected[-1]) < 30


@pytest.mark.parametrize("mode", ["dense", "edit"])
def test_a_stretching_deformer_is_a_transform_of_the_cloud(tmp_path: Path, mode: str) -> None:
    """Oracle: core.edit.transform by the same matrix, which shears in the axes of the field."""
    stage = make(tmp_path, {"deform:a:type": "transform", "bake:mode": mode})
    angles, scale = (30, 50, 20), (1.4, 0.7, 1.1)
    turn(stage, angles, scale)
    rest = schema.fetch(stage.GetPrimAtPath(FIELD))
    target = simulated(stage)
    for time, found in zip(TIMES, pictures(target, TIMES), strict=True):
        cloud = edit.transform(rest, deformed(angles, scale, time))
        assert psnr(found, stills([cloud], tmp_path / "shot.usda", FIELD)) > 100


@pytest.mark.parametrize("mode", ["dense", "packed"])
def test_17_all_weights_on_one_joint_are_an_xform(tmp_path: Path, mode: str) -> None:
    """Oracle: the capture under the matrix that UsdSkel skins with; the picture to 1 / 255, and
    packed as well as packing allows."""
    stage = make(tmp_path, {"bake:mode": mode})
    add_rig(stage)
    prim, sim = (stage.GetPrimAtPath(path) for path in (FIELD, SIM))
    place(prim, rigid(6, 0.7))
    binding = UsdSkel.BindingAPI.Apply(prim)
    binding.CreateJointsAttr(["a/b"])
    binding.CreateJointIndicesPrimvar(True, 1).Set([0])
    binding.CreateJointWeightsPrimvar(True, 1).Set([1.0])
    sim.ApplyAPI("SplatSimDeformAPI")
    sim.GetRelationship("splatSim:skin:skeleton").SetTargets(["/World/Rig/Skeleton"])
    target = simulated(stage)
    cache = UsdSkel.Cache()
    cache.Populate(UsdSkel.Root.Get(stage, "/World/Rig"), Usd.PrimDefaultPredicate)
    skeleton = UsdSkel.Skeleton.Get(stage, "/World/Rig/Skeleton")
    query = cache.GetSkelQuery(skeleton)
    pose = {
        time: world(skeleton.GetPrim(), time) @ np.array(query.ComputeSkinningTransforms(time)[1]).T
        for time in TIMES
    }
    expected = pictures(tmp_path / "shot.usda", TIMES, pose)
    for found, each in zip(pictures(target, TIMES), expected, strict=True):
        assert np.abs(found - each).max() <= (1 if mode == "dense" else 3) / 255
        assert psnr(found, each) > 60


@pytest.mark.parametrize("mode", ["dense", "clips", "packed", "edit"])
def test_in_the_worlds_space_a_moving_field_carries_nobody(tmp_path: Path, mode: str) -> None:
    """Oracle: the capture where it is at the start, falling as symplectic Euler does; the field
    turns, goes and grows meanwhile."""
    values = {"sim:space": "world", "particles:enabled": True, "particles:drag": 0.0}
    stage = make(tmp_path, {**values, "particles:gravity": (0, -30, 0), "bake:mode": mode})
    prim = stage.GetPrimAtPath(FIELD)
    for time in TIMES:
        matrix = deformed((10, 60, 0), (1.5, 1.5, 1.5), time)
        matrix[:3, 3] = 0.2 * time, 0.1, 0
        place(prim, matrix, time)
    target = simulated(stage)
    dt, pose = 1 / 96, {}
    for time in TIMES:
        steps = 4 * (time - 1)
        pose[time] = world(prim, 1).copy()
        pose[time][1, 3] -= 30 * dt**2 * steps * (steps + 1) / 2
    (tmp_path / "still").mkdir()
    make(tmp_path / "still", {})
    expected = pictures(tmp_path / "still" / "shot.usda", TIMES, pose)
    for found, each in zip(pictures(target, TIMES), expected, strict=True):
        assert psnr(found, each) > (60 if mode == "packed" else 90)


@pytest.mark.parametrize("form", ["float", "half", "packed"])
def test_22_the_command_writes_what_the_solver_drew(
    tmp_path: Path, form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the frames that the simulation handed over: exact in float, where packed captures
    become float too, and a unit in the last place in half."""
    frames = []
    draw = simulating.Simulation.frame

    def kept(self, path):
        frames.append(draw(self, path))
        return frames[-1]

    monkeypatch.setattr(simulating.Simulation, "frame", kept)
    bend = {"deform:a:type": "bend", "deform:a:length": 4.0, "deform:a:angle": 60.0}
    wind = {"dissolve:enabled": True, "dissolve:duration": 0.1, "dissolve:speed": 2.0}
    stage = make(tmp_path, {**bend, **wind, "bake:rateSh": 1}, form)
    target = simulated(stage)
    prim = (result := Usd.Stage.Open(str(target))).GetPrimAtPath(FIELD)
    assert result and len(frames) == len(TIMES)
    for frame in frames:
        found = schema.fetch(prim, frame.time)
        np.testing.assert_array_equal(found.ids, frame.cloud.ids)
        np.testing.assert_array_equal(found.positions, frame.cloud.positions)
        for name in ("rotations", "scales", "opacities", "sh"):
            actual, expected = getattr(found, name), getattr(frame.cloud, name)
            if form == "half":
                loose = 2e-7 + 1e-3 * (name == "rotations")
                np.testing.assert_allclose(actual, expected, rtol=2.0**-10, atol=loose)
            else:
                np.testing.assert_array_equal(actual, expected)
    assert not np.array_equal(frames[0].cloud.positions, frames[-1].cloud.positions)
    assert (frames[-1].cloud.opacities < frames[0].cloud.opacities).any()
