"""Tests of `usdsplat simulate` as a job: the same bakes by tasks that resume each other."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys

import numpy as np
import pytest
from pxr import Usd

from tests.cli.conftest import passing_sphere
from usdsplat.cli.job_options import JobRunner
from usdsplat.sim.stage import provenance
from usdsplat.sim.stage.authoring import author

pytestmark = pytest.mark.usefixtures("compiled")
FRAMES = ("--frames", "1:4", "-q", "--device", "cpu", "--threads", "1")


@pytest.fixture
def pushed(shot, tmp_path):
    """A stage whose splats are pushed, with a checkpoint at each frame."""
    stage = Usd.Stage.Open(str(shot))
    sim = stage.DefinePrim("/Sim", "SplatSim")
    sim.GetRelationship("collection:splats:includes").AddTarget("/World")
    passing_sphere(stage, "/Ball")
    author(sim, {"bake:checkpointEvery": 1})
    stage.Save()
    return shot


def files(folder):
    """Names and bytes of all files of bakes, but for the pictures."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix != ".png"
    }


def test_a_bake_that_stops_is_resumed_to_the_same_bytes(run_json, pushed, tmp_path):
    """Oracle: the bytes of a bake at once."""
    run_json("simulate", pushed, "-o", tmp_path / "once" / "b.usda", *FRAMES)
    words = ("simulate", pushed, "-o", tmp_path / "parts" / "b.usda", *FRAMES)
    report = run_json(*words, "--until", "2")
    assert report["frames"] == 2 and not report["is_finished"]
    report = run_json(*words, "--resume", "--until", "2")
    assert report["frames"] == 0 and not report["is_finished"]
    report = run_json(*words, "--resume", "--until", "3")
    assert report["frames"] == 1 and not report["is_finished"]
    report = run_json(*words, "--resume")
    assert report["frames"] == 1 and report["is_finished"]
    assert files(tmp_path / "parts") == files(tmp_path / "once")


@pytest.fixture
def masked(pushed):
    """The stage with a mask of a picture, in a folder of its own."""
    folder = pushed.parent / "show"
    folder.mkdir()
    pushed.rename(folder / "shot.usda")
    painted(folder, 255)
    stage = Usd.Stage.Open(str(folder / "shot.usda"))
    mask = {"source": "texture", "file": "./mask.png"}
    names = {f"mask:m:{name}": value for name, value in mask.items()}
    author(stage.GetPrimAtPath("/Sim"), {**names, "settle:omega:mask": "m"})
    stage.Save()
    return folder


def painted(folder, white):
    """Paint the picture of the mask: grey at the left, another grey at the right."""
    from PIL import Image

    pixels = np.full((8, 8, 3), white, np.uint8)
    pixels[:, :3] = 40
    Image.fromarray(pixels).save(folder / "mask.png")


def test_a_bake_with_a_picture_goes_on_where_it_was_moved(run, run_json, masked, tmp_path):
    """Oracle: the bytes of a bake at once. After the picture was painted again, no frames are
    added; the sentence names it."""
    words = ("simulate", masked / "shot.usda", "-o", masked / "b.usda", *FRAMES)
    run_json(*words)
    once = files(masked)
    for path in (masked / "b.usda", masked / "b_data"):
        path.unlink() if path.is_file() else shutil.rmtree(path)
    run_json(*words, "--until", "2")
    moved = masked.rename(tmp_path / "moved")
    words = ("simulate", moved / "shot.usda", "-o", moved / "b.usda", *FRAMES, "--resume")
    report = run_json(*words, "--until", "3")
    assert report["frames"] == 1
    painted(moved, 90)
    status, _, err = run(*words)
    named = "found other parameters, the first is /Sim.splatSim:mask:m:file, expected those that"
    assert status == 2 and named in err
    painted(moved, 255)
    run_json(*words)
    assert files(moved) == once


def test_a_bake_of_an_earlier_version_with_a_picture_is_refused(run, run_json, masked, monkeypatch):
    """Oracle: the sentence. The earlier version had the absolute path of the picture in its
    hash."""
    words = ("simulate", masked / "shot.usda", "-o", masked / "b.usda", *FRAMES)
    with monkeypatch.context() as earlier:
        earlier.setattr(provenance, "_content", str)
        run_json(*words, "--until", "2")
    status, out, err = run(*words, "--resume")
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert "found other parameters, the first is /Sim.splatSim:mask:m:file, expected those" in err


def test_jobs_bake_a_wedge_as_one_process(run_json, pushed, tmp_path):
    """Oracle: the bytes of the bakes of one process, and the same contact sheet."""
    axes = ("--wedge", "settle:omega=4,8")
    run_json("simulate", pushed, "-o", tmp_path / "once" / "b.usda", *FRAMES, *axes)
    words = ("simulate", pushed, "-o", tmp_path / "job" / "b.usda", *FRAMES, *axes)
    report = run_json(*words, "--jobs", "2", "--chunk", "2")
    assert len(report["bakes"]) == 2
    assert files(tmp_path / "job") == files(tmp_path / "once")
    pictures = [(tmp_path / each / "b.png").read_bytes() for each in ("job", "once")]
    assert pictures[0] == pictures[1]


def test_a_bake_is_not_replaced_unasked(run, run_json, pushed, tmp_path):
    """Oracle: the sentence, and the file."""
    run_json("simulate", pushed, "-o", tmp_path / "b.usda", *FRAMES)
    before = (tmp_path / "b.usda").read_bytes()
    words = ("simulate", pushed, "-o", tmp_path / "b.usda", *FRAMES, "--jobs", "1")
    status, _, err = run(*words)
    assert status == 2 and "found a file, expected a new name, or --resume" in err
    status, _, err = run(*words, "--force")
    expected = "--force: found --force with a job, expected --resume, or a new name"
    assert status == 2 and expected in err
    assert (tmp_path / "b.usda").read_bytes() == before
    inside = tmp_path / "b.usda" / "c.usda"
    status, _, err = run("simulate", pushed, "-o", inside, *FRAMES, "--jobs", "1")
    assert status == 2 and "found a file, " in err and "tried again" not in err


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        (("--force",), "--force: found --force with a job, expected --resume, or a new name"),
        (("--sheet-frame", "2"), "--sheet-frame: found 2 without --wedge, expected both"),
        (("--session-layer", "away.usda"), "away.usda: found no such file, expected a USD file"),
        (("-o", "there.usda"), "there.usda: found a file, expected a new name, or --resume"),
        (("-o", "there.usda/b.usda"), "found a file, there.usda, expected a place where"),
    ],
    ids=str,
)
def test_no_process_starts_for_an_order_that_is_wrong(
    run, pushed, tmp_path, monkeypatch, flags, sentence
):
    """Oracle: the sentences; what starts the processes is not entered."""

    def started(self):
        raise AssertionError

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(JobRunner, "__enter__", started)
    (tmp_path / "there.usda").touch()
    output = () if "-o" in flags else ("-o", "b.usda")
    status, _, err = run("simulate", pushed, *output, *FRAMES, "--jobs", "1", *flags)
    assert status == 2 and sentence in err
    status, _, err = run("simulate", "away.usd", "-o", "b.usda", *FRAMES, "--jobs", "1")
    assert status == 2 and "away.usd: found no such file, expected a USD file" in err


@pytest.mark.parametrize("number", [1, 2])
def test_one_combination_of_a_wedge_is_the_bake_of_this_name(run_json, pushed, tmp_path, number):
    """Oracle: the bytes of a bake with --set; no other bake and no contact sheet is made."""
    words = ("simulate", pushed, "-o", tmp_path / "one" / "b.usda", *FRAMES)
    wedge = ("--wedge", "settle:omega=4,8", "--combination", number)
    run_json(*words, *wedge, "--until", "2")
    run_json(*words, *wedge, "--resume")
    name, value = f"b_settle-omega={4 * number}.usda", f"settle:omega={4 * number}"
    alone = ("simulate", pushed, "-o", tmp_path / "alone" / name, *FRAMES, "--set", value)
    run_json(*alone)
    assert files(tmp_path / "one") == files(tmp_path / "alone")
    assert not list(tmp_path.glob("one/*.png"))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_job_that_is_killed_goes_on(pushed, tmp_path, run_json, seed):
    """Oracle: the bytes of one process, after the job was killed at a random moment."""
    run_json("simulate", pushed, "-o", tmp_path / "once" / "b.usda", *FRAMES)
    words = ("simulate", pushed, "-o", tmp_path / "job" / "b.usda", *FRAMES, "--jobs", "1")
    command = [sys.executable, "-m", "usdsplat", *map(str, words), "--chunk", "1"]
    client = subprocess.Popen(command, env={**os.environ, "USDSPLAT_SUPERVISE": "0"})
    try:
        client.wait(random.Random(seed).uniform(2, 9))
    except subprocess.TimeoutExpired:
        client.kill()
        client.wait()
    subprocess.run([*command, "--resume"], check=True, timeout=300)
    assert files(tmp_path / "job") == files(tmp_path / "once")


def test_a_wedge_is_checked_before_its_workers_start(run, pushed, tmp_path, monkeypatch):
    """Oracle: by hand: a bake that exists, one that goes on, frames with a gap."""
    (tmp_path / "b_settle-omega=2.usda").write_text("")
    words = ("simulate", pushed, "-o", tmp_path / "b.usda", "--jobs", "2")
    monkeypatch.setattr(JobRunner, "__enter__", lambda self: pytest.fail("workers start"))
    status, _, err = run(*words, "--wedge", "settle:omega=1,2")
    assert status == 2
    assert err.endswith("b_settle-omega=2.usda: found a file, expected a new name, or --resume\n")
    status, _, err = run(*words, "--frames", "1,3")
    assert status == 2 and "found 1,3, expected every frame from one to another" in err
