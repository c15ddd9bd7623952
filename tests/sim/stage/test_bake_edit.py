"""Tests of bakes as array edits."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from tests.schema.clouds import angles
from tests.sim.stage.bakes import PATH, Solver, layer_of, shot
from usdsplat import schema
from usdsplat.core.errors import StageError
from usdsplat.sim.stage.bake_edit import changed


def test_what_is_read_is_the_state_within_epsilon(tmp_path: Path) -> None:
    """Oracle: the solver's arrays; tolerances are the parameters', positions' in mean distances of
    nearest neighbours by brute force."""
    bake = shot(tmp_path, "edit", lives=False, n=40, spin=0.002, position_epsilon=0.2)
    rest = schema.fetch(bake.stage.GetPrimAtPath(PATH))
    away = np.linalg.norm(rest.positions[:, None] - rest.positions[None], axis=2)
    spacing = np.where(away > 0, away, np.inf).min(axis=1).mean()
    stage = Usd.Stage.Open(str(bake.run()))
    prim = stage.GetPrimAtPath(PATH)
    epsilon = prim.GetCustomDataByKey("usdsplat:bake:epsilon")
    assert math.isclose(epsilon["positions"], 0.2 * spacing, rel_tol=1e-5)
    untouched = 0
    for frame in bake.frames[PATH]:
        found = schema.fetch(prim, frame.time)
        off = np.linalg.norm(found.positions - frame.cloud.positions, axis=1)
        assert off.max() <= 0.2 * spacing * (1 + 1e-5)
        untouched += (found.positions == rest.positions).all(axis=1).sum()
        assert angles(found.rotations, frame.cloud.rotations).max() <= math.radians(0.2) + 1e-5
        np.testing.assert_allclose(found.scales, frame.cloud.scales, rtol=0.0021)
        np.testing.assert_allclose(found.opacities, frame.cloud.opacities, atol=1 / 512)
    assert 0 < untouched < 14 * 40


def test_an_edited_splat_is_edited_to_the_end_of_its_epoch(tmp_path: Path) -> None:
    """Oracle: a splat that goes away and comes back: exact from then on, even within epsilon."""
    bake = shot(tmp_path, "edit", lives=False, clip_frames=7, count=14, position_epsilon=0.5)
    rest = schema.fetch(bake.stage.GetPrimAtPath(PATH))

    class Back(Solver):
        def step(self) -> None:
            self.state.step += 1
            moved = rest.positions.copy()
            far = {2: 100.0}.get(self.state.step, 1e-3)
            moved[0, 0] += np.float32(far)
            moved[1, 0] += np.float32(1e-3)
            self.state.positions = moved

    bake.solvers = lambda: {PATH: Back.of(rest, lives=False)}
    stage = Usd.Stage.Open(str(bake.run()))
    attribute = stage.GetPrimAtPath(PATH).GetAttribute("positions")
    moved = [np.asarray(attribute.Get(time))[:2, 0] - rest.positions[:2, 0] for time in bake.times]
    way = [0, 0, 100, *[1e-3] * 4, *[0] * 7]
    np.testing.assert_allclose([row[0] for row in moved], way, rtol=1e-3)
    assert not any(row[1] for row in moved)


def test_only_what_moved_is_in_the_file(tmp_path: Path) -> None:
    """Oracle: 20 bytes an edit of 12 bytes, against 12 for each splat."""
    sizes = {}
    for mode in ("edit", "dense"):
        (tmp_path / mode).mkdir()
        bake = shot(
            tmp_path / mode, mode, lives=False, n=20_000, count=6, velocities=False,
            writes=frozenset({"positions"}),
        )  # fmt: skip
        read = schema.fetch(bake.stage.GetPrimAtPath(PATH))
        bake.solvers = lambda read=read: {PATH: Solver.of(read, lives=False, moving=slice(0, 1000))}
        bake.run()
        sizes[mode] = (tmp_path / mode / "bake_data" / "samples.usdc").stat().st_size
    assert sizes["dense"] > 6 * 20_000 * 12
    assert sizes["edit"] < 6 * 1000 * 20 * 1.5 + 20_000


def test_before_the_first_sample_it_is_the_first(tmp_path: Path) -> None:
    """Oracle: the first frame: USD itself takes edits before their first sample for no number."""
    bake = shot(tmp_path, "edit", lives=False)
    stage = Usd.Stage.Open(str(bake.run()))
    prim = stage.GetPrimAtPath(PATH)
    for time in (-50.0, 0.0, 0.75):
        found = schema.fetch(prim, time)
        np.testing.assert_allclose(
            found.positions, bake.frames[PATH][0].cloud.positions, rtol=1e-6, atol=1e-6
        )


def test_half_captures_are_edited_in_half(tmp_path: Path) -> None:
    """Oracle: the solver's arrays to a unit in the last place of half, or epsilon."""
    bake = shot(tmp_path, "edit", lives=False, form="half")
    stage = Usd.Stage.Open(str(bake.run()))
    layer = layer_of(tmp_path / "bake_data" / "samples.usdc")
    assert "scalesh" in layer.GetPrimAtPath(PATH).properties
    assert "scales" not in layer.GetPrimAtPath(PATH).properties
    for frame in bake.frames[PATH]:
        found = schema.fetch(stage.GetPrimAtPath(PATH), frame.time)
        np.testing.assert_allclose(found.scales, frame.cloud.scales, rtol=0.0021 + 2.0**-10)
        np.testing.assert_array_equal(found.positions, frame.cloud.positions)


def test_births_and_packed_captures_are_refused(tmp_path: Path) -> None:
    """Oracle: the sentences."""
    with pytest.raises(StageError, match="bake:mode edit: found splats that are born"):
        shot(tmp_path, "edit").open()
    (tmp_path / "packed").mkdir()
    with pytest.raises(StageError, match="bake:mode edit: found a packed field"):
        shot(tmp_path / "packed", "edit", lives=False, form="packed").open()


def test_an_older_usd_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the sentence."""
    bake = shot(tmp_path, "edit", lives=False)
    monkeypatch.setattr("usdsplat.sim.stage.plan.Usd.GetVersion", lambda: (0, 25, 11))
    with pytest.raises(StageError, match=r"bake:mode edit: found usd-core 25\.11, expected 26\.3"):
        bake.open()


def test_a_quaternion_and_its_negative_are_one_turn() -> None:
    """Oracle: the closed form: a turn by 0.21 degrees is above 0.2, one by 0.19 is not."""
    old = np.tile(np.array([1, 0, 0, 0], np.float32), (4, 1))
    half = np.radians([0.21, 0.21, 0.19, 0.19]) / 2
    new = np.stack([np.cos(half), np.sin(half), 0 * half, 0 * half], axis=1).astype(np.float32)
    new[1::2] *= -1
    assert changed("rotations", new, old, math.radians(0.2)).tolist() == [True, True, False, False]
