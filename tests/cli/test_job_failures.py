"""Tests of jobs whose processes are killed, whose disk is full or whose folder goes away.

Oracle of all: pictures of one process. What exists is whole, the job ends, and says what is
missing.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager, suppress
from itertools import islice
from pathlib import Path

import pytest

from tests.jobs.test_local import children
from tests.products.test_tiles import content
from usdsplat import __version__

pytestmark = [
    pytest.mark.usefixtures("compiled"),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc"),
]
FLAGS = ("--frames", "1-4", "--resolution", "64x40", "--aovs", "color,Z", "--device", "cpu")
LONG = 120.0
"""Time after which something hangs [s]."""


@pytest.fixture
def alone(run_json, shot, tmp_path):
    """The pictures of one process, by name."""
    run_json("render", shot, "-o", tmp_path / "alone" / "a.####.exr", *FLAGS)
    return pictures(tmp_path / "alone")


def pictures(folder):
    return {each.name: content(each) for each in sorted(folder.glob("*.exr"))}


def command(*words):
    return [sys.executable, "-m", "usdsplat", *map(str, words)]


@contextmanager
def begun(*words, **options):
    """A command in processes of its own, whose stdout and stderr are pipes."""
    process = subprocess.Popen(
        command(*words), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


def ended(process):
    """Status and stderr of a command that ends in time, without lines of progress."""
    _, err = process.communicate(timeout=LONG)
    return process.returncode, [line for line in err.splitlines() if ", task " not in line]


def check_rest(words, out, alone):
    """Check that what exists is whole, and that --resume makes the rest."""
    found = pictures(out.parent)
    assert found.items() <= alone.items()
    again = subprocess.run(command(*words, "--resume"), capture_output=True, timeout=2 * LONG)
    assert again.returncode == 0, again.stderr
    assert pictures(out.parent) == alone
    assert sorted(each.name for each in out.parent.iterdir()) == sorted(alone)


WAITING = """
import time
from pathlib import Path
from usdsplat.cli import worker
from usdsplat.core import interrupt

def waiting(words, keeper, carried_out=worker.carried_out, begun=[]):
    begun.append(words)
    while len(begun) > 1 and not Path({gate!r}).exists():
        interrupt.check()
        time.sleep(0.02)
    return carried_out(words, keeper)

if worker.carried_out.__name__ != "waiting":  # Dask loads a module twice
    worker.carried_out = waiting
"""


@pytest.fixture
def gate(tmp_path):
    """A missing file, for which all tasks but the first of each worker wait: of workers that load
    `waits/waiting.py` beside it, as those of a client with the environment `waits(gate)` do, and of
    those that it forks."""
    folder = tmp_path / "waits"
    folder.mkdir()
    (folder / "waiting.py").write_text(WAITING.format(gate=str(tmp_path / "gate")))
    (folder / "sitecustomize.py").write_text("import waiting\n")
    return tmp_path / "gate"


def waits(gate):
    path = [str(gate.with_name("waits")), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path)}


def until(is_so):
    """Wait until something is so."""
    deadline = time.monotonic() + LONG
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.05)


# --- processes of this machine -------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_whatever_is_killed_each_picture_is_whole_or_absent(shot, tmp_path, alone, seed):
    """Oracle: as above. Workers, and with every second seed the client, are killed at random
    moments."""
    rng = random.Random(seed)
    out = tmp_path / "job" / "a.####.exr"
    words = ("render", shot, "-o", out, *FLAGS, "--tiles", "2x1", "--jobs", "2")
    with begun(*words, "--retries", "5") as client:
        for _ in range(3):
            time.sleep(rng.uniform(0.2, 2.0))
            below = children(client.pid)
            if below and client.poll() is None:
                with suppress(ProcessLookupError):
                    os.kill(rng.choice(below), signal.SIGKILL)
        if seed % 2:
            client.kill()
        ended(client)
    check_rest(words, out, alone)


def test_ctrl_c_says_how_to_go_on(shot, tmp_path, alone, gate):
    """Oracle: as above; status 130 and one sentence with the command."""
    out = tmp_path / "job" / "a.####.exr"
    words = ("render", shot, "-o", out, *FLAGS, "--jobs", "1", "--chunk", "1")
    with begun(*words, preexec_fn=listening, env=waits(gate)) as client:
        assert client.stdout.readline() == f"{out.parent / 'a.0001.exr'}\n"
        client.send_signal(signal.SIGINT)
        status, told = ended(client)
    assert status == 130 and len(told) == 1
    assert told[0].startswith(f"usdsplat: interrupted; go on with: usdsplat render {shot}")
    assert told[0].endswith(" --resume")
    assert pictures(out.parent) == {"a.0001.exr": alone["a.0001.exr"]}


def listening():
    """Have a shell's signals: what runs in the background ignores Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def limited():
    """Let no file be larger than 3000 bytes."""
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))


@contextmanager
def mounted(folder, *options):
    """A file system of a few pages, if this process may mount one."""
    folder.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", ",".join(("size=40k", *options)), "tmpfs", folder],
        capture_output=True,
    )  # fmt: skip
    if made.returncode:
        pytest.skip(f"mount: {made.stderr.decode().strip()}")
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


@pytest.mark.skipif(shutil.which("mount") is None, reason="no mount")
@pytest.mark.parametrize("how", ["limit", pytest.param("disk", marks=pytest.mark.slow)])
def test_a_full_disk_leaves_whole_pictures_and_a_sentence_for_each_other(
    shot, tmp_path, alone, how
):
    """Oracle: as above; each task that fails says so in one sentence, and the last one says how to
    go on."""
    out = tmp_path / "job" / "a.####.exr"
    sizes = [(tmp_path / "alone" / name).stat().st_size for name in alone]
    assert min(sizes) > 10_000 and sum(sizes) > 40 << 10
    words = ("render", shot, "-o", out, *FLAGS, "--jobs", "1", "--chunk", "1", "--retries", "0")
    with ExitStack() as stack:
        if how == "disk":
            stack.enter_context(mounted(out.parent))
        process = stack.enter_context(begun(*words, preexec_fn=limited if how == "limit" else None))
        status, told = ended(process)
        found = pictures(out.parent) if out.parent.exists() else {}
        assert found.items() <= alone.items() and len(found) < 4
        assert status == 2 and len(told) == 4 - len(found) + 1
        assert all("a.000" in line and "expected" in line for line in told[:-1])
        assert told[-1].endswith(" --resume")
        left = list(out.parent.rglob("*")) if out.parent.exists() else []
        assert sorted(each.name for each in left) == sorted(found)


@pytest.mark.skipif(shutil.which("mount") is None, reason="no mount")
def test_a_read_only_folder_is_refused_before_the_first_task(run, shot, tmp_path):
    """Oracle: one sentence, status 2."""
    with mounted(tmp_path / "job", "ro"):
        words = ("render", shot, "-o", tmp_path / "job" / "a.####.exr", *FLAGS, "--jobs", "1")
        status, out, err = run(*words)
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert "found a folder without write permission, expected a writable folder" in err


@pytest.mark.slow
def test_a_folder_that_is_taken_away_is_a_sentence_of_each_task(shot, tmp_path, alone, gate):
    """Oracle: as above. The folder is replaced by a file after the first picture."""
    out = tmp_path / "job" / "a.####.exr"
    words = ("render", shot, "-o", out, *FLAGS, "--jobs", "1", "--chunk", "1", "--retries", "0")
    with begun(*words, env=waits(gate)) as process:
        assert process.stdout.readline() == f"{out.parent / 'a.0001.exr'}\n"
        out.parent.rename(tmp_path / "away")
        out.parent.touch()
        gate.touch()
        status, told = ended(process)
    assert status == 2 and len(told) == 3 + 1
    assert all(str(out.parent) in line for line in told[:-1])
    assert pictures(tmp_path / "away") == {"a.0001.exr": alone["a.0001.exr"]}
    assert out.parent.read_bytes() == b""


# --- a cluster -----------------------------------------------------------------------------


class Cluster:
    """A scheduler of Dask and its workers, whose folders are their own."""

    def __init__(self, folder, stack):
        pytest.importorskip("distributed")
        self._folder, self._stack = folder, stack
        self.workers = []
        file = folder / "scheduler.json"
        words = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-jupyter")
        self.scheduler = self._started("scheduler", *words, "--scheduler-file", file)
        self._file = file

    def start(self, *words, **environment):
        """Start a worker that is not restarted."""
        home = self._folder / f"worker {len(self.workers)}"
        home.mkdir()
        flags = ("--nthreads", "1", "--memory-limit", "0", "--no-nanny", "--no-dashboard")
        place = ("--scheduler-file", self._file, "--local-directory", home)
        self.workers.append(
            self._started("worker", *flags, *place, *words, cwd=home, environment=environment)
        )

    def address(self):
        """The scheduler's address, once it has all workers."""
        import json

        from distributed import Client

        until(self._file.exists)
        address = json.loads(self._file.read_text())["address"]
        with Client(address) as client:
            client.wait_for_workers(len(self.workers), timeout=LONG)
        return address

    def _started(self, kind, *words, cwd=None, environment=()):
        process = subprocess.Popen(
            [Path(sys.executable).with_name("dask"), kind, *map(str, words)],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=cwd,
            env={**os.environ, **dict(environment)},
        )  # fmt: skip
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process


@pytest.fixture
def cluster(tmp_path):
    """A cluster without workers."""
    with ExitStack() as stack:
        (tmp_path / "cluster").mkdir()
        yield Cluster(tmp_path / "cluster", stack)


def test_two_workers_that_share_a_folder_draw_what_one_process_draws(
    cluster, shot, tmp_path, alone
):
    """Oracle: as above. One of the workers is killed after the first picture, and the other one
    draws the rest."""
    for _ in range(2):
        cluster.start()
    out = tmp_path / "job" / "a.####.exr"
    how = ("--dask", cluster.address(), "--chunk", "1", "--retries", "0", "--tiles", "2x1")
    with begun("render", shot, "-o", out, *FLAGS, *how) as client:
        assert client.stdout.readline().startswith(str(out.parent))
        cluster.workers[0].kill()
        assert ended(client) == (0, [])
    assert pictures(out.parent) == alone
    left = {path.name for path in out.parent.iterdir()}
    assert {name for name in left if not name.startswith(".")} == set(alone)  # it may have written


def test_a_scheduler_that_is_killed_ends_the_command(cluster, shot, tmp_path, alone, gate):
    """Oracle: as above: one sentence, status 2."""
    cluster.start("--preload", gate.with_name("waits") / "waiting.py")
    out = tmp_path / "job" / "a.####.exr"
    address = cluster.address()
    words = ("render", shot, "-o", out, *FLAGS, "--chunk", "1")
    with begun(*words, "--dask", address) as client:
        assert client.stdout.readline().startswith(str(out.parent))
        cluster.scheduler.kill()
        status, told = ended(client)
    expected = f"--dask {address}: found a scheduler that ended, expected one that runs"
    assert (status, told) == (2, [f"usdsplat: {expected}; --resume goes on"])
    found = pictures(out.parent)
    assert len(found) == 1 and found.items() <= alone.items()


def test_workers_that_cannot_do_a_task_are_named_before_it_is_sent(cluster, run, shot, tmp_path):
    """Oracle: the sentences: a need that no worker declares enough for, then a worker that does not
    find the package."""
    cluster.start("--resources", "MEMORY=1e9")
    address = cluster.address()
    words = ("render", shot, "-o", tmp_path / "job" / "a.####.exr", *FLAGS, "--dask", address)
    status, _, err = run(*words, "--memory-limit", "2G")
    assert status == 2 and err.endswith(
        "found no worker that meets the needs of a task, expected one with --resources"
        " 'MEMORY=2147483648'\n"
    )
    status, _, err = run(*words, "--resources", "licence=0.5")
    assert status == 2 and err.endswith("expected one with --resources 'licence=0.5'\n")
    preload = tmp_path / "hide.py"
    preload.write_text("import sys\nsys.modules['usdsplat'] = None\n")
    cluster.start("--preload", preload)
    cluster.address()
    status, out, err = run(*words)
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert "found a worker without usdsplat, tcp://127.0.0.1:" in err
    assert "expected pip install 'usdsplat[farm]' on each" in err
    assert not (tmp_path / "job").exists()


def test_a_cluster_that_all_workers_left_is_given_up(cluster, run, shot, tmp_path, monkeypatch):
    """Oracle: the sentence; the only worker ends itself at its first task."""
    dask_cluster = pytest.importorskip("usdsplat.jobs.dask_cluster")
    monkeypatch.setattr(dask_cluster, "ROUND", 0.2)
    monkeypatch.setattr(dask_cluster, "DESERTED", 0.5)
    preload = tmp_path / "fragile.py"
    preload.write_text(
        "import os, usdsplat.cli.worker as worker\n"
        "worker.carried_out = lambda *words: os._exit(1)\n"
    )
    cluster.start("--preload", preload)
    address = cluster.address()
    words = ("render", shot, "-o", tmp_path / "job" / "a.####.exr", *FLAGS, "--dask", address)
    status, _, err = run(*words)
    assert status == 2 and err.endswith(
        f"--dask {address}: found a cluster whose workers all ended, expected a worker;"
        " --resume goes on\n"
    )


def test_a_resource_that_is_gone_with_its_worker_ends_the_command(
    cluster, run, shot, tmp_path, monkeypatch
):
    """Oracle: the sentence; the only worker with a licence ends itself at its first task, another
    one without it stays."""
    dask_cluster = pytest.importorskip("usdsplat.jobs.dask_cluster")
    monkeypatch.setattr(dask_cluster, "ROUND", 0.2)
    monkeypatch.setattr(dask_cluster, "DESERTED", 0.5)
    preload = tmp_path / "fragile.py"
    preload.write_text(
        "import os, usdsplat.cli.worker as worker\n"
        "worker.carried_out = lambda *words: os._exit(1)\n"
    )
    cluster.start("--preload", preload, "--resources", "licence=1")
    cluster.start()
    address = cluster.address()
    words = ("render", shot, "-o", tmp_path / "job" / "a.####.exr", *FLAGS, "--dask", address)
    status, _, err = run(*words, "--resources", "licence=1")
    assert status == 2 and err.endswith(
        f"--dask {address}: found no worker that meets the needs of a task,"
        " expected one with --resources 'licence=1'; --resume goes on\n"
    )


def test_workers_that_join_without_our_version_do_no_task(cluster, shot, tmp_path, alone, gate):
    """Oracle: as above: the good worker draws all pictures, and a sentence names each other one."""
    cluster.start("--preload", gate.with_name("waits") / "waiting.py")
    preloads = {"older": "import usdsplat.jobs.dask_cluster as a\na.__version__ = '0.1'\n"}
    preloads["none"] = "import sys\nsys.modules['usdsplat'] = None\n"
    out = tmp_path / "job" / "a.####.exr"
    how = ("--chunk", "1", "--retries", "0", "--dask", cluster.address())
    with begun("render", shot, "-o", out, *FLAGS, *how) as client:
        assert client.stdout.readline().startswith(str(out.parent))
        for name, text in preloads.items():
            (tmp_path / f"{name}.py").write_text(text)
            cluster.start("--preload", tmp_path / f"{name}.py")
        told = list(islice((line for line in client.stderr if "it gets no task" in line), 2))
        gate.touch()
        assert ended(client) == (0, [])
    assert f"expected usdsplat {__version__}; it gets no task" in "".join(told)
    assert "found a worker without usdsplat, tcp://127.0.0.1:" in "".join(told)
    assert pictures(out.parent) == alone


@pytest.mark.slow
def test_tasks_of_a_client_that_is_killed_are_cancelled(cluster, shot, tmp_path, alone, gate):
    """Oracle: no picture is begun after that which was being drawn; --resume makes the rest."""
    from distributed import Client

    cluster.start("--preload", gate.with_name("waits") / "waiting.py")
    out = tmp_path / "job" / "a.####.exr"
    address = cluster.address()
    words = ("render", shot, "-o", out, *FLAGS, "--chunk", "1", "--dask", address)
    with begun(*words, env={**os.environ, "USDSPLAT_SUPERVISE": "0"}) as client:
        assert client.stdout.readline().startswith(str(out.parent))
        client.kill()
    with Client(address) as other:
        until(lambda: not other.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)))
        gate.touch()
        assert other.submit(abs, -1).result(timeout=LONG) == 1  # after what is being drawn
    assert len(pictures(out.parent)) <= 2
    check_rest(words, out, alone)
