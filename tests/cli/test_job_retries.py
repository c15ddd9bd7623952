"""Tests of tasks that fail in the middle, and succeed when they are tried again."""

from __future__ import annotations

import json
import os
import sys

import pytest

from tests.cli.test_job_failures import FLAGS, LONG, alone, begun, ended, pictures

__all__ = ["alone"]

pytestmark = [
    pytest.mark.usefixtures("compiled"),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="forks workers"),
]
BREAKING = """
import os, signal
from pathlib import Path
from usdsplat.cli import worker
from usdsplat.core.errors import OutputError

def breaking(words, keeper, carried_out=worker.carried_out):
    from usdsplat.products import drawing

    def write(engine, file, whole=drawing.write_picture, **how):
        mark = Path({marks!r}, file.path.name)
        if file.path.name == "a.0002.exr" and not mark.exists():
            mark.touch()
            if {dies!r}:
                whole(engine, file, **how)
                os.kill(os.getpid(), signal.SIGKILL)
            raise OutputError(str(file.path), "a disk that is gone", "one that is there")
        return whole(engine, file, **how)

    if drawing.write_picture.__name__ != "write":
        drawing.write_picture = write
    return carried_out(words, keeper)

worker.carried_out = breaking
"""


@pytest.fixture
def breaking(tmp_path):
    """The environment of a client whose workers fail once, at the second picture."""
    return broken(tmp_path, dies=False)


@pytest.fixture
def dying(tmp_path):
    """The environment of a client one of whose workers is killed after the second picture."""
    return broken(tmp_path, dies=True)


def broken(tmp_path, *, dies):
    folder, marks = tmp_path / "breaking", tmp_path / "marks"
    folder.mkdir()
    marks.mkdir()
    (folder / "sitecustomize.py").write_text(BREAKING.format(marks=str(marks), dies=dies))
    path = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path)}


def reason(out):
    name = out.parent / "a.0002.exr"
    return f"{name}: found a disk that is gone, expected one that is there"


@pytest.mark.parametrize(
    ("how", "form"),
    [(("--jobs", "1"), "names"), (("--jobs", "1"), "json"), (("--dask", "local"), "json")],
    ids=str,
)
def test_pictures_of_a_process_that_died_are_reported(shot, tmp_path, alone, dying, how, form):
    """Oracle: the names of all pictures, each once, and the keys of the other reports. The process
    died after two pictures, which the next one skips."""
    if "--dask" in how:
        pytest.importorskip("distributed")
    out = tmp_path / "job" / "a.####.exr"
    words = ("render", shot, "-o", out, *FLAGS, "--chunk", "3", "--resume", *how)
    more = ("--json", "-q") if form == "json" else ()
    with begun(*words, *more, env=dying) as client:
        told, err = client.communicate(timeout=LONG)
    assert client.returncode == 0, err
    assert pictures(out.parent) == alone
    names = [str(out.parent / name) for name in alone]
    if form == "names":
        assert sorted(told.splitlines()) == names
        return
    report = json.loads(told)
    assert [each["path"] for each in report["pictures"]] == names and report["skipped"] == []
    assert [each["frame"] for each in report["pictures"]] == [1, 2, 3, 4]
    assert [each["splats"] is None for each in report["pictures"]] == [True, True, False, False]
    first, *_, last = report["pictures"]
    assert first.keys() == last.keys()
    for name in ("product", "camera", "aovs", "device", "resolution"):
        assert first[name] == last[name]


@pytest.mark.parametrize("how", [("--jobs", "1"), ("--dask", "local")], ids=" ".join)
def test_a_task_that_fails_in_the_middle_is_tried_again(shot, tmp_path, alone, breaking, how):
    """Oracle: the pictures of one process, and the sentence on the first try; Dask tries again
    silently."""
    if "--dask" in how:
        pytest.importorskip("distributed")
    out = tmp_path / "job" / "a.####.exr"
    with begun("render", shot, "-o", out, *FLAGS, "--chunk", "2", *how, env=breaking) as client:
        status, told = ended(client)
    said = [f"usdsplat: draw, frames 1-2: {reason(out)}; it is tried again"]
    assert (status, told) == (0, said if how[0] == "--jobs" else [])
    assert (tmp_path / "marks" / "a.0002.exr").exists()
    assert pictures(out.parent) == alone


@pytest.mark.parametrize("how", [("--jobs", "1"), ("--dask", "local")], ids=" ".join)
def test_without_retries_it_is_the_only_one_that_is_missing(shot, tmp_path, alone, breaking, how):
    """Oracle: the pictures of one process but for the second one, and the sentences. --resume draws
    it."""
    if "--dask" in how:
        pytest.importorskip("distributed")
    out = tmp_path / "job" / "a.####.exr"
    words = ("render", shot, "-o", out, *FLAGS, "--chunk", "2", "--retries", "0", *how)
    with begun(*words, env=breaking) as client:
        names, told = client.communicate(timeout=LONG)
    status, told = client.returncode, [line for line in told.splitlines() if ", task " not in line]
    assert status == 2 and len(told) == 2
    assert told[0].startswith("usdsplat: draw, frames 1-2 on ") and told[0].endswith(reason(out))
    assert "found 1 of 2 tasks that failed, expected none" in told[1]
    assert told[1].endswith(" --resume")
    missing = {name: each for name, each in alone.items() if name != "a.0002.exr"}
    assert pictures(out.parent) == missing
    assert sorted(names.splitlines()) == [str(out.parent / name) for name in missing]
    with begun(*words, "--resume", env=breaking) as client:
        assert ended(client) == (0, [])
    assert pictures(out.parent) == alone
