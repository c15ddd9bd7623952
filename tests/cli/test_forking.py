"""Tests of workers that are forked from the command: when they are, and when they must not be."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import ball
from tests.cli.test_job_failures import (
    FLAGS,
    LONG,
    alone,
    begun,
    ended,
    gate,
    pictures,
    until,
    waits,
)
from tests.cli.test_simulate_jobs import FRAMES, pushed
from tests.jobs.test_local import children
from usdsplat import formats

__all__ = ["alone", "gate", "pushed"]

pytestmark = [
    pytest.mark.usefixtures("compiled"),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc"),
]

BEGIN = """
import sys, threading
from usdsplat.cli import forking
"""


def printed(code, **environment):
    """What a program prints."""
    done = subprocess.run(
        [sys.executable, "-c", BEGIN + code],
        capture_output=True, text=True, timeout=60, cwd=Path(__file__).parents[2],
        env={**os.environ, **environment},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_workers_are_forked_while_no_library_has_threads():
    """Oracle: the only thread of the process in /proc. Later, USD has the threads of all cores, and
    a second context forks nothing: USD is loaded."""
    found = printed(
        """
with forking.held():
    print(forking.prepared(forking.DRAWING), forking._threads())
from pxr import Work
print(Work.GetConcurrencyLimit())
with forking.held():
    print(forking.prepared(forking.DRAWING))
""",
        OPENBLAS_NUM_THREADS="1",
    )
    usual = printed("from pxr import Work; print(Work.GetConcurrencyLimit())")
    assert found == ["True", "1", *usual, "False"]


def test_a_thread_that_was_started_in_the_meantime_forbids_it():
    """Oracle: by hand."""
    code = """
end = threading.Event()
with forking.held():
    threading.Thread(target=end.wait).start()
    print(forking.prepared(forking.DRAWING))
end.set()
"""
    assert printed(code) == ["False"]


def test_a_thread_of_a_program_that_calls_ours_forbids_it():
    """Oracle: by hand."""
    code = """
end = threading.Event()
threading.Thread(target=end.wait).start()
with forking.held():
    print(forking.prepared(forking.DRAWING))
end.set()
"""
    assert printed(code) == ["False"]


def test_a_package_that_cannot_be_imported_forbids_it():
    """Oracle: by hand; whoever uses the package says what is wrong."""
    code = 'with forking.held(): print(forking.prepared(["usdsplat.nothing"]))'
    assert printed(code) == ["False"]


def test_usd_that_may_have_threads_forbids_it():
    """Oracle: by hand: PXR_WORK_THREAD_LIMIT comes before what a program asks for."""
    code = "with forking.held(): print(forking.prepared(forking.DRAWING))"
    assert printed(code, PXR_WORK_THREAD_LIMIT="2")[-1] == "False"


def test_workers_with_gpus_are_not_forked():
    """Oracle: NVIDIA's documentation of CUDA: a process must not use it after a fork. Without the
    GPU, the same workers are."""
    code = """
from usdsplat.cli.job_options import JobOptions, JobRunner
with forking.held():
    for environment in ({"CUDA_VISIBLE_DEVICES": "0"}, {}):
        print(JobRunner(JobOptions(), None, [environment])._can_fork(()))
"""
    assert printed(code) == ["False", "True"]


@pytest.mark.parametrize("command", ["render", "simulate"])
def test_a_command_forks_its_workers(pushed, tmp_path, gate, command):
    """Oracle: a process that is forked keeps the command line; one that is started has its own. The
    files are whole, and no process is left."""
    out = tmp_path / "job"
    words = {
        "render": ("render", pushed, "-o", out / "a.####.exr", *FLAGS),
        "simulate": (
            *("simulate", pushed, "-o", out / "b.usda", *FRAMES, "--chunk", "2"),
            *("--wedge", "settle:omega=4,8"),
        ),
    }[command]
    with begun(*words, "--jobs", "2", env=waits(gate)) as client:
        until(lambda: len(children(client.pid)) == 1 + 2 * 2)  # each has a process that watches it
        below = children(client.pid)
        lines = {Path(f"/proc/{pid}/cmdline").read_bytes() for pid in below}
        assert lines == {Path(f"/proc/{client.pid}/cmdline").read_bytes()}
        gate.touch()
        assert ended(client) == (0, [])
    assert len(list(out.glob("*.exr" if command == "render" else "b_*.usda"))) == {
        "render": 4, "simulate": 2,
    }[command]  # fmt: skip
    assert not any(Path(f"/proc/{pid}").exists() for pid in below)


@pytest.mark.parametrize("how", [("--jobs", "2"), ("--dask", "local")], ids=" ".join)
@pytest.mark.parametrize("command", ["render", "convert", "lod", "simulate"])
def test_files_that_a_command_inherits_do_not_matter(pushed, tmp_path, command, how):
    """Oracle: the same command alone; a pipe that a caller left open has no reader and no byte
    more."""
    if "--dask" in how:
        pytest.importorskip("distributed")
    capture = tmp_path / "ball.ply"
    formats.write(ball(300, 3), capture)
    words = {
        "simulate": ("simulate", pushed, "-o", "{}/b.usda", *FRAMES),
        "render": ("render", pushed, "-o", "{}/a.####.exr", *FLAGS),
        "convert": ("convert", pushed, "{}/a.####.ply", "--frames", "1-3", "--prim", "/World/Ball"),
        "lod": ("lod", capture, "-o", "{}/a.usda"),
    }[command]
    read, write = os.pipe()
    for folder, more in (("alone", ()), ("job", how)):
        (tmp_path / folder).mkdir()
        line = [str(word).format(tmp_path / folder) for word in words]
        with begun(*line, *more, pass_fds=(write,)) as client:
            assert ended(client)[0] == 0
    os.close(write)
    assert select.select([read], [], [], LONG)[0]
    assert os.read(read, 100) == b""
    os.close(read)
    found = [
        sorted(each.name for each in (tmp_path / name).rglob("*")) for name in ("alone", "job")
    ]
    assert found[0] == found[1] != []


def test_a_worker_of_dask_that_dies_is_replaced(shot, tmp_path, alone, gate):
    """Oracle: the pictures of one process, although the only worker is killed after the first
    one."""
    pytest.importorskip("distributed")
    out = tmp_path / "job" / "a.####.exr"
    words = ("render", shot, "-o", out, *FLAGS, "--dask", "local", "--chunk", "1")
    with begun(*words, env={**waits(gate), "USDSPLAT_THREADS": "1"}) as client:
        assert client.stdout.readline() == f"{out.parent / 'a.0001.exr'}\n"
        (worker,) = (pid for pid in children(client.pid) if not children(pid))
        gate.touch()
        os.kill(worker, signal.SIGKILL)
        assert ended(client) == (0, [])
    assert pictures(out.parent) == alone
