"""Tests of bakes that are killed and resumed."""

from __future__ import annotations

import itertools
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType

import numpy as np
import pytest
from pxr import Sdf, Usd

from tests.folded import folded
from tests.sim.stage.bakes import PATH, Shot, everything, shot
from usdsplat import schema
from usdsplat.core.errors import FormatError, StageError
from usdsplat.sim.stage.bake import Bake

SECOND = "/World/Others/Splats"
ROOT = Path(__file__).resolve().parents[3]


class Killed(BaseException):
    """As Ctrl-C would."""


def at_event(number: int) -> Callable[[str], None]:
    """Die at the event of that number."""
    left = [number]

    def stop(event: str) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise Killed(event)

    return stop


def files(folder: Path) -> dict[str, bytes]:
    """The samples, byte by byte."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def both(folder: Path, mode: str, **options: object) -> tuple[Shot, Shot]:
    """The same shot twice, in two folders."""
    options = {"lives": mode != "edit", "paths": (PATH, SECOND), **options}
    made = []
    for name in ("whole", "killed"):
        (folder / name).mkdir()
        made.append(shot(folder / name, mode, **options))
    return made[0], made[1]


@pytest.mark.parametrize("mode", folded(["packed", "dense", "clips", "edit"]))
def test_ten_of_ten_killed_bakes_end_like_one_that_was_not(tmp_path: Path, mode: str) -> None:
    """Oracle: a bake that nobody disturbed: every value at every sample, the bytes of the samples,
    and the solvers' states."""
    whole, killed = both(tmp_path, mode, count=11)
    whole.run()
    expected = everything(whole.target)
    rng = np.random.default_rng(["dense", "clips", "packed", "edit"].index(mode))
    for number in rng.integers(0, 46, 10):
        killed.target.unlink(missing_ok=True)
        shutil.rmtree(killed.target.with_name("bake_data"), ignore_errors=True)
        with pytest.raises(Killed):
            killed.run(stop=at_event(int(number)))
        killed.run(resume=True)
        assert killed.digests == whole.digests
        assert everything(killed.target) == expected
        assert files(tmp_path / "killed" / "bake_data") == files(tmp_path / "whole" / "bake_data")


@pytest.mark.parametrize("written", [1, 2, 3])
def test_interrupted_at_any_statement_of_a_checkpoint(tmp_path: Path, written: int) -> None:
    """Oracle: the samples of a bake that nobody disturbed. The statement after which a checkpoint
    is in place is among those at which the interrupt comes."""
    whole, killed = both(tmp_path, "dense", paths=(PATH,), count=11)
    whole.run()
    expected = files(tmp_path / "whole" / "bake_data")
    left = itertools.count(0)
    while True:
        killed.target.unlink(missing_ok=True)
        shutil.rmtree(killed.target.with_name("bake_data"), ignore_errors=True)
        before = sys.gettrace()
        sys.settrace(at_line(Bake.checkpoint.__code__, call=written, line=next(left)))
        try:
            killed.run()
        except Killed:
            sys.settrace(before)
            killed.run(resume=True)
            assert files(tmp_path / "killed" / "bake_data") == expected
        else:
            break
        finally:
            sys.settrace(before)
    assert next(left) > 15


def at_line(code: CodeType, *, call: int, line: int) -> Callable[..., object]:
    """Die at a line, by its number in the order of execution, of a call of a function."""
    calls = itertools.count(1)
    lines = itertools.count()

    def of_line(frame: FrameType, event: str, value: object) -> object:
        if event == "line" and next(lines) == line:
            raise Killed(f"{code.co_name}, line {frame.f_lineno}")
        return of_line

    def of_call(frame: FrameType, event: str, value: object) -> object:
        return of_line if frame.f_code is code and next(calls) == call else None

    return of_call


def test_frames_before_the_checkpoint_are_not_simulated_again(tmp_path: Path) -> None:
    """Oracle: the frames that the solver was asked for."""
    bake = shot(tmp_path)
    with pytest.raises(Killed):
        bake.run(stop=at_event(16))  # after the checkpoint at frame 6, in the epoch of 5 to 8
    bake.frames.clear()
    bake.run(resume=True)
    assert [frame.time for frame in bake.frames[PATH]] == bake.times[6:]


@pytest.mark.parametrize("mode", ["dense", "packed", "edit"])
def test_what_a_killed_bake_has_done_can_be_seen(tmp_path: Path, mode: str) -> None:
    """Oracle: the record's count of frames, and the solver's arrays at those."""
    bake = shot(tmp_path, mode, lives=mode != "edit")
    with pytest.raises(Killed):
        bake.run(stop=at_event(24))
    stage = Usd.Stage.Open(str(bake.target))
    record = stage.GetRootLayer().customLayerData["usdsplat"]["bake"]
    done = record["completedFrames"]
    assert 0 < done < 14
    assert (tmp_path / record["checkpoint"]).is_file()
    for frame in bake.frames[PATH][:done]:
        found = schema.fetch(stage.GetPrimAtPath(PATH), frame.time)
        alive = found.opacities > 0
        assert alive.sum() == len(frame.cloud)
        np.testing.assert_array_equal(found.positions[alive], frame.cloud.positions)


def test_a_complete_bake_is_left_alone(tmp_path: Path) -> None:
    """Oracle: the bytes of its files; nothing is simulated."""
    bake = shot(tmp_path)
    bake.run()
    before = files(tmp_path / "bake_data")
    bake.frames.clear()
    bake.run(resume=True)
    assert not bake.frames
    assert files(tmp_path / "bake_data") == before


def test_without_a_bake_resuming_is_beginning(tmp_path: Path) -> None:
    """Oracle: a bake that was not asked to resume."""
    whole, other = both(tmp_path, "dense")
    whole.run()
    other.run(resume=True)
    assert everything(other.target) == everything(whole.target)


def test_a_new_bake_replaces_an_old_one(tmp_path: Path) -> None:
    """Oracle: the files of the new one alone."""
    shot(tmp_path, "clips").run()
    again = shot(tmp_path, "dense", stage=Usd.Stage.Open(str(tmp_path / "shot.usda")))
    again.run()
    assert list(files(tmp_path / "bake_data")) == ["kept_checkpoint", "samples.usdc"]


def changed_input(bake: Shot) -> None:
    prim = bake.stage.GetPrimAtPath(PATH)
    prim.GetAttribute("opacities").Set([0.5] * 12)
    bake.stage.Save()


def changed_parameter(bake: Shot) -> None:
    with Usd.EditContext(bake.stage, bake.stage.GetSessionLayer()):
        prim = bake.stage.GetPrimAtPath(PATH)
        prim.CreateAttribute("splatSim:rd:feed", Sdf.ValueTypeNames.Float).Set(0.05)


def changed_mode(bake: Shot) -> None:
    object.__setattr__(bake.parameters, "mode", "packed")


def changed_range(bake: Shot) -> None:
    bake.times = bake.times[:-2]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (changed_input, r"found other input files \(shot.usda\)"),
        (
            changed_parameter,
            rf"other parameters, the first is {PATH}\.splatSim:rd:feed, .*--set",
        ),
        (changed_mode, "found another mode, packed, expected dense"),
        (changed_range, "found another frame range"),
    ],
)
def test_other_ingredients_are_refused(
    tmp_path: Path, change: Callable[[Shot], None], sentence: str
) -> None:
    """Oracle: the sentences; what was baked stays as it is."""
    bake = shot(tmp_path)
    with pytest.raises(Killed):
        bake.run(stop=at_event(20))
    before = files(tmp_path / "bake_data")
    change(bake)
    with pytest.raises(StageError, match=sentence):
        bake.run(resume=True)
    assert files(tmp_path / "bake_data") == before


def test_a_damaged_checkpoint_is_refused(tmp_path: Path) -> None:
    """Oracle: the sentence."""
    bake = shot(tmp_path)
    with pytest.raises(Killed):
        bake.run(stop=at_event(20))
    path = tmp_path / "bake_data" / "checkpoint"
    path.write_bytes(path.read_bytes()[:-70])
    with pytest.raises(FormatError, match="checkpoint: found a damaged file"):
        bake.run(resume=True)


def test_a_layer_that_is_no_bake_is_not_resumed(tmp_path: Path) -> None:
    """Oracle: the sentence, and its bytes."""
    bake = shot(tmp_path)
    bake.target.write_text("#usda 1.0\n")
    with pytest.raises(StageError, match="a layer that is not a bake"):
        bake.run(resume=True)
    assert bake.target.read_text() == "#usda 1.0\n"


CHILD = """
import sys
from pathlib import Path
from pxr import Usd
from tests.sim.stage.bakes import shot
bake = shot(Path(sys.argv[1]), stage=Usd.Stage.Open(sys.argv[1] + "/shot.usda"), n=3000)
print("ready", flush=True)
bake.run(resume=True)
"""


def test_killed_for_good_at_any_moment(tmp_path: Path) -> None:
    """Oracle: a bake that nobody disturbed; the process is killed by a signal, wherever it is."""
    whole, killed = both(tmp_path, "dense", paths=(PATH,), n=3000)
    whole.run()
    rng = np.random.default_rng(7)
    for _ in range(4):
        child = subprocess.Popen(
            [sys.executable, "-c", CHILD, str(tmp_path / "killed")],
            stdout=subprocess.PIPE,
            cwd=ROOT,
        )
        assert child.stdout is not None
        assert child.stdout.readline() == b"ready\n"
        time.sleep(rng.uniform(0.0, 0.25))
        child.send_signal(signal.SIGKILL)
        child.wait()
        child.stdout.close()
    killed.run(resume=True)
    assert everything(killed.target) == everything(whole.target)
    assert files(tmp_path / "killed" / "bake_data") == files(tmp_path / "whole" / "bake_data")
