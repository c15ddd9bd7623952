"""Tests of when harmonics are written."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from tests.schema.clouds import cloud
from tests.sim.stage.bakes import PATH, Shot, Solver, layer_of, save_stage, shot
from usdsplat import schema
from usdsplat.core import quaternion, sh_rotation
from usdsplat.core.cloud import SplatCloud
from usdsplat.schema import tokens


class Turner(Solver):
    """Turns all splats and their harmonics about y, by `spin` a frame; nothing else happens."""

    def step(self) -> None:
        s = self.state
        s.step += 1
        angle = self.spin * s.step
        turn = np.array([math.cos(angle / 2), 0, math.sin(angle / 2), 0], np.float64)
        s.rotations = quaternion.normalize(
            quaternion.multiply(turn, s.rest_rotations.astype(np.float64))
        ).astype(np.float32)
        matrix = quaternion.to_matrix(turn[None])[0]
        s.sh = np.ascontiguousarray(sh_rotation.rotate(s.rest_sh, matrix), np.float32)


class Painter(Solver):
    """Colours change all at once, at the fifth frame."""

    def step(self) -> None:
        self.state.step += 1
        if self.state.step == 4:
            self.state.sh = self.state.sh + np.float32(0.5)


def bake_of(folder: Path, solver: type[Solver], spin: float = 0.0, **knobs: object) -> Shot:
    """A shot of 16 frames in one epoch, of degree 3."""
    stage = save_stage(folder, {PATH: cloud(0, n=12, degree=3)})
    knobs = {"clip_frames": 16, **knobs}
    made = shot(folder, stage=stage, count=16, lives=False, **knobs)
    read = schema.fetch(stage.GetPrimAtPath(PATH))
    made.solvers = lambda: {PATH: solver.of(read, lives=False, spin=spin)}
    made.run()
    return made


def keys(folder: Path) -> list[float]:
    """Times at which harmonics are written."""
    layer = layer_of(folder / "bake_data" / "samples.usdc")
    return layer.ListTimeSamplesForPath(f"{PATH}.{tokens.SH_COEFFICIENTS}")


def test_a_slow_turn_needs_few_samples(tmp_path: Path) -> None:
    """Oracle: 1 degree a frame: more than 5 at frames 6, 11 and 16, and the frames before; lines in
    between err by at most l² θ² / 8 of a coefficient's magnitude, 0.9 % at degree 3."""
    bake = bake_of(tmp_path, Turner, math.radians(1.0001))
    assert keys(tmp_path) == [1, 5, 6, 10, 11, 15, 16]
    stage = Usd.Stage.Open(str(bake.target))
    size = np.sqrt((bake.frames[PATH][0].cloud.sh[:, 9:] ** 2).sum(axis=1)).max()
    for frame in bake.frames[PATH]:
        found: SplatCloud = schema.fetch(stage.GetPrimAtPath(PATH), frame.time)
        error = np.abs(found.sh - frame.cloud.sh).max()
        assert error <= 9 * math.radians(5.0) ** 2 / 8 * size


def test_a_sudden_change_is_not_smeared(tmp_path: Path) -> None:
    """Oracle: both sides of the jump; USD's lines between equal samples round."""
    bake = bake_of(tmp_path, Painter)
    assert keys(tmp_path) == [1, 4, 5, 16]
    stage = Usd.Stage.Open(str(bake.target))
    for frame in bake.frames[PATH]:
        found = schema.fetch(stage.GetPrimAtPath(PATH), frame.time)
        np.testing.assert_allclose(found.sh, frame.cloud.sh, rtol=1e-6)


@pytest.mark.parametrize(("rate", "expected"), [(1, list(range(1, 17))), (6, [1, 7, 13, 16])])
def test_a_rate_is_kept(tmp_path: Path, rate: int, expected: list[int]) -> None:
    """Oracle: the arithmetic, and the last frame, or the end would be held."""
    bake_of(tmp_path, Turner, 0.2, rate_sh=rate)
    assert keys(tmp_path) == expected


def test_each_epoch_begins_with_harmonics(tmp_path: Path) -> None:
    """Oracle: the first frames of epochs and the last of all, where nothing turns."""
    bake_of(tmp_path, Painter, clip_frames=8)
    assert keys(tmp_path) == [1, 4, 5, 9, 16]
