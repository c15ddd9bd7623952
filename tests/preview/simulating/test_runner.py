"""Tests of simulations under a document: run, pause, step, reset."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd

from tests.delegate.stages import contents
from tests.preview.simulating.hosts import Host, running, shot
from tests.sim.stage.scenes import LIVELY
from tests.sim.stage.stages import FIELD
from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.delegate.engine import Engine
from usdsplat.kernels.devices import open_device
from usdsplat.preview.simulating import live_layer
from usdsplat.sim.stage.simulation import Simulation

PUSH: dict[str, object] = {}
ARRAYS = ("positions", "rotations", "scales", "opacities", "sh")


def bits(cloud: SplatCloud) -> tuple[bytes, ...]:
    return tuple(getattr(cloud, name).tobytes() for name in ARRAYS)


def shown(host: Host, frame: float | None) -> SplatCloud:
    """The field as the stage has it."""
    with host.lock:
        return schema.fetch(host.stage.GetPrimAtPath(FIELD), frame)


def played(stage: Usd.Stage, last: int) -> list[SplatCloud]:
    """The field at each frame, by the solver alone."""
    frames = [float(frame) for frame in range(1, last + 1)]
    simulation = Simulation(stage, frames, device=open_device(task="geometry"))
    simulation.begin()
    found = [simulation.frame(FIELD).cloud]
    for _ in frames[1:]:
        simulation.advance()
        found.append(simulation.frame(FIELD).cloud)
    return found


@pytest.mark.parametrize("values", [PUSH, LIVELY], ids=["push", "lively"])
def test_each_frame_on_the_stage_is_the_solvers(tmp_path: Path, values) -> None:
    """Oracle: the solver alone, array by array and to the bit; splats are born and die."""
    stage = shot(tmp_path, values, last=12)
    expected = played(Usd.Stage.Open(stage.GetRootLayer().realPath), 12)
    with running(stage) as (host, runner):
        assert runner.status.state == "ready"
        runner.run()
        status = host.ended()
        assert (status.state, status.frame, status.frames) == ("paused", 12, (1, 12))
        assert status.splats == len(expected[-1])
        for number, cloud in enumerate(expected):
            found = shown(host, number + 1.0)
            assert bits(found) == bits(cloud)
            assert found.ids is None or (found.ids == cloud.ids).all()
        assert host.wakes >= 12


def test_a_start_that_is_no_number_is_told_by_a_run(tmp_path: Path) -> None:
    """Oracle: by hand: the stage opens, and the run names the attribute."""
    stage = shot(tmp_path, PUSH)
    (sim,) = (prim for prim in stage.Traverse() if prim.GetTypeName() == "SplatSim")
    spec = stage.GetRootLayer().GetPrimAtPath(sim.GetPath())
    name = "splatSim:sim:startTime"
    Sdf.AttributeSpec(spec, name, Sdf.ValueTypeNames.String).default = "first"
    with running(stage) as (host, runner):
        assert (runner.status.state, runner.status.start) == ("ready", None)
        runner.run()
        status = host.wait(lambda event: event.state == "failed")
        assert "splatSim:sim:startTime" in status.message


def test_pause_step_and_reset(tmp_path: Path) -> None:
    """Oracle: a person's expectation: a step is a frame, and a reset leaves nothing behind, in the
    picture's splats, the session layer and the composed stage."""
    stage = shot(tmp_path, PUSH)
    with Engine(stage, time=3.0) as engine, running(stage) as (host, runner):
        before, text = contents(engine), stage.Flatten().ExportToString()
        for frame in (1.0, 2.0, 3.0):
            runner.step()
            status = host.wait(lambda event, frame=frame: event.frame == frame)
            assert status.frames == (1.0, frame)
            assert runner.status.state == "paused"
        assert contents(engine) != before
        runner.reset()
        assert runner.status.state == "ready"
        assert contents(engine) == before
        assert stage.Flatten().ExportToString() == text
        assert stage.GetSessionLayer().empty
        runner.run()
        assert host.ended().frame == 6


def test_a_pause_holds_where_it_is_and_run_goes_on(tmp_path: Path) -> None:
    """Oracle: the solver alone: a run that was held between any two pieces of work, also of its
    beginning, has the same bits."""
    stage = shot(tmp_path, LIVELY, last=4)
    expected = played(Usd.Stage.Open(stage.GetRootLayer().realPath), 4)
    with running(stage) as (host, runner):
        runner.run()
        for _ in range(25):
            runner.pause()
            assert runner.status.state == "paused"
            runner.run()
        host.ended()
        for number, cloud in enumerate(expected):
            assert bits(shown(host, number + 1.0)) == bits(cloud)


def test_a_beginning_that_is_reset_shows_nothing(tmp_path: Path) -> None:
    """Oracle: a person's expectation; the next run is as any other."""
    stage = shot(tmp_path, LIVELY, last=2)
    with running(stage) as (host, runner):
        text = stage.Flatten().ExportToString()
        runner.run()
        assert runner.status.state == "beginning"
        runner.reset()
        assert runner.status.state == "ready"
        assert stage.Flatten().ExportToString() == text
        runner.run()
        assert host.ended().frame == 2


def test_without_a_range_it_goes_on_from_1(tmp_path: Path) -> None:
    """Oracle: the status; frames come after the last that was looked at beforehand."""
    stage = shot(tmp_path, {"particles:enabled": True}, count=5)
    root = stage.GetRootLayer()
    root.ClearStartTimeCode()
    root.ClearEndTimeCode()
    with running(stage) as (host, runner):
        runner.run()
        status = host.reached(250.0)
        assert status.end is None
        runner.pause()
        assert runner.status.frames is not None


def test_the_oldest_frames_are_forgotten_beyond_the_budget(tmp_path: Path) -> None:
    """Oracle: the bytes of all but the opacities, which a bend leaves alone: where three frames and
    a half fit, three stay, and are whole."""
    stage = shot(tmp_path, {"deform:bow:type": "bend", "deform:bow:angle": 40.0}, last=6)
    stage.RemovePrim("/World/Stick")
    expected = played(stage, 6)
    size = sum(getattr(expected[-1], name).nbytes for name in ARRAYS if name != "opacities")
    with running(stage, budget=3.5 * size) as (host, runner):
        runner.run()
        assert host.ended().frames == (4.0, 6.0)
        field = stage.GetPrimAtPath(FIELD)
        assert field.GetAttribute("positions").GetTimeSamples() == [4.0, 5.0, 6.0]
        assert bits(shown(host, 5.0)) == bits(expected[4])


def test_two_documents_do_not_influence_each_other(tmp_path: Path) -> None:
    """Oracle: each alone, to the bit."""
    stages = [
        shot(tmp_path / name, LIVELY, last=5, count=n) for name, n in (("a", 200), ("b", 150))
    ]
    alone = [played(Usd.Stage.Open(each.GetRootLayer().realPath), 5) for each in stages]
    with running(stages[0]) as (first, one), running(stages[1]) as (second, two):
        one.run()
        two.run()
        first.ended()
        second.ended()
        for host, expected in zip((first, second), alone, strict=True):
            for number, cloud in enumerate(expected):
                assert bits(shown(host, number + 1.0)) == bits(cloud)


def test_the_picture_follows(tmp_path: Path) -> None:
    """Oracle: a stage on which the solver's frame is authored as a field, rendered by itself."""
    stage = shot(tmp_path, PUSH, last=8)
    expected = played(Usd.Stage.Open(stage.GetRootLayer().realPath), 8)[-1]
    with Engine(stage, time=8.0) as engine, running(stage) as (host, runner):
        view = engine.view(resolution=(64, 48))
        before = engine.picture(view)["color"].copy()
        runner.run()
        host.ended()
        with host.lock:
            after = engine.picture(view)["color"].copy()
        assert not np.array_equal(before, after)
        other = Usd.Stage.Open(stage.GetRootLayer().realPath)
        other.SetEditTarget(other.GetSessionLayer())  # the other layers are those of the stage
        schema.author(other, FIELD, expected)
        with Engine(other, time=8.0) as fresh:
            np.testing.assert_array_equal(fresh.picture(view)["color"], after)
        runner.reset()
        np.testing.assert_array_equal(engine.picture(view)["color"], before)


@pytest.mark.parametrize("form", ["half", "packed"])
@pytest.mark.parametrize("values", [PUSH, LIVELY], ids=["push", "lively"])
def test_captures_of_other_forms(tmp_path: Path, form, values) -> None:
    """Oracle: the solver alone; half loses what half loses, and a packed capture, whose prim is
    retyped, nothing. A reset restores the capture to the bit."""
    stage = shot(tmp_path, values, last=5, count=100)
    capture = schema.fetch(stage.GetPrimAtPath(FIELD))
    schema.author(stage, FIELD, capture, form=form)
    stage.Save()
    expected = played(Usd.Stage.Open(stage.GetRootLayer().realPath), 5)
    with running(stage) as (host, runner):
        before = bits(shown(host, None)), bits(shown(host, 3.0))
        runner.run()
        host.ended()
        for number, cloud in enumerate(expected):
            found = shown(host, number + 1.0)
            assert found.sh.shape == cloud.sh.shape
            for name in ARRAYS:
                loss = 2e-3 if form == "half" else 0.0
                there = getattr(found, name)
                np.testing.assert_allclose(there, getattr(cloud, name), rtol=loss, atol=loss / 10)
        runner.reset()
        assert (bits(shown(host, None)), bits(shown(host, 3.0))) == before
        assert schema.form_of(stage.GetPrimAtPath(FIELD)) == form


@pytest.mark.parametrize("rate", [12.0, 60.0])
def test_stages_of_any_rate(tmp_path: Path, rate: float) -> None:
    """Oracle: the solver alone, at the same times: USD scales layers of other rates."""
    stage = shot(tmp_path, PUSH, last=4)
    stage.SetTimeCodesPerSecond(rate)
    expected = played(stage, 4)
    with running(stage) as (host, runner):
        runner.run()
        host.ended()
        for number, cloud in enumerate(expected):
            assert bits(shown(host, number + 1.0)) == bits(cloud)


def test_a_stage_without_a_simulation_says_so() -> None:
    """Oracle: the sentence; the state before it was asked to run is none."""
    stage = Usd.Stage.CreateInMemory()
    with running(stage) as (host, runner):
        assert runner.status.state == "none"
        runner.run()
        assert "found no SplatSim prim" in host.until("failed").message


@pytest.mark.parametrize(("free", "expected"), [(0, 2e9), (1e9, 0.25e9), (64e9, 2e9)])
def test_frames_take_a_quarter_of_the_free_memory_at_most(monkeypatch, free, expected) -> None:
    """Oracle: the numbers; 0 is a system that does not say."""
    monkeypatch.setattr(live_layer, "free", lambda: free)
    assert live_layer.budget_now() == expected
