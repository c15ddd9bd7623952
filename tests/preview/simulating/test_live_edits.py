"""Tests of edits during a simulation: they take effect at the next frame, or are reported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.preview.simulating.hosts import Host, running, shot
from tests.preview.simulating.test_runner import bits, played, shown
from tests.sim.stage.scenes import LIVELY, add_capsule
from tests.sim.stage.stages import FIELD, SIM, place, simulation_of
from usdsplat import schema
from usdsplat.preview.simulating.runner import Runner
from usdsplat.sim.stage.authoring import author

FALLING = {"particles:enabled": True, "particles:drag": 0.0, "particles:gravity": (0.0, 0.0, 0.0)}
RESET = "takes effect after Reset"


def edited(stage: Usd.Stage) -> Usd.Stage:
    """The stage, whose edits go to its session layer as a window's do."""
    stage.SetEditTarget(stage.GetSessionLayer())
    return stage


def stepped(host: Host, runner: Runner, frame: float) -> str:
    """Make a frame; returns what there was to say."""
    runner.step()
    return host.wait(lambda event: event.frame == frame).message


def test_a_parameter_counts_from_the_next_frame(tmp_path: Path) -> None:
    """Oracle: free fall: without gravity nothing moves, and with it splats move on along it."""
    stage = edited(shot(tmp_path, FALLING))
    stage.SetEditTarget(stage.GetRootLayer())
    stage.RemovePrim("/World/Stick")
    edited(stage)
    with running(stage) as (host, runner):
        for frame in (1.0, 2.0):
            stepped(host, runner, frame)
        np.testing.assert_array_equal(shown(host, 2.0).positions, shown(host, 1.0).positions)
        with host.lock:
            author(simulation_of(stage), {"particles:gravity": (0.0, -24.0, 0.0)})
        assert stepped(host, runner, 3.0) == ""
        away = shown(host, 3.0).positions - shown(host, 2.0).positions
        assert (away[:, 1] < -1e-3).all()
        np.testing.assert_allclose(away[:, [0, 2]], 0, atol=1e-6)


def test_keys_count_at_their_own_times(tmp_path: Path) -> None:
    """Oracle: a run of a stage that had the keys from the beginning, to the bit."""
    found = []
    for late in (False, True):
        stage = edited(shot(tmp_path / str(late), FALLING, last=5))
        with running(stage) as (host, runner):
            if late:
                stepped(host, runner, 1.0)
                stepped(host, runner, 2.0)
            with host.lock:
                for time, value in ((2.0, 0.0), (5.0, -30.0)):
                    author(simulation_of(stage), {"particles:gravity": (0, value, 0)}, time=time)
            runner.run()
            host.ended()
            found.append([bits(shown(host, frame)) for frame in (3.0, 4.0, 5.0)])
    assert found[0] == found[1]


def test_a_dragged_affector_pushes_splats_at_the_next_frame(tmp_path: Path) -> None:
    """Oracle: distance: no splat is nearer to the capsule's axis than its radius."""
    stage = edited(shot(tmp_path, {}))
    with running(stage) as (host, runner):
        stepped(host, runner, 1.0)
        before = shown(host, 1.0).positions
        with host.lock:
            place(stage.GetPrimAtPath("/World/Stick"), np.eye(4), 2.0)
        stepped(host, runner, 2.0)
        after = shown(host, 2.0).positions
        z = np.clip(after[:, 2], -0.5, 0.5)
        far = np.linalg.norm(after - np.stack([0 * z, 0 * z, z], axis=1), axis=1)
        assert far.min() > 0.3 - 1e-3
        assert not np.array_equal(before, after)


@pytest.mark.parametrize(
    ("values", "changed", "name"),
    [
        ({}, {"sim:substeps": 3}, f"{SIM}.splatSim:sim:substeps"),
        ({}, {"sim:seed": 3}, f"{SIM}.splatSim:sim:seed"),
        ({}, {"rd:enabled": True}, f"{SIM}.splatSim:rd:enabled"),
        ({}, {"rd:enabled": True, "growth:birthRate": 1.0}, "splatSim:rd:enabled"),
        ({}, {"dissolve:enabled": True}, "splatSim:dissolve:enabled"),
        ({}, {"particles:enabled": True}, "splatSim:particles:enabled"),
        ({}, {"driver:new:output": "opacity"}, f"{SIM}.splatSim:driver:new"),
        ({"sim:enabled": False}, {"sim:enabled": True}, "splatSim:sim:enabled"),
        (
            {"deform:bow:type": "bend", "deform:bow:angle": 20.0},
            {"deform:bow:axis": "Z"},
            f"{SIM}.splatSim:deform:bow:axis",
        ),
    ],
)
def test_what_cannot_change_is_told_and_left(tmp_path: Path, values, changed, name) -> None:
    """Oracle: a run without the edit, to the bit; the message, until the edit is taken back."""
    frames = (2.0, 3.0, 4.0)
    stage = edited(shot(tmp_path, values, last=4, count=100))
    with running(stage) as (host, runner):
        runner.run()
        host.ended()
        expected = [bits(shown(host, frame)) for frame in frames]
        runner.reset()
        stepped(host, runner, 1.0)
        with host.lock:
            author(simulation_of(stage), changed)
        message = stepped(host, runner, 2.0)
        assert name in message
        assert message.endswith(RESET)
        stepped(host, runner, 3.0)
        with host.lock:
            session = stage.GetSessionLayer()
            del session.GetPrimAtPath("/").nameChildren["World"]
        assert stepped(host, runner, 4.0) == ""
        assert [bits(shown(host, frame)) for frame in frames] == expected


def test_prims_that_come_wait_for_a_reset(tmp_path: Path) -> None:
    """Oracle: the message; after the reset the new affector has pushed."""
    stage = edited(shot(tmp_path, {}, last=3))
    with running(stage) as (host, runner):
        stepped(host, runner, 1.0)
        with host.lock:
            other = add_capsule(stage, "/World/Other")
            place(other, np.eye(4))
        message = stepped(host, runner, 2.0)
        assert message == f"{SIM}: /World/Other: {RESET}"
        before = shown(host, 3.0).positions
        runner.reset()
        runner.run()
        host.ended()
        assert not np.array_equal(before, shown(host, 3.0).positions)


def test_a_prim_that_goes_ends_the_run_and_the_picture_stays(tmp_path: Path) -> None:
    """Oracle: the sentence; a run that begins anew does without it."""
    stage = shot(tmp_path, {}, last=3)
    with running(stage) as (host, runner):
        stepped(host, runner, 1.0)
        stepped(host, runner, 2.0)
        with host.lock:
            stage.RemovePrim("/World/Stick")
        runner.step()
        message = host.until("failed").message
        assert (
            message
            == "/World/Stick: found a prim that no longer exists, expected the prim, or Reset"
        )
        assert runner.status.frames == (1.0, 2.0)
        assert len(shown(host, 2.0)) == 200
        runner.run()
        assert host.ended().frame == 3.0


def test_a_value_that_cannot_be_is_told_and_waited_for(tmp_path: Path) -> None:
    """Oracle: a run that nobody disturbed, to the bit: nothing is lost when the value is mended."""
    stage = edited(shot(tmp_path, FALLING, last=4))
    with running(stage) as (host, runner):
        runner.run()
        host.ended()
        expected = [bits(shown(host, frame)) for frame in (3.0, 4.0)]
        runner.reset()
        for frame in (1.0, 2.0):
            stepped(host, runner, frame)
        with host.lock:
            drag = simulation_of(stage).GetAttribute("splatSim:particles:drag")
            drag.Set(-1.0)
        runner.run()
        status = host.until("failed")
        assert "splatSim:particles:drag: found -1" in status.message
        assert status.frames == (1.0, 2.0)
        runner.run()
        host.until("failed")
        with host.lock:
            drag.Set(0.0)
        runner.run()
        assert host.ended().state == "paused"
        assert [bits(shown(host, frame)) for frame in (3.0, 4.0)] == expected


def test_a_stage_that_cannot_be_simulated_says_why(tmp_path: Path) -> None:
    """Oracle: the sentence; mended, it runs."""
    stage = edited(shot(tmp_path, {}, last=2))
    cone = UsdGeom.Camera.Define(stage, "/World/Wrong").GetPrim()
    author(cone, {"affector:role": "collide"})
    with running(stage) as (host, runner):
        runner.run()
        assert "an affector of type Camera" in host.until("failed").message
        with host.lock:
            cone.SetActive(False)
        runner.run()
        assert host.ended().frame == 2.0


def test_a_bug_is_told_and_harms_nobody(tmp_path: Path, monkeypatch, caplog) -> None:
    """Oracle: the sentence, and a runner that works afterwards."""
    from usdsplat.preview.simulating import live

    stage = shot(tmp_path, {}, last=2)
    with running(stage) as (host, runner):
        with monkeypatch.context() as patch:
            patch.setattr(live, "Simulation", None)
            runner.run()
            assert "found an internal error" in host.until("failed").message
            assert "TypeError" in caplog.text
        runner.run()
        assert host.ended().frame == 2.0


def test_a_capture_with_velocities_stays_where_it_is_put(tmp_path: Path) -> None:
    """Oracle: the solver alone, to the bit; the capture's velocities would lead on from there."""
    stage = shot(tmp_path, {}, last=3)
    cloud = schema.fetch(stage.GetPrimAtPath(FIELD))
    fast = replace(cloud, velocities=np.full((len(cloud), 3), 50.0, np.float32))
    schema.author(stage, FIELD, fast, time=1.0)
    expected = played(stage, 3)
    with running(stage) as (host, runner):
        runner.run()
        host.ended()
        for number, each in enumerate(expected):
            assert bits(shown(host, number + 1.0)) == bits(each)


def test_lively_edits_do_not_stop_a_run(tmp_path: Path) -> None:
    """Oracle: it ends. Everything is turned on and off between frames that come and go."""
    stage = edited(shot(tmp_path, {**LIVELY, "rd:enabled": False}, last=12, count=100))
    names = ("rd:enabled", "dissolve:enabled", "particles:enabled", "sim:enabled")
    rng = np.random.default_rng(4)
    with running(stage) as (host, runner):
        runner.run()
        frame = 1.0
        while frame < 12:
            frame = host.wait(lambda event: event.frame is not None).frame
            with host.lock:
                values = dict(zip(names, rng.random(4) < 0.5, strict=True))
                author(simulation_of(stage), {k: bool(v) for k, v in values.items()})
        assert runner.status.state != "failed"
