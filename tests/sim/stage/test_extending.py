"""Tests of finished bakes that get more frames."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd

from tests.sim.stage.bakes import PATH, Shot, everything, shot
from tests.sim.stage.test_resume import ROOT, SECOND, Killed, at_event, both, files
from usdsplat.core.errors import FormatError, StageError
from usdsplat.sim.stage.bake_findings import bake_findings
from usdsplat.sim.stage.extending import last_epoch

MODES = ["dense", "clips", "packed", "edit"]


def shortened(bake: Shot, count: int) -> Shot:
    """The same bake, of its first frames."""
    return Shot(
        stage=bake.stage, target=bake.target, parameters=bake.parameters,
        times=bake.times[:count], solvers=bake.solvers, writes=bake.writes,
    )  # fmt: skip


def same(killed: Shot, whole: Shot) -> None:
    """Every value at every sample, the bytes of all files, and the solvers' states."""
    assert killed.digests == whole.digests
    assert everything(killed.target) == everything(whole.target)
    assert files(killed.target.with_name("bake_data")) == files(whole.target.with_name("bake_data"))
    assert killed.target.read_bytes() == whole.target.read_bytes()


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("count", [1, 4, 5, 7, 8, 9, 12])
def test_more_frames_give_the_bytes_of_all_at_once(tmp_path: Path, mode: str, count: int) -> None:
    """Oracle: a bake of all frames, in epochs of four: from one that ends with an epoch, in the
    middle of one, or before the first ends; the checkpoint that is kept is compared too."""
    whole, other = both(tmp_path, mode, count=13)
    whole.run()
    shortened(other, count).run()
    assert other.target.with_name("bake_data").joinpath("kept_checkpoint").is_file()
    other.run(resume=True)
    same(other, whole)


@pytest.mark.parametrize("mode", ["dense", "clips"])
def test_a_bake_may_grow_again_and_again(tmp_path: Path, mode: str) -> None:
    """Oracle: a bake of all frames."""
    whole, other = both(tmp_path, mode, count=14)
    whole.run()
    for count in (2, 3, 6, 11, 14):
        part = shortened(other, count)
        part.run(resume=True)
    other.digests = part.digests
    same(other, whole)


def test_only_the_last_epoch_is_simulated_again(tmp_path: Path) -> None:
    """Oracle: the frames that the solver was asked for."""
    bake = shot(tmp_path, count=14)
    shortened(bake, 11).run()
    bake.run(resume=True)
    assert [frame.time for frame in bake.frames[PATH]] == bake.times[9:]


@pytest.mark.parametrize("mode", MODES)
def test_an_extension_may_be_killed_at_any_event(tmp_path: Path, mode: str) -> None:
    """Oracle: a bake of all frames; until the end, the shorter bake can be seen as it was."""
    whole, other = both(tmp_path, mode, count=14)
    whole.run()
    rng = np.random.default_rng(MODES.index(mode))
    for number in rng.integers(0, 22, 4):  # of 22 events
        other.target.unlink(missing_ok=True)
        shutil.rmtree(other.target.with_name("bake_data"), ignore_errors=True)
        shortened(other, 9).run()
        seen = everything(other.target)
        with pytest.raises(Killed):
            other.run(resume=True, stop=at_event(int(number)))
        now = everything(other.target)
        lost = [key for key in seen if key.startswith(f"{PATH}.positions") and key not in now]
        assert lost == []
        (said,) = bake_findings(Usd.Stage.Open(str(other.target)))
        assert said.code == "unfinished-bake" and "frames from 1 to 14" in said.expected
        other.run(resume=True)
        same(other, whole)


CHILD = """
import sys
from pathlib import Path
from pxr import Usd
from tests.sim.stage.bakes import shot
from tests.sim.stage.test_extending import shortened
stage = Usd.Stage.Open(sys.argv[1] + "/shot.usda")
bake = shot(Path(sys.argv[1]), sys.argv[2], stage=stage, n=3000)
print("ready", flush=True)
shortened(bake, 9).run(resume=True)
bake.run(resume=True)
"""


@pytest.mark.parametrize("mode", ["dense", "clips"])
def test_killed_for_good_at_any_moment(tmp_path: Path, mode: str) -> None:
    """Oracle: a bake that nobody disturbed; the process is killed by a signal, wherever it is, in
    the shorter bake or in its extension."""
    whole, other = both(tmp_path, mode, paths=(PATH,), n=3000)
    whole.run()
    rng = np.random.default_rng(3)
    for is_killed in (True, True, True, True, False):
        child = subprocess.Popen(
            [sys.executable, "-c", CHILD, str(tmp_path / "killed"), mode],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # a bake that was extended already is longer than nine
            cwd=ROOT,
        )
        assert child.stdout is not None
        assert child.stdout.readline() == b"ready\n"
        if is_killed:
            time.sleep(rng.uniform(0.0, 0.6))
            child.send_signal(signal.SIGKILL)
        child.wait()
        child.stdout.close()
    other.run(resume=True)
    if not other.frames:  # a child had finished it: no solver has run here
        other.digests = whole.digests
    same(other, whole)


def test_a_bake_without_its_checkpoint_is_not_extended(tmp_path: Path) -> None:
    """Oracle: the sentence; the bytes of the bake."""
    bake = shot(tmp_path, count=9)
    short = shortened(bake, 6)
    short.run()
    kept = tmp_path / "bake_data" / "kept_checkpoint"
    before = kept.read_bytes()
    kept.unlink()
    bytes_of = files(tmp_path / "bake_data")
    with pytest.raises(StageError, match=r"bake.usda: found a bake without bake_data/kept_checkp"):
        bake.run(resume=True)
    kept.write_bytes(before[:-70])
    with pytest.raises(FormatError, match="kept_checkpoint: found a damaged file"):
        bake.run(resume=True)
    kept.unlink()
    assert files(tmp_path / "bake_data") == bytes_of


def test_the_checkpoint_can_be_dropped(tmp_path: Path) -> None:
    """Oracle: the listing: by the bake, or by a later run that has nothing else to do."""
    bake = shot(tmp_path, count=6)
    bake.run()
    kept = tmp_path / "bake_data" / "kept_checkpoint"
    assert kept.is_file()
    bake.keeps = False
    bake.run(resume=True)
    assert not kept.exists() and (tmp_path / "bake_data" / "samples.usdc").is_file()
    bake.run()
    assert list(files(tmp_path / "bake_data")) == ["samples.usdc"]


def test_other_ingredients_are_refused(tmp_path: Path) -> None:
    """Oracle: the sentences; what was baked stays as it is. What changes after the checkpoint only
    is no other parameter."""
    bake = shot(tmp_path, count=13)
    shortened(bake, 10).run()
    before = files(tmp_path / "bake_data")
    with pytest.raises(StageError, match="found another frame range, "):
        shortened(bake, 5).run(resume=True)
    prim = bake.stage.GetPrimAtPath(PATH)
    with Usd.EditContext(bake.stage, bake.stage.GetSessionLayer()):
        feed = prim.CreateAttribute("splatSim:rd:feed", Sdf.ValueTypeNames.Float)
        feed.Set(0.05, 1)
    with pytest.raises(StageError, match="extended: found other parameters, expected those that"):
        bake.run(resume=True)
    assert files(tmp_path / "bake_data") == before


def test_frames_that_need_more_are_refused(tmp_path: Path) -> None:
    """Oracle: the sentence names the feature."""
    bake = shot(tmp_path, count=9)
    shortened(bake, 6).run()
    bake.features = ("/World/Splats: collides",)
    with pytest.raises(StageError, match=r"frames that need more than 1:6 \(/World/Splats: coll"):
        bake.run(resume=True)


def test_two_fields_are_extended_together(tmp_path: Path) -> None:
    """Oracle: the paths in the layer of results."""
    _, other = both(tmp_path, "dense", count=9)
    shortened(other, 5).run()
    other.run(resume=True)
    stage = Usd.Stage.Open(str(other.target))
    for path in (PATH, SECOND):
        times = stage.GetPrimAtPath(path).GetAttribute("positions").GetTimeSamples()
        assert {float(each) for each in range(1, 10)} <= set(times)


@pytest.mark.parametrize(("frames", "first"), [(1, 0), (4, 0), (5, 4), (8, 4), (9, 8)])
def test_the_last_epoch_has_at_least_one_frame(frames: int, first: int) -> None:
    """Oracle: by hand, for epochs of four frames."""
    assert last_epoch(frames, 4) == first
