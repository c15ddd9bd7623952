"""Tests of what cannot be baked, of few frames and of fields that die out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.schema.clouds import cloud
from tests.sim.stage.bakes import PATH, Solver, save_stage, shot
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError, UsageError, UsdSplatError
from usdsplat.sim.stage.bake import Bake
from usdsplat.sim.stage.plan import BakedField

HALF_ULP = 2.0**-10
ARRAYS = ("positions", "rotations", "scales", "opacities", "sh")


HALF_ULP = 2.0**-10
ARRAYS = ("positions", "rotations", "scales", "opacities", "sh")


def field(path: Path, where: str = PATH) -> Usd.Prim:
    """The prim on a stage that is kept open by it."""
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetPrimAtPath(where)
    prim.holder = stage
    return prim


def rows(of: SplatCloud, found: SplatCloud) -> np.ndarray:
    """Where the splats of one cloud are in another."""
    at = np.searchsorted(found.ids, of.ids)
    np.testing.assert_array_equal(found.ids[at], of.ids)
    return at


def test_frames_out_of_turn_are_refused(tmp_path: Path) -> None:
    """Oracle: the sentences."""
    bake = shot(tmp_path, lives=False)
    solver = bake.solvers()[PATH]
    opened = bake.open()
    with pytest.raises(UsageError, match="next frame: found 2, expected 1"):
        opened.write(PATH, solver.frame(2.0))
    opened.write(PATH, solver.frame(1.0))
    solver.lives = True
    for _ in range(3):
        solver.step()
    with pytest.raises(StageError, match=r"at 2: found births or deaths \(14 splats\)"):
        opened.write(PATH, solver.frame(2.0))
    with pytest.raises(UsageError, match="found 1 frames, expected 14"):
        opened.close()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"writes": frozenset({"colour"})}, "writes: found colour"),
        ({"name": "shot.usda"}, "a file of the stage itself"),
        ({"name": "bake.usdc"}, "found the suffix '.usdc', expected .usda"),
        ({"name": "no/folder/bake.usda"}, "found No such file or directory"),
        ({"prim": "/World"}, "found no splat field"),
        ({"prim": "/Nowhere"}, "found no splat field"),
    ],
    ids=str,
)
def test_what_cannot_be_baked_is_refused(tmp_path: Path, change: dict, sentence: str) -> None:
    """Oracle: the sentences; nothing is written."""
    bake = shot(tmp_path)
    bake.writes = change.get("writes", bake.writes)
    bake.target = tmp_path / change.get("name", "bake.usda")
    rest = schema.fetch(bake.stage.GetPrimAtPath(PATH))
    fields = [
        BakedField(path=change.get("prim", PATH), rest=rest, writes=bake.writes, is_fixed=False)
    ]
    with pytest.raises(UsdSplatError, match=sentence):
        Bake.open(bake.stage, bake.target, fields, bake.times, bake.parameters, bake.provenance())
    assert not list(tmp_path.glob("*_data"))


def test_an_instance_is_refused(tmp_path: Path) -> None:
    """Oracle: the sentence; an opinion on an instance's inside would say nothing."""
    asset = Usd.Stage.CreateNew(str(tmp_path / "asset.usda"))
    schema.author(asset, "/Asset/Scan", cloud(3, n=12, degree=1))
    asset.SetDefaultPrim(asset.GetPrimAtPath("/Asset"))
    asset.Save()
    stage = save_stage(tmp_path, {})
    prim = stage.DefinePrim("/World/Ref")
    prim.GetReferences().AddReference("./asset.usda")
    prim.SetInstanceable(True)
    stage.Save()
    with pytest.raises(StageError, match="found an instance"):
        shot(tmp_path, stage=stage, paths=("/World/Ref/Scan",)).open()


@pytest.mark.parametrize("mode", ["dense", "clips", "packed", "edit"])
@pytest.mark.parametrize("count", [1, 4, 5])
def test_any_number_of_frames(tmp_path: Path, mode: str, count: int) -> None:
    """Oracle: the solver's centres; one frame, a whole epoch, and one more."""
    bake = shot(tmp_path, mode, count=count, lives=mode != "edit")
    prim = field(bake.run())
    for frame in bake.frames[PATH]:
        found = schema.fetch(prim, frame.time)
        alive = found.opacities > 0
        np.testing.assert_array_equal(found.positions[alive], frame.cloud.positions)


@pytest.mark.parametrize("mode", ["dense", "clips", "packed"])
def test_a_field_may_die_out(tmp_path: Path, mode: str) -> None:
    """Oracle: the number of splats that can be seen."""
    bake = shot(tmp_path, mode, n=2, count=10)

    class Last(Solver):
        def step(self) -> None:
            s = self.state
            s.step += 1
            keep = np.zeros(len(s), np.bool_)
            keep[: {1: 2, 2: 1}.get(s.step, 0)] = True
            s.replace_rows({name: array[keep] for name, array in s.per_splat()})

    read = schema.fetch(bake.stage.GetPrimAtPath(PATH))
    bake.solvers = lambda: {PATH: Last.of(read)}
    prim = field(bake.run())
    seen = [(schema.fetch(prim, time).opacities > 0).sum() for time in bake.times]
    assert seen == [2, 2, 1, *[0] * 7]


def test_bounds_of_the_capture_are_not_those_of_a_bake_that_moves(tmp_path: Path) -> None:
    """Oracle: USD's bounds with and without hints, which the capture's would make differ."""
    bake = shot(tmp_path, "dense", lives=False)
    world = bake.stage.GetPrimAtPath("/World")
    model = UsdGeom.ModelAPI.Apply(world)
    box = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    model.SetExtentsHint(model.ComputeExtentsHint(box))
    bake.stage.Save()
    stage = Usd.Stage.Open(str(bake.run()))
    for time in (1, 7, 14):
        found, expected = (
            UsdGeom.BBoxCache(time, ["default"], useExtentsHint=hint).ComputeWorldBound(
                stage.GetPrimAtPath("/World")
            )
            for hint in (True, False)
        )
        assert found == expected
    assert bake.stage.GetPrimAtPath("/World").GetAttribute("extentsHint").HasAuthoredValue()
