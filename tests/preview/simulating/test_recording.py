"""Tests that recording in the preview gives the same bake as the command."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd

from tests.preview.simulating.hosts import PATIENCE, running, shot
from tests.sim.stage.scenes import LIVELY
from tests.sim.stage.stages import simulation_of
from usdsplat.preview.simulating.job import Job
from usdsplat.preview.simulating.recording import can_resume
from usdsplat.schema import is_splat_field
from usdsplat.sim.stage import simulating
from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.bake import Bake
from usdsplat.sim.stage.bake_findings import bake_findings
from usdsplat.sim.stage.overrides import override
from usdsplat.sim.stage.provenance import read_record
from usdsplat.sim.stage.simulating import simulate
from usdsplat.sim.state import Frame

LAST = 8


def files(target: Path) -> dict[str, bytes]:
    """Everything that a bake wrote, byte by byte."""
    return {
        path.name: path.read_bytes() for path in (target, *target.with_name("b_data").iterdir())
    }


def baked(stage: Usd.Stage, folder: str, *overrides: str) -> Path:
    """What the command writes."""
    shot_path = Path(stage.GetRootLayer().realPath)
    other = Usd.Stage.Open(str(shot_path))
    for text in overrides:
        override(other, text)
    target = place(stage, folder)
    simulate(other, target, [float(frame) for frame in range(1, LAST + 1)])
    return target


def place(stage: Usd.Stage, folder: str) -> Path:
    target = Path(stage.GetRootLayer().realPath).with_name(folder) / "b.usda"
    target.parent.mkdir()
    return target


def test_a_recording_is_the_commands_bake(tmp_path: Path) -> None:
    """Oracle: all bytes of the command's files, its record among them; the run that was shown
    meanwhile stays, and goes on."""
    stage = shot(tmp_path, LIVELY, last=LAST)
    expected = files(baked(stage, "command"))
    target = place(stage, "preview")
    with running(stage) as (host, runner):
        runner.run()
        host.reached(2.0)
        runner.record(target)
        assert host.until("recording").message == "recording b.usda"
        status = host.wait(lambda event: str(target) in event.message)
        assert (status.state, status.frames is None) == ("paused", False)
        assert f"{LAST} frames of" in status.message
        assert files(target) == expected
        runner.run()
        assert host.ended().frame == LAST


def test_edits_of_the_session_are_recorded_and_those_that_come_later_are_not(
    tmp_path: Path,
) -> None:
    """Oracle: the command with the first edit as its override, to the byte."""
    stage = shot(tmp_path, {"particles:enabled": True}, last=LAST)
    expected = files(baked(stage, "command", "particles:gravity=0,-2,0"))
    target = place(stage, "preview")
    stage.SetEditTarget(stage.GetSessionLayer())
    override(stage, "particles:gravity=0,-2,0")
    with running(stage) as (host, runner):
        with host.lock:
            runner.record(target)
            author(simulation_of(stage), {"particles:gravity": (0.0, 9.0, 0.0)})
        host.wait(lambda event: str(target) in event.message)
        assert files(target) == expected


def test_a_recording_that_cannot_be_shown_goes_on(tmp_path: Path) -> None:
    """Oracle: the command's bake of the stage at the start, to the byte; the field is gone from the
    session's stage before its first frame, and no frame is shown there."""
    stage = shot(tmp_path, LIVELY, last=LAST)
    expected = files(baked(stage, "command"))
    target = place(stage, "preview")
    stage.SetEditTarget(stage.GetSessionLayer())
    with running(stage) as (host, runner):
        with host.lock:
            runner.record(target)
            stage.GetPrimAtPath("/World").SetActive(False)
        status = host.wait(lambda event: event.state == "failed" or str(target) in event.message)
        assert (status.state, status.frames) == ("ready", None), status.message
        assert status.recorded == (LAST, LAST)
        assert "not shown" in " ".join(status.notes)
        assert files(target) == expected
        assert not stage.GetSessionLayer().subLayerPaths


def test_a_recording_that_was_stopped_is_resumed(tmp_path: Path) -> None:
    """Oracle: all bytes of a bake that nobody disturbed."""
    stage = shot(tmp_path, LIVELY, last=LAST)
    expected = files(baked(stage, "command"))
    target = place(stage, "preview")
    with running(stage) as (host, runner):
        runner.record(target)
        host.reached(5.0)
        runner.pause()
        assert runner.status.state == "paused"
        runner.reset()
        status = runner.status
        assert status.state == "ready"
        assert "record to it again to resume" in status.message
        assert can_resume(target)
        runner.record(target, existing="resume")
        host.wait(lambda event: "frames of" in event.message)
        assert files(target) == expected
        record = read_record(Sdf.Layer.FindOrOpen(str(target)))
        assert record is not None
        assert record["completedFrames"] == LAST
        assert not can_resume(target)


def test_a_resumed_recording_that_is_stopped_counts_the_frames_of_its_bake(tmp_path: Path) -> None:
    """Oracle: the bake's record; the frames from before are in it, though they come again."""
    stage = shot(tmp_path, {}, last=LAST)
    target = place(stage, "preview")
    with running(stage) as (host, runner):
        for frame, existing in ((5.0, "error"), (2.0, "resume")):
            runner.record(target, existing=existing)
            host.reached(frame)
            runner.pause()
            runner.stop()
            status = host.wait(lambda event: bool(event.bake))
            record = read_record(Sdf.Layer.OpenAsAnonymous(str(target)))
            assert record is not None
            assert status.recorded == (record["completedFrames"], LAST)
            assert 5 <= record["completedFrames"] < LAST


@pytest.mark.parametrize("values", [LIVELY, {}], ids=["checkpoints", "none"])
@pytest.mark.parametrize("ends", ["reset", "close"])
def test_a_recording_that_was_stopped_is_a_whole_bake(
    tmp_path: Path, values: dict[str, Any], ends: str
) -> None:
    """Oracle: its record and samples, the findings of validation, and once it is resumed all bytes
    of a bake that nobody disturbed."""
    stage = shot(tmp_path, values, last=LAST)
    every = files(baked(stage, "command"))
    target = place(stage, "preview")
    with running(stage) as (host, runner):
        runner.record(target)
        host.reached(5.0)
        runner.pause()
        if ends == "reset":
            runner.reset()
            for job in runner._jobs:
                job.join()
    record = read_record(Sdf.Layer.FindOrOpen(str(target)))
    assert record is not None and not record["checkpoint"]
    done = record["completedFrames"]
    assert 5 <= done < LAST and list(record["frameRange"]) == [1.0, done]
    assert not [name for name in files(target) if name.endswith(".frame")]
    shown = Usd.Stage.Open(str(target))
    assert not list(bake_findings(shown))
    (field,) = [prim for prim in shown.Traverse() if is_splat_field(prim)]
    assert field.GetAttribute("positions").GetTimeSamples()[-1] == done
    assert can_resume(target)
    with running(stage) as (host, runner):
        runner.record(target, existing="resume")
        host.wait(lambda event: "frames of" in event.message)
    assert files(target) == every
    assert not can_resume(target)


def test_a_recording_begins_when_the_one_before_writes_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: all bytes of a bake that nobody disturbed, and whether the first was over when the
    second one's files were opened; nobody waited for it."""
    stage = shot(tmp_path, LIVELY, last=LAST)
    expected = files(baked(stage, "command"))
    target = place(stage, "preview")
    writing, may_write = threading.Event(), threading.Event()
    jobs: list[Job] = []
    were_over: list[bool] = []
    write, begin = Bake.write, Bake.open

    def slow(bake: Bake, path: str, frame: Frame) -> None:
        writing.set()
        assert may_write.wait(PATIENCE)
        write(bake, path, frame)

    def noted(*arguments: Any, **options: Any) -> Bake:
        were_over.extend(job.is_over for job in jobs)
        return begin(*arguments, **options)

    monkeypatch.setattr(Bake, "write", slow)
    monkeypatch.setattr(Bake, "open", noted)
    with running(stage) as (host, runner):
        runner.record(target)
        assert writing.wait(PATIENCE)
        jobs += runner._jobs
        runner.record(target, existing="replace")
        assert runner.is_recording
        may_write.set()
        host.wait(lambda event: "frames of" in event.message)
        assert were_over == [True]
        assert files(target) == expected


def test_stop_leaves_a_whole_bake_and_shows_its_frames(tmp_path: Path) -> None:
    """Oracle: the bake's record; the arrays of its last frame are those that are drawn, and those
    on the stage; a run removes them."""
    stage = shot(tmp_path, LIVELY, last=LAST)
    target = place(stage, "preview")
    with running(stage) as (host, runner):
        runner.record(target)
        status = host.reached(3.0)
        assert status.state == "recording" and status.recorded == (3, LAST)
        assert status.frames is not None and status.frames[0] == 1.0
        runner.pause()
        assert runner.status.state == "paused" and runner.status.bake == ""
        runner.stop()
        status = host.wait(lambda event: bool(event.bake))
        assert (status.state, status.bake) == ("paused", str(target))
        assert status.recorded is not None
        done, every = status.recorded
        assert 3 <= done < LAST == every and status.frames == (1.0, done)
        baked = Usd.Stage.Open(str(target))
        (field,) = [prim for prim in baked.Traverse() if is_splat_field(prim)]
        positions = field.GetAttribute("positions")
        assert positions.GetTimeSamples()[-1] == done
        on_stage = stage.GetAttributeAtPath(positions.GetPath())
        np.testing.assert_array_equal(on_stage.Get(done), positions.Get(done))
        runner.run()
        assert host.reached(1.0).recorded is None
        assert host.ended().frame == LAST
        runner.reset()
        assert not stage.GetSessionLayer().subLayerPaths
    assert can_resume(target)


def test_a_held_recording_goes_on(tmp_path: Path) -> None:
    """Oracle: all bytes of a bake that nobody disturbed."""
    stage = shot(tmp_path, LIVELY, last=LAST)
    expected = files(baked(stage, "command"))
    target = place(stage, "preview")
    with running(stage) as (host, runner):
        runner.record(target)
        for frame in (2.0, 4.0):
            host.reached(frame)
            runner.pause()
            runner.run()
        host.wait(lambda event: str(target) in event.message)
        assert files(target) == expected


@pytest.mark.parametrize(
    ("frames", "name", "sentence"),
    [
        ([1.0, 2.0], "there.usda/b.usda", "a folder that can be made"),
        ([1.0, 2.0], "there.usda", "a new name, or --resume or --force"),
        (None, "b.usda", "record: found a stage without a range, expected frames"),
    ],
)
def test_what_cannot_be_recorded_is_a_sentence(tmp_path, frames, name, sentence) -> None:
    """Oracle: the sentence; a run can be made afterwards."""
    stage = shot(tmp_path, {"particles:enabled": True}, last=2)
    if frames is None:
        stage.GetRootLayer().ClearStartTimeCode()
        stage.GetRootLayer().ClearEndTimeCode()
    (tmp_path / "there.usda").touch()
    with running(stage) as (host, runner):
        runner.record(tmp_path / name, frames=frames)
        assert sentence in host.until("failed").message
        runner.step()
        assert host.reached(1.0).message == ""


def test_a_recording_reads_the_stage_under_its_lock_alone(tmp_path: Path, monkeypatch) -> None:
    """Oracle: whether another thread could take the lock while the stage was read."""
    stage = shot(tmp_path, {}, last=2)
    target, alone = place(stage, "preview"), []
    with running(stage) as (host, runner):

        def watched(read):
            def reading(*args, **options):
                thread = threading.Thread(target=take)
                thread.start()
                thread.join()
                return read(*args, **options)

            return reading

        def take() -> None:
            alone.append(not host.lock.acquire(blocking=False))
            if not alone[-1]:
                host.lock.release()

        monkeypatch.setattr(simulating, "parameter_hash", watched(simulating.parameter_hash))
        monkeypatch.setattr(simulating.Bake, "open", watched(Bake.open))
        runner.record(target)
        host.wait(lambda event: "frames of" in event.message)
    assert alone == [True, True]
