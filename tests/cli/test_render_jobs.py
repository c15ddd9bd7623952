"""Tests of `usdsplat render` as a job: the same pictures by any number of processes, by Dask and by
Open Job Description."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from pxr import Usd

from tests.products.test_tiles import content
from usdsplat.core import interrupt
from usdsplat.jobs.local import LocalWorkers
from usdsplat.kernels.cuda import support

pytestmark = pytest.mark.usefixtures("compiled")
FLAGS = ("--frames", "1-4", "--resolution", "64x40", "--aovs", "color,Z,id,cryptoObject")
CPU = ("--device", "cpu")


@pytest.fixture
def alone(run_json, shot, tmp_path):
    """The pictures of one process, by name."""
    run_json("render", shot, "-o", tmp_path / "alone" / "a.####.exr", *FLAGS, *CPU)
    found = {each.name: content(each) for each in (tmp_path / "alone").iterdir()}
    assert len(found) == 4
    return found


def pictures(folder):
    return {each.name: content(each) for each in folder.iterdir()}


@pytest.mark.parametrize("how", [("--jobs", "2"), ("--dask", "local", "--retries", "0")], ids=str)
def test_a_job_has_the_pictures_of_one_process(run_json, shot, tmp_path, alone, how):
    """Oracle: pictures of one process, pixels and headers but dates, in tiles and whole."""
    pytest.importorskip("distributed")
    out = tmp_path / "job" / "a.####.exr"
    report = run_json("render", shot, "-o", out, *FLAGS, *CPU, "--tiles", "2x2", *how)
    assert [each["frame"] for each in report["pictures"]] == [1, 2, 3, 4]
    assert pictures(out.parent) == alone
    report = run_json("render", shot, "-o", out, *FLAGS, *CPU, "--resume", "-q", *how)
    assert report["pictures"] == [] and len(report["skipped"]) == 4


def test_a_capture_is_framed_as_by_one_process(run_json, capture, tmp_path):
    """Oracle: the picture of one process: the camera of the first task frames what that of all
    frames does."""
    words = ("render", capture, "--frames", "1-2", "--resolution", "32x32", *CPU)
    run_json(*words, "-o", tmp_path / "alone" / "a.#.exr".replace("#", "##"))
    run_json(*words, "-o", tmp_path / "job" / "a.##.exr", "--jobs", "1", "--chunk", "1")
    assert pictures(tmp_path / "job") == pictures(tmp_path / "alone")


def test_findings_and_errors_of_tasks_are_said_once(run, shot, tmp_path):
    """Oracle: the findings of one process, and the sentence of a folder that cannot be made."""
    stage = Usd.Stage.Open(str(shot))
    stage.DefinePrim("/Gone").GetReferences().AddReference("gone.usd")
    stage.Save()
    words = ("render", shot, *FLAGS, *CPU, "--jobs", "2", "--chunk", "1")
    alone = run("render", shot, *FLAGS, *CPU, "--json", "-o", tmp_path / "b.####.exr")
    status, out, _ = run(*words, "--json", "-o", tmp_path / "a.####.exr")
    assert status == alone[0] == 0
    assert json.loads(out)["findings"] == json.loads(alone[1])["findings"] != []
    (tmp_path / "file").write_text("")
    status, _, err = run(*words, "-o", tmp_path / "file" / "a.####.exr")
    assert status == 2 and "it is tried again" not in err
    assert err.endswith("file, expected a place where a folder can be made\n")


def test_strict_jobs_write_nothing(run, shot, tmp_path):
    """Oracle: status 1 and no file, as without a job."""
    stage = Usd.Stage.Open(str(shot))
    stage.DefinePrim("/Gone").GetReferences().AddReference("gone.usd")
    stage.Save()
    words = ("render", shot, "-o", tmp_path / "a.##.exr", "--frames", "1-2", *CPU, "--strict")
    assert run(*words, "--resolution", "8x8", "--jobs", "2")[0] == 1
    assert not list(tmp_path.glob("*.exr"))


def test_what_is_written_is_told_after_an_interruption(run, shot, tmp_path, monkeypatch):
    """Oracle: the names of the written files. A task that is interrupted has told of none."""

    def interrupted(self, job, **options):
        (tmp_path / "a.0001.exr").write_bytes(b"drawn")
        yield from ()
        raise interrupt.Interrupted(signal.SIGINT)

    monkeypatch.setattr(LocalWorkers, "run", interrupted)
    words = ("render", shot, "-o", tmp_path / "a.####.exr", *FLAGS, *CPU, "--jobs", "1")
    status, out, _ = run(*words)
    assert (status, out) == (130, f"{tmp_path / 'a.0001.exr'}\n")
    (tmp_path / "a.0001.exr").unlink()
    status, out, _ = run(*words, "--json")
    assert (status, out) == (130, "")


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        (("--jobs", "0"), "--jobs: found '0', expected 1 to "),
        (("--jobs", "2", "--chunk", "0"), "--chunk: found 0, expected 1 or more frames"),
        (("--chunk", "2"), "--chunk: found no --jobs, --dask or --openjd"),
        (("--dask", "nowhere"), "--dask: found 'nowhere', expected local, or tcp://HOST:PORT"),
        (("--jobs", "2", "--dask", "local"), "found --jobs and --dask, expected one of them"),
        (("--dask", "tcp://127.0.0.1:9"), "found no scheduler"),
    ],
    ids=lambda each: str(each)[:30],
)
def test_bad_options(run, shot, tmp_path, monkeypatch, flags, sentence):
    """Oracle: the sentences."""
    cluster = pytest.importorskip("usdsplat.jobs.dask_cluster")
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    status, _, err = run("render", shot, "-o", tmp_path / "a.####.exr", *FLAGS, *CPU, *flags)
    assert status == 2 and sentence in err
    assert not list(tmp_path.glob("a*"))


def test_only_the_machine_of_the_tasks_needs_a_gpu(run, shot, tmp_path, monkeypatch):
    """Oracle: by hand: a machine without a GPU writes a bundle for those with one; tasks that it
    must run itself are refused before the first one begins."""
    monkeypatch.setattr(support, "obstacle", lambda: ("no GPU", "one"))
    words = ("render", shot, "-o", "a.####.exr", *FLAGS, "--device", "cuda")
    status, _, err = run(*words, "--openjd", tmp_path / "bundle")
    assert status == 0, err
    (step,) = json.loads((tmp_path / "bundle" / "template.yaml").read_text())["steps"]
    assert "--device=cuda" in step["script"]["actions"]["onRun"]["args"]
    assert "amount.worker.gpu" in json.dumps(step["hostRequirements"])
    for how in (("--jobs", "1"), ("--dask", "local")):
        status, out, err = run(*words, *how)
        assert (status, out) == (2, "") and err.count("\n") == 1
        assert err.endswith("device cuda: found no GPU, expected one\n")


def command(*words):
    return [sys.executable, "-m", "usdsplat", *map(str, words)]


@pytest.mark.slow
def test_open_job_description_runs_the_bundle(run, shot, tmp_path, alone):
    """Oracle: `openjd check` and `openjd run`, from a folder to which the bundle was moved; the
    pixels are those of one process."""
    pytest.importorskip("openjd.cli")
    words = ("render", shot, "-o", "a.####.exr", *FLAGS, *CPU, "--tiles", "2x1", "--chunk", "3")
    status, out, err = run(*words, "--openjd", tmp_path / "bundle")
    assert status == 0, err
    assert out == f"{tmp_path / 'bundle' / 'template.yaml'}\n"
    moved = tmp_path / "moved to ümlaut"
    (tmp_path / "bundle").rename(moved)
    openjd = Path(sys.executable).with_name("openjd")
    extensions = ("--extensions", "TASK_CHUNKING")
    environment = {**os.environ, "PATH": f"{openjd.parent}{os.pathsep}{os.environ['PATH']}"}
    for verb in ("check", "run"):
        done = subprocess.run(
            [openjd, verb, moved / "template.yaml", *extensions],
            capture_output=True, env=environment, timeout=600, cwd=Path(__file__).parents[2],
        )  # fmt: skip
        assert done.returncode == 0, done.stdout.decode() + done.stderr.decode()
    assert b"openjd_progress: 100" in done.stdout
    drawn = pictures(moved / "out")
    assert {name: part[0][3] for name, part in drawn.items()} == {
        name: part[0][3] for name, part in alone.items()
    }


def test_bundles_of_texts_that_a_template_reads_otherwise_are_refused(run, shot, tmp_path):
    """Oracle: the sentence, and that no bundle is written."""
    words = ("render", shot, *FLAGS, *CPU, "--openjd", tmp_path / "bundle")
    for text in ("a={{Param.Stage}}", "b={{x", "c=}}"):
        status, _, err = run(*words, "-o", "a.####.exr", "--metadata", text)
        assert status == 2 and "expected a text without {{, }} and control characters" in err
    status, _, err = run(*words, "-o", "$F4/a.exr")
    assert status == 2 and "a frame in a folder's name" in err
    assert not (tmp_path / "bundle").exists()
