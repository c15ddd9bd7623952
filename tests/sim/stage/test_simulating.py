"""Tests from a stage to a layer, with the real solver and the real bake."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.sim.recipes import ball
from tests.sim.stage.bakes import everything
from tests.sim.stage.scenes import LIVELY, save_shot
from tests.sim.stage.stages import FIELD, SIM, moved, place, rigid, simulation_of
from usdsplat import schema
from usdsplat.core import covariance
from usdsplat.core.errors import OutputError, StageError
from usdsplat.core.findings import Findings
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.devices import open_device
from usdsplat.sim.stage import simulating
from usdsplat.sim.stage.authoring import author
from usdsplat.sim.stage.provenance import read_record
from usdsplat.sim.stage.report import Clock
from usdsplat.sim.stage.simulating import SimulateOptions, simulate
from usdsplat.sim.stage.simulation import Simulation

ROOT = Path(__file__).resolve().parents[3]
FRAMES = tuple(float(time) for time in range(1, 15))


def bake(shot: Path, folder: str = "whole", frames=FRAMES, **options) -> Path:
    """A bake in a folder beside the shot."""
    target = shot.with_name(folder) / "bake.usda"
    target.parent.mkdir(exist_ok=True)
    simulate(Usd.Stage.Open(str(shot)), target, frames, SimulateOptions(**options))
    return target


def files(target: Path) -> dict[str, bytes]:
    """Everything that a bake wrote, byte by byte."""
    found = [target, *target.with_name("bake_data").iterdir()]
    return {path.name: path.read_bytes() for path in sorted(found)}


def fresh(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()


def test_the_device_is_closed_and_its_remark_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: a device that says what it is told; one that is given stays open."""
    closed: list[str] = []

    class Told(CpuDevice):
        def close(self) -> None:
            closed.append(self.remark)

    def stops(*_: Any, **__: Any) -> None:
        raise Killed

    monkeypatch.setattr(simulating, "open_device", lambda *_, **__: Told(remark="a GPU but"))
    monkeypatch.setattr(simulating, "Simulation", stops)
    stage, target, told = Usd.Stage.CreateInMemory(), tmp_path / "bake.usda", []
    with pytest.raises(Killed):
        simulate(stage, target, FRAMES, findings=Findings(say=told.append))
    assert told == closed == ["a GPU but"]
    with pytest.raises(Killed):
        simulate(stage, target, FRAMES, SimulateOptions(device=Told(remark="given")))
    assert closed == ["a GPU but"]


# --- killed, and resumed -------------------------------------------------------------------


class Killed(BaseException):
    """As Ctrl-C would."""


def test_ten_of_ten_stopped_bakes_end_like_one_that_was_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: a bake that nobody disturbed: every value at every sample and all bytes. It is
    stopped after any piece of the solver's work, or of writing."""
    shot = save_shot(tmp_path, {**LIVELY, "bake:mode": "clips"})
    whole = bake(shot)
    expected, laps = files(whole), [0]
    lap = Clock.lap

    def count(self: Clock, name: str) -> None:
        laps[0] -= 1
        if laps[0] == 0:
            raise Killed(name)
        lap(self, name)

    monkeypatch.setattr(Clock, "lap", count)
    fresh(tmp_path / "killed")
    laps[0] = 10**6
    bake(shot, "killed")
    every = 10**6 - laps[0]
    for number in np.random.default_rng(5).integers(2, every - 2, 10):
        fresh(tmp_path / "killed")
        laps[0] = int(number)
        with pytest.raises(Killed):
            bake(shot, "killed")
        laps[0] = 0
        again = bake(shot, "killed", existing="resume")
        assert files(again) == expected
    assert everything(again) == everything(whole)


def command(shot: Path, target: Path) -> list[str]:
    """The command that goes on with a bake."""
    words = ["simulate", str(shot), "-o", str(target), "--frames", "1:30", "--resume"]
    return [sys.executable, "-m", "usdsplat", *words]


@pytest.mark.slow
@pytest.mark.parametrize("kills", [2, 10])
def test_killed_for_good_at_any_moment(tmp_path: Path, kills: int) -> None:
    """Oracle: a command that nobody disturbed: all values at all samples, and all bytes. Processes
    are killed by a signal, wherever they are after the first frame; splats are born and die."""
    shot = save_shot(tmp_path, LIVELY, count=3000)
    whole, target = tmp_path / "whole" / "bake.usda", tmp_path / "killed" / "bake.usda"
    whole.parent.mkdir()
    began = time.perf_counter()
    subprocess.run(command(shot, whole), cwd=ROOT, check=True, capture_output=True)
    span = time.perf_counter() - began
    expected, rng = everything(whole), np.random.default_rng(11)
    died = 0
    for _ in range(kills):
        fresh(target.parent)
        child = subprocess.Popen(
            command(shot, target), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        while not target.exists() and child.poll() is None:
            time.sleep(0.005)
        time.sleep(rng.uniform(0, 0.4 * span))
        child.send_signal(signal.SIGKILL)
        child.communicate()
        died += child.returncode == -signal.SIGKILL
        subprocess.run(command(shot, target), cwd=ROOT, check=True, capture_output=True)
        assert files(target) == files(whole)
        assert everything(target) == expected
    assert died > kills // 2


def test_births_and_deaths_are_in_the_bake(tmp_path: Path) -> None:
    """Oracle: the solver's own frames, matched by id: what is alive then has their places; counts
    rise and fall."""
    shot = save_shot(tmp_path, LIVELY)
    stage = Usd.Stage.Open(str(bake(shot)))
    simulation = Simulation(Usd.Stage.Open(str(shot)), FRAMES, device=open_device())
    simulation.begin()
    counts = []
    for number, frame in enumerate(FRAMES):
        if number:
            simulation.advance()
        expected = simulation.frame(FIELD).cloud
        found = schema.fetch(stage.GetPrimAtPath(FIELD), frame)
        rows = np.searchsorted(found.ids, expected.ids)
        np.testing.assert_array_equal(found.ids[rows], expected.ids)
        np.testing.assert_array_equal(found.positions[rows], expected.positions)
        counts.append(len(expected))
    assert (np.diff(counts) > 0).any()
    assert (np.diff(counts) < 0).any()


def test_an_existing_file_is_not_replaced_unasked(tmp_path: Path) -> None:
    """Oracle: the sentence; with force the same bytes come again."""
    shot = save_shot(tmp_path, {})
    target = bake(shot, frames=FRAMES[:3])
    before = files(target)
    with pytest.raises(OutputError, match="a new name, or --resume or --force"):
        bake(shot, frames=FRAMES[:3])
    assert files(bake(shot, frames=FRAMES[:3], existing="replace")) == before


# --- what a bake says ------------------------------------------------------------------------


def played(stage: Usd.Stage, frames=FRAMES) -> list[dict[str, object]]:
    """All fields at all frames."""
    simulation = Simulation(stage, frames, device=open_device())
    simulation.begin()
    found = []
    for number in range(len(frames)):
        if number:
            simulation.advance()
        found.append({path: simulation.frame(path) for path in simulation.recipes})
    return found


def test_a_push_alone_leaves_opacities_to_the_capture(tmp_path: Path) -> None:
    """Oracle: the attributes that have samples on the layer of results."""
    stage = Usd.Stage.Open(str(bake(save_shot(tmp_path, {}))))
    field = stage.GetPrimAtPath(FIELD)
    assert field.GetAttribute("positions").GetNumTimeSamples() == len(FRAMES)
    assert field.GetAttribute("orientations").GetNumTimeSamples() > 0
    assert field.GetAttribute("opacities").GetNumTimeSamples() == 0


@pytest.mark.parametrize("rate", [24.0, 30.0])
def test_two_fields_and_two_simulations(tmp_path: Path, rate: float) -> None:
    """Oracle: each field simulated alone, to the bit: the one does not know of the other."""
    shot = save_shot(tmp_path, {"particles:enabled": True, "particles:gravity": (0, -1, 0)})
    stage = Usd.Stage.Open(str(shot))
    stage.SetTimeCodesPerSecond(rate)
    schema.author(stage, "/World/Other", ball(300, seed=8))
    alone = {}
    for path in (FIELD, "/World/Other"):
        for each in (FIELD, "/World/Other"):
            stage.GetPrimAtPath(each).SetActive(each == path)
        alone[path] = [frame[path] for frame in played(stage)]
    for each in (FIELD, "/World/Other"):
        stage.GetPrimAtPath(each).SetActive(True)
    together = played(stage)
    assert set(together[0]) == {FIELD, "/World/Other"}
    other = stage.DefinePrim("/World/Sim2", "SplatSim")
    author(other, {"particles:enabled": True, "particles:gravity": (0.0, -1.0, 0.0)})
    for prim, path in ((simulation_of(stage), FIELD), (other, "/World/Other")):
        Usd.CollectionAPI.Apply(prim, "splats").CreateIncludesRel().SetTargets([path])
    apart = played(stage)
    for number in range(len(FRAMES)):
        for path in (FIELD, "/World/Other"):
            expected = alone[path][number].cloud
            for frames in (together, apart):
                found = frames[number][path].cloud
                np.testing.assert_array_equal(found.positions, expected.positions)
                np.testing.assert_array_equal(found.rotations, expected.rotations)
    target = tmp_path / "both.usda"
    stage.Save()
    simulate(stage, target, FRAMES)
    baked = Usd.Stage.Open(str(target))
    for path in (FIELD, "/World/Other"):
        cloud = schema.fetch(baked.GetPrimAtPath(path), FRAMES[-1])
        np.testing.assert_array_equal(cloud.positions, alone[path][-1].cloud.positions)


def test_two_simulations_do_not_share_a_field(tmp_path: Path) -> None:
    """Oracle: the sentence."""
    stage = Usd.Stage.Open(str(save_shot(tmp_path, {})))
    stage.DefinePrim("/World/Sim2", "SplatSim")
    with pytest.raises(StageError, match="the simulations /World/Sim and /World/Sim2"):
        Simulation(stage, FRAMES, device=open_device())


def spinning(stage: Usd.Stage) -> None:
    """The field moves and turns, 30 degrees a frame."""
    for time_code in range(1, 41):
        angle = np.radians(30.0) * (time_code - 1)
        matrix = rigid(1)
        matrix[:3, :3] = matrix[:3, :3] @ [
            [np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]
        ]  # fmt: skip
        matrix[:3, 3] += 0.1 * time_code
        place(stage.GetPrimAtPath(FIELD), matrix, time_code)


def test_in_the_stages_space_splats_stay_where_a_field_that_moves_was(tmp_path: Path) -> None:
    """Oracle: through USD's transform at each frame the baked splats are where those of the first
    frame are, with their covariances, and a twelfth of a turn apart in the field's own space; the
    quaternions of frames that follow each other are on one side."""
    stage = Usd.Stage.Open(str(save_shot(tmp_path, {"sim:space": "world"}, count=200)))
    stage.RemovePrim("/World/Stick")
    spinning(stage)
    stage.Save()
    target = tmp_path / "bake.usda"
    simulate(stage, target, FRAMES)
    baked = Usd.Stage.Open(str(target))
    field = baked.GetPrimAtPath(FIELD)
    assert field.GetAttribute("scales").GetNumTimeSamples() == 0
    first, last = None, None
    for frame in FRAMES:
        cloud = schema.fetch(field, frame)
        world = np.array(UsdGeom.XformCache(frame).GetLocalToWorldTransform(field)).T
        shapes = covariance.from_scale_rotation(
            cloud.scales.astype(np.float64), cloud.rotations.astype(np.float64)
        )
        turn = world[:3, :3]
        now = moved(world, cloud.positions), turn @ shapes @ turn.T
        if first is None:
            first = now
        else:
            assert ((cloud.rotations * last).sum(axis=1) > 0.9).all()
        last = cloud.rotations
        np.testing.assert_allclose(now[0], first[0], rtol=0, atol=2e-6)
        np.testing.assert_allclose(now[1], first[1], rtol=0, atol=1e-7)


def test_a_restart_in_the_stages_space_keeps_the_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: a bake that was not stopped; the sides of quaternions depend on the frame before."""
    stage = Usd.Stage.Open(str(save_shot(tmp_path, {**LIVELY, "sim:space": "world"})))
    spinning(stage)
    stage.Save()
    shot = tmp_path / "shot.usda"
    expected = files(bake(shot))
    lap, left = Clock.lap, [60]

    def stop(self: Clock, name: str) -> None:
        left[0] -= 1
        if left[0] == 0:
            raise Killed(name)
        lap(self, name)

    monkeypatch.setattr(Clock, "lap", stop)
    with pytest.raises(Killed):
        bake(shot, "killed")
    assert files(bake(shot, "killed", existing="resume")) == expected


def test_in_its_own_space_a_field_that_moves_takes_no_notice(tmp_path: Path) -> None:
    """Oracle: the same field where it does not move, to the bit; nothing else acts on it."""
    values = {"deform:bow:type": "bend", "deform:bow:angle": 40.0}
    found = []
    for moves in (False, True):
        stage = Usd.Stage.Open(str(save_shot(tmp_path / str(moves), values, count=200)))
        stage.RemovePrim("/World/Stick")
        if moves:
            spinning(stage)
        found.append([frame[FIELD].cloud for frame in played(stage)])
    for a, b in zip(*found, strict=True):
        for name in ("positions", "rotations", "scales", "sh"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_a_range_may_begin_within_a_simulation(tmp_path: Path) -> None:
    """Oracle: the frames of a bake of all of it; without a start time a range begins anew."""
    stage = Usd.Stage.Open(str(save_shot(tmp_path, {**LIVELY, "sim:startTime": 1.0})))
    whole = played(stage)
    later = played(stage, FRAMES[6:])
    for a, b in zip(later, whole[6:], strict=True):
        for name in ("positions", "rotations", "scales", "opacities", "sh", "ids"):
            there = getattr(a[FIELD].cloud, name)
            np.testing.assert_array_equal(there, getattr(b[FIELD].cloud, name))
    author(simulation_of(stage), {"sim:startTime": float("-inf")})
    anew = played(stage, FRAMES[6:])
    assert not np.array_equal(anew[-1][FIELD].cloud.positions, whole[-1][FIELD].cloud.positions)


def test_a_stage_without_a_simulation_is_refused(tmp_path: Path) -> None:
    """Oracle: the sentence."""
    stage = Usd.Stage.Open(str(save_shot(tmp_path, {})))
    stage.RemovePrim(SIM)
    with pytest.raises(StageError, match="found no SplatSim prim"):
        Simulation(stage, FRAMES, device=open_device())


def test_what_was_automatic_is_remembered(tmp_path: Path) -> None:
    """Oracle: the solver's own answers, read back from the layer of results."""
    shot = save_shot(tmp_path, LIVELY)
    stage = Usd.Stage.Open(str(shot))
    simulation = Simulation(stage, FRAMES, device=open_device())
    simulation.begin()
    record = read_record(Sdf.Layer.FindOrOpen(str(bake(shot, frames=FRAMES[:2]))))
    assert record is not None
    for path, solver in simulation.solvers.items():
        assert record["resolved"][path] == simulation.resolved(path)
        assert {"patternScale", "dimension", "hMin", "hMax"} <= set(solver.resolved)


def test_compiling_is_booked_apart() -> None:
    """Oracle: a compiler that says to have taken an hour, of which nobody else has any."""
    spent = [0.0]
    clock = Clock(lambda: spent[0])
    spent[0] = 3600.0
    clock.lap("work")
    assert -3600 <= clock.spent["work"] < -3500
