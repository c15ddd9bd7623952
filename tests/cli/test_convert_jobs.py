"""Tests of `usdsplat convert` of sequences as a job: the same files by any number of workers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from pxr import Usd

from tests.cli.conftest import ball
from usdsplat import formats

pytestmark = pytest.mark.usefixtures("compiled")
EDITS = ("--scale", "2", "--drop-outliers", "--rotate", "0,0,90", "--morton", "--axes", "rub")


@pytest.fixture
def captures(tmp_path):
    """The name of a sequence of captures of 5 frames, whose numbers of splats differ."""
    (tmp_path / "in").mkdir()
    for frame in range(1, 6):
        formats.write(ball(100 + frame, frame), tmp_path / "in" / f"cap.{frame:04}.ply")
    return tmp_path / "in" / "cap.####.ply"


def files(folder):
    return {each.name: each.read_bytes() for each in sorted(folder.iterdir())}


@pytest.mark.parametrize("how", [("--jobs", "2"), ("--dask", "local")], ids=" ".join)
def test_a_job_writes_the_files_and_the_report_of_one_process(run_json, captures, tmp_path, how):
    """Oracle: one process: bytes, and the report but for the name of the output."""
    if "--dask" in how:
        pytest.importorskip("distributed")
    words = ("convert", captures, *EDITS)
    alone = run_json(*words, tmp_path / "alone" / "c.####.sog")
    made = run_json(*words, tmp_path / "job" / "c.####.sog", *how, "--chunk", "2")
    assert files(tmp_path / "job") == files(tmp_path / "alone")
    assert len(files(tmp_path / "job")) == 5 and made["frames"] == [1, 2, 3, 4, 5]
    assert {**made, "target": ""} == {**alone, "target": ""}


def test_frames_of_a_stage_are_those_of_one_process(run, run_json, shot, tmp_path):
    """Oracle: one process: bytes, the text, and the finding of a reference that is missing, which
    is said once."""
    stage = Usd.Stage.Open(str(shot))
    stage.DefinePrim("/Gone").GetReferences().AddReference("gone.usd")
    stage.Save()
    words = ("convert", shot, "--frames", "1,3-4", "--prim", "/World/Ball")
    alone = run(*words, tmp_path / "alone" / "c.####.ply")
    made = run(*words, tmp_path / "job" / "c.####.ply", "--jobs", "1", "--chunk", "1")
    assert made == (0, alone[1].replace("/alone/", "/job/"), alone[2]) and "gone.usd" in made[2]
    assert sorted(files(tmp_path / "job")) == [f"c.000{frame}.ply" for frame in (1, 3, 4)]
    assert files(tmp_path / "job") == files(tmp_path / "alone")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("out.usda", "--jobs", "2"), "found one output of a job, expected captures with a frame"),
        (("out.####.ply", "--jobs", "2", "--strict"), "--strict: found it with --jobs, --dask or"),
        (("out.####.ply", "--chunk", "2"), "--chunk: found no --jobs, --dask or --openjd with"),
        (("out.####.ply", "--frames", "7", "--jobs", "1"), "found no file for frame 7"),
    ],
    ids=lambda each: str(each)[:30],
)
def test_bad_jobs(run, captures, tmp_path, monkeypatch, words, sentence):
    """Oracle: the sentences, and that nothing is written."""
    monkeypatch.chdir(tmp_path)
    status, out, err = run("convert", captures, *words)
    assert (status, out) == (2, "") and sentence in err
    assert [each.name for each in tmp_path.iterdir()] == ["in"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["captures", "shot"])
def test_openjd_writes_the_files_of_one_process(run_json, request, tmp_path, kind):
    """Oracle: one process: bytes; the bundle was moved, and the inputs are gone."""
    pytest.importorskip("openjd.cli")
    source = request.getfixturevalue(kind)
    words = ("convert", source, "--scale", "2", "--frames", "1-4")
    run_json(*words, tmp_path / "alone" / "c.####.ply")
    run_json(*words, "c.####.ply", "--openjd", tmp_path / "bundle", "--chunk", "3")
    (tmp_path / "bundle").rename(tmp_path / "moved")
    for each in source.parent.glob("*.ply" if kind == "captures" else "*.usda"):
        each.unlink()
    openjd = Path(sys.executable).with_name("openjd")
    environment = {**os.environ, "PATH": f"{openjd.parent}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        [openjd, "run", tmp_path / "moved" / "template.yaml", "--extensions", "TASK_CHUNKING"],
        capture_output=True, env=environment, timeout=600, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert done.returncode == 0, done.stdout.decode() + done.stderr.decode()
    assert files(tmp_path / "moved" / "out") == files(tmp_path / "alone")
