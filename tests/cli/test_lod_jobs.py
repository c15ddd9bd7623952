"""Tests of `usdsplat lod` as a job: the same files by any number of workers."""

from __future__ import annotations

import os
import random
import subprocess
import sys

import pytest
from pxr import Usd

from tests.cli.conftest import ball
from usdsplat import formats, schema
from usdsplat.cli.job_options import JobRunner
from usdsplat.core.errors import JobError

pytestmark = pytest.mark.usefixtures("compiled")
FLAGS = ("--leaf-splats", "256", "-q")


@pytest.fixture
def scans(tmp_path):
    """Two captures."""
    paths = [tmp_path / "a.ply", tmp_path / "b.ply"]
    for seed, path in enumerate(paths):
        formats.write(ball(3000, seed), path)
    return paths


def files(folder):
    """Names and bytes of all files of a tree."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture
def alone(run_json, scans, tmp_path):
    """The files of a tree that one process built."""
    run_json("lod", *scans, "-o", tmp_path / "alone" / "city.usda", *FLAGS)
    found = files(tmp_path / "alone")
    assert len(found) > 8
    return found


@pytest.mark.parametrize("count", [1, 2, 5])
def test_parts_in_any_order_make_the_same_tree(run_json, scans, tmp_path, alone, count):
    """Oracle: the files of one process, byte for byte."""
    words = ("lod", *scans, "-o", tmp_path / "parts" / "city.usda", *FLAGS)
    (tmp_path / "parts").mkdir()
    run_json(*words, "--step", "begin")
    for step in ("sort", "build"):
        numbers = list(range(1, count + 1))
        random.Random(count).shuffle(numbers)
        for number in numbers:
            run_json(*words, "--step", step, "--part", f"{number}/{count}")
    assert len(list((tmp_path / "parts" / ".city.usda.building" / "chunks").iterdir())) > 3
    run_json(*words)
    assert files(tmp_path / "parts") == alone


def test_a_job_builds_the_same_tree(run_json, scans, tmp_path, alone):
    """Oracle: the files of one process, byte for byte."""
    run_json("lod", *scans, "-o", tmp_path / "job" / "city.usda", *FLAGS, "--jobs", "2")
    assert files(tmp_path / "job") == alone


def test_findings_of_the_inputs_are_said_before_the_first_task(run, scans, tmp_path, monkeypatch):
    """Oracle: what stderr has when the job begins is the finding that one process reports; with
    --strict the job does not begin."""
    scene = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    schema.author(scene, "/Ball", ball())
    scene.DefinePrim("/Gone").GetReferences().AddReference("gone.usd")
    scene.Save()
    words = ("lod", tmp_path / "scene.usda", "-o", tmp_path / "city.usda", "--leaf-splats", "256")
    _, _, expected = run(*words)
    assert "gone.usd" in expected
    said = []

    def failing(self, job):
        said.append([each.told for each in self._reporter.findings])
        raise JobError(job.name, "nothing", "a test")

    monkeypatch.setattr(JobRunner, "run", failing)
    status, _, err = run(*words, "--jobs", "1")
    assert status == 2 and said == [[expected.removeprefix("usdsplat: ").rstrip()]]
    assert err.startswith(expected) and err.count("gone.usd") == 1
    assert run(*words, "--jobs", "1", "--strict")[0] == 1 and len(said) == 1


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        (("--step", "sort", "--part", "1/2"), "found no building with these inputs and options"),
        (("--step", "sort"), "--part: found none with --step sort, expected K/N"),
        (("--step", "all"), "--step: found 'all', expected one of begin, sort, build"),
        (("--step", "sort", "--part", "3/2"), "--part: found '3/2', expected K/N"),
        (("--jobs", "2", "--chunk", "3"), "--chunk: found --chunk with lod, expected"),
    ],
    ids=lambda each: str(each)[:24],
)
def test_bad_steps(run, scans, tmp_path, flags, sentence):
    """Oracle: the sentences, and that nothing is written."""
    status, _, err = run("lod", *scans, "-o", tmp_path / "city.usda", *FLAGS, *flags)
    assert status == 2 and sentence in err
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.ply", "b.ply"]


def test_a_folder_that_cannot_be_made_is_refused_before_the_first_task(run, scans, tmp_path):
    """Oracle: one sentence; no task is tried."""
    status, _, err = run("lod", *scans, "-o", scans[0] / "city.usda", *FLAGS, "--jobs", "1")
    assert status == 2 and err.count("\n") == 1
    assert "expected a place where a folder can be made" in err


def test_building_needs_all_sorted_splats(run, run_json, scans, tmp_path):
    """Oracle: the sentence."""
    words = ("lod", *scans, "-o", tmp_path / "city.usda", *FLAGS)
    run_json(*words, "--step", "begin")
    status, _, err = run(*words, "--step", "build", "--part", "1/2")
    assert status == 2 and "found a building whose splats are not sorted" in err


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_job_that_is_killed_goes_on(scans, tmp_path, alone, seed):
    """Oracle: the files of one process, after the job was killed at a random moment."""
    words = ("lod", *scans, "-o", tmp_path / "job" / "city.usda", *FLAGS, "--jobs", "2")
    command = [sys.executable, "-m", "usdsplat", *map(str, words)]
    environment = {**os.environ, "USDSPLAT_SUPERVISE": "0"}
    client = subprocess.Popen(command, env=environment)
    try:
        client.wait(random.Random(seed).uniform(1, 8))
    except subprocess.TimeoutExpired:
        client.kill()
        client.wait()
    subprocess.run(command, check=True, timeout=300)
    assert files(tmp_path / "job") == alone
