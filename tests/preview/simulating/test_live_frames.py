"""Tests of frames that are drawn while a simulation plays, without being on the stage."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from tests.delegate.stages import contents
from tests.preview.documents import BLACK, drawn_by
from tests.preview.simulating.hosts import Host, running, shot
from tests.sim.stage.scenes import LIVELY
from tests.sim.stage.stages import FIELD
from usdsplat import schema
from usdsplat.delegate.engine import Engine
from usdsplat.preview.document import Document
from usdsplat.preview.simulating.live import LiveRun
from usdsplat.preview.simulating.live_layer import LiveLayer
from usdsplat.preview.simulating.runner import Runner
from usdsplat.preview.values import Look, Picture, ViewState

PUSH: dict[str, object] = {}
AOVS = ("color", "depth", "Neye", "elementId")


@contextmanager
def held_in_play(stage: Usd.Stage, frame: float, monkeypatch) -> Iterator[tuple[Host, Runner]]:
    """A run that plays, held after a frame as if it would compute the next one."""
    tell = LiveRun._changed

    def hold(run: LiveRun) -> None:
        if run.frame == frame:
            run.gate.hold()
        tell(run)

    monkeypatch.setattr(LiveRun, "_changed", hold)
    with running(stage) as (host, runner):
        runner.run()
        host.reached(frame)
        yield host, runner


def samples(stage: Usd.Stage) -> list[float]:
    """Times at which the stage has positions."""
    return stage.GetPrimAtPath(FIELD).GetAttribute("positions").GetTimeSamples()


def pictures(engine: Engine) -> dict[str, np.ndarray]:
    """Every AOV from a fixed side."""
    view = engine.view(resolution=(64, 48))
    return {name: each.copy() for name, each in engine.picture(view, None, AOVS).items()}


def test_the_frames_of_a_run_are_listed_with_the_lock_of_the_stage(tmp_path, monkeypatch) -> None:
    """Oracle: the lock itself, each time; without it a pause that authors them meanwhile may end
    the run."""
    owned, frames = [], LiveLayer.frames
    with running(shot(tmp_path, PUSH, last=6, count=20)) as (host, runner):

        def listed(layer: LiveLayer) -> tuple[float, float] | None:
            owned.append(host.lock._is_owned())
            return frames.fget(layer)

        monkeypatch.setattr(LiveLayer, "frames", property(listed))
        runner.run()
        assert host.ended().frames == (1.0, 6.0)
    assert owned and all(owned)


@pytest.mark.parametrize("form", ["float", "half", "packed"])
@pytest.mark.parametrize("values", [PUSH, LIVELY], ids=["push", "lively"])
def test_both_ways_give_the_same_picture(tmp_path: Path, monkeypatch, form, values) -> None:
    """Oracle: an engine that reads the frame from the stage, bit for bit: its splats and all
    AOVs, with authored normals, which do not follow splats that move."""
    stage = shot(tmp_path, values, last=9, count=120)
    capture = schema.fetch(stage.GetPrimAtPath(FIELD))
    prim = schema.author(stage, FIELD, capture, form=form)
    normals = np.tile(np.float32([0, 1, 0]), (len(capture), 1))
    ones = np.ones(len(capture), np.float32)
    schema.author_surface(prim, normals=normals, confidence=ones, occlusion=ones)
    stage.Save()
    with held_in_play(stage, 6.0, monkeypatch) as (host, runner), host.lock:
        assert samples(stage) == [1.0]  # what plays is not authored
        with Engine(stage, time=6.0) as engine:
            still = contents(engine)
            live = runner.shown_at(6.0)
            assert live is not None and live is runner.shown_at(6.0)
            engine.show_live(live)
            shown, drawn = contents(engine), pictures(engine)
            assert shown != still
            runner.author()
            assert samples(stage) == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
            assert runner.shown_at(6.0) is None
            engine.show_live(None)
            assert contents(engine) == shown
            for name, each in pictures(engine).items():
                np.testing.assert_array_equal(each, drawn[name])
        with Engine(stage, time=6.0) as fresh:
            assert contents(fresh) == shown
            for name, each in pictures(fresh).items():
                np.testing.assert_array_equal(each, drawn[name])


def test_a_pause_puts_the_frames_on_the_stage(tmp_path: Path, monkeypatch) -> None:
    """Oracle: the samples: one while it plays, all of them afterwards."""
    stage = shot(tmp_path, PUSH, last=9, count=60)
    with held_in_play(stage, 5.0, monkeypatch) as (host, runner):
        with host.lock:
            assert samples(stage) == [1.0]
        runner.pause()
        with host.lock:
            assert samples(stage) == [1.0, 2.0, 3.0, 4.0, 5.0]
        assert runner.status.frames == (1.0, 5.0)


def test_scrubbing_between_frames_puts_them_on_the_stage(tmp_path: Path, monkeypatch) -> None:
    """Oracle: the samples: the stage is needed neither at a frame nor before the first one that it
    lacks, and it interpolates between frames."""
    stage = shot(tmp_path, PUSH, last=9, count=60)
    with held_in_play(stage, 5.0, monkeypatch) as (host, runner), host.lock:
        for time in (3.0, 5.0, 1.0, 0.5, None):
            assert (runner.shown_at(time) is not None) == (time in (3.0, 5.0))
            assert samples(stage) == [1.0]
        assert runner.shown_at(3.5) is None
        assert samples(stage) == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_an_opinion_of_the_user_is_stronger(tmp_path: Path, monkeypatch) -> None:
    """Oracle: the composed stage: its session layer is above that of the frames."""
    stage = shot(tmp_path, PUSH, last=9, count=60)
    with held_in_play(stage, 5.0, monkeypatch) as (host, runner), host.lock:
        assert runner.shown_at(5.0) is not None
        with Usd.EditContext(stage, stage.GetSessionLayer()):
            stage.GetPrimAtPath(FIELD).GetAttribute("scales").Set([(0.5, 0.5, 0.5)] * 60)
        assert runner.shown_at(5.0) is None
        assert len(samples(stage)) == 5
        with Engine(stage, time=5.0) as engine:
            ((_, field, _),) = engine.render_scene.drawn()
            assert (field.spec.cloud.scales == 0.5).all()


def test_values_beyond_the_budget_are_forgotten(tmp_path: Path, monkeypatch) -> None:
    """Oracle: the frames that are left: two at least."""
    stage = shot(tmp_path, PUSH, last=9, count=60)
    tell = LiveRun._changed

    def hold(run: LiveRun) -> None:
        if run.frame == 7.0:
            run.gate.hold()
        tell(run)

    monkeypatch.setattr(LiveRun, "_changed", hold)
    with running(stage, budget=1.0) as (host, runner):
        runner.run()
        host.reached(7.0)
        assert runner.status.frames == (6.0, 7.0)
        with host.lock:
            assert samples(stage) == []
            assert runner.shown_at(6.0) is not None and runner.shown_at(5.0) is None
        runner.pause()
        with host.lock:
            assert samples(stage) == [6.0, 7.0]


def test_a_document_draws_frames_and_their_motion(tmp_path: Path, monkeypatch) -> None:
    """Oracle: an engine of its own on the stage with all frames; the first picture needs none of
    them on the stage, and one with motion blur does."""
    stage = shot(tmp_path, PUSH, last=9, count=120)
    events: list[object] = []
    document = Document(stage, publish=events.append)
    state = ViewState(size=(64, 48), camera=None, display=BLACK, time=4.0)
    blurred = Look(aov="forward")
    with held_in_play(stage, 5.0, monkeypatch) as (host, runner):
        document.lock, document.simulation = host.lock, runner
        for each in (state, replace(state, time=5.0)):
            drawn_by(document, each)
        assert samples(stage) == [1.0]
        sharp = [each.image for each in events if isinstance(each, Picture) and each.is_final]
        drawn_by(document, replace(state, look=blurred))
        assert len(samples(stage)) == 5
        runner.pause()
        for time, image in zip((4.0, 5.0), sharp, strict=True):
            fresh = Document(stage, publish=events.append)
            fresh.draw(replace(state, time=4.0))  # the camera frames the same
            drawn_by(fresh, replace(state, time=time))
            np.testing.assert_array_equal(events[-1].image, image)
            fresh.close()
        document.simulation = None
        document.close()
    assert not np.array_equal(*sharp)


def test_frames_before_a_failure_stay(tmp_path: Path) -> None:
    """Oracle: the samples after the prim that takes part has gone."""
    stage = shot(tmp_path, PUSH, last=200, count=60)
    with running(stage) as (host, runner):
        runner.run()
        host.reached(5.0)
        with host.lock:
            stage.RemovePrim("/World/Stick")
        frames = host.until("failed").frames
        with host.lock:
            assert (samples(stage)[0], samples(stage)[-1]) == frames
