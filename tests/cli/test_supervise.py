"""Tests of the parent process. Oracle of all: exit status, stderr, and the files that are left."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

if not hasattr(os, "fork"):
    pytest.skip("commands have a parent process only where there is fork", allow_module_level=True)

TOO_LONG = 30.0
"""Time after which something hangs [s]; the promise is 2 s, on a machine that is not busy."""
SCRIPT = """
import os, sys, time
import usdsplat.cli.main as command
from usdsplat.core.output import output_file
from usdsplat.core.progress import silent

def work(arguments):
    with output_file(arguments[1]) as output:
        output.path.write_bytes(b"half")
        print("ready", flush=True)
{work}
    return 0

command._run = work
from usdsplat.cli.supervise import entry
raise SystemExit(entry())
"""
ADVICE = """
from usdsplat.core import interrupt
interrupt.advise("go on with: usdsplat render --resume")
print("advised", flush=True)
"""
ENDLESS = "sum(range(10**15))"  # C code that looks at no signal and keeps the GIL


@contextmanager
def working(
    tmp_path: Path, work: str, more: tuple[str, ...] = (), **options
) -> Iterator[subprocess.Popen[str]]:
    """A supervised process that does `work` while a temporary file exists."""
    indented = "\n".join("        " + line for line in work.splitlines())
    environment = {**os.environ, "TMPDIR": str(tmp_path / "tmp"), **options.pop("env", {})}
    (tmp_path / "tmp").mkdir()
    (tmp_path / "out").mkdir()
    words = ["render", tmp_path / "out" / "a.exr", *more]
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT.format(work=indented), *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        **{"preexec_fn": listening, **options},
    )
    with process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


def listening() -> None:
    """Have a shell's signals: what runs in the background ignores Ctrl-C."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def end(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit status and stderr of a process that ends in time."""
    _, err = process.communicate(timeout=TOO_LONG)
    return process.returncode, err


def listed(tmp_path: Path) -> list[str]:
    """What is in the folder of the results and in that of temporary files."""
    return sorted(os.listdir(tmp_path / "out")) + sorted(os.listdir(tmp_path / "tmp"))


NAMES = {
    signal.SIGINT: "interrupted",
    signal.SIGTERM: "interrupted by SIGTERM",
    signal.SIGHUP: "interrupted by SIGHUP",
}


@pytest.mark.parametrize("number", NAMES)
@pytest.mark.parametrize("work", ["time.sleep(1000)", ENDLESS], ids=["python", "c"])
def test_a_signal_ends_python_code_and_c_code(tmp_path, work, number):
    """Oracle: 128 + the signal's number; one sentence; the temporary file is gone."""
    with working(tmp_path, work) as process:
        process.send_signal(number)
        assert end(process) == (128 + number, f"usdsplat: {NAMES[number]}\n")
    assert listed(tmp_path) == []


@pytest.mark.parametrize("work", ["time.sleep(1000)", ENDLESS], ids=["python", "c"])
def test_whoever_ends_the_command_says_how_to_go_on(tmp_path, work):
    """Oracle: the advice of the command, in one sentence; C code is killed by the parent."""
    with working(tmp_path, f"{ADVICE.strip()}\n{work}") as process:
        assert process.stdout.readline() == "advised\n"
        process.send_signal(signal.SIGINT)
        advice = "usdsplat: interrupted; go on with: usdsplat render --resume\n"
        assert end(process) == (130, advice)


@pytest.mark.parametrize(
    "then",
    [
        "silent.step('drawing', 1, 2); time.sleep(1000)",
        "pass",
        "raise TypeError('no converter')",
        "from usdsplat.core.errors import BackendError\n"
        "raise BackendError('window', 'no symbol', 'the libraries that Qt needs')",
    ],
    ids=["progress", "commit", "consequence", "explained consequence"],
)
def test_a_swallowed_interrupt_stops_at_the_next_row_and_commits_nothing(tmp_path, then):
    """Oracle: what C++ callbacks do, an exception handler that drops everything; no result."""
    work = f"try:\n    time.sleep(1000)\nexcept BaseException:\n    pass\n{then}"
    with working(tmp_path, work) as process:
        process.send_signal(signal.SIGINT)
        assert end(process) == (130, "usdsplat: interrupted\n")
    assert listed(tmp_path) == []


def test_a_terminals_ctrl_c_reaches_both_and_is_said_once(tmp_path):
    """Oracle: a signal to the whole process group, as a terminal sends it."""
    with working(tmp_path, "time.sleep(1000)", start_new_session=True) as process:
        os.killpg(process.pid, signal.SIGINT)
        assert end(process) == (130, "usdsplat: interrupted\n")
    assert listed(tmp_path) == []


def test_a_caller_that_blocks_sigchld_is_no_obstacle(tmp_path):
    """Oracle: the command ends; a blocked SIGCHLD once left the parent waiting for ever."""

    def blocking() -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})

    with working(tmp_path, "pass", preexec_fn=blocking) as process:
        assert end(process) == (0, "")
    assert listed(tmp_path) == ["a.exr"]


def test_the_word_help_among_arguments_is_no_request_for_help(tmp_path):
    """Oracle: the parent of the process that works is not this one."""
    work = "print(os.getppid(), flush=True)"
    with working(tmp_path, work, more=("help", "--help")) as process:
        assert process.stdout is not None
        assert process.stdout.readline() != f"{os.getpid()}\n"
        assert end(process) == (0, "")


def test_an_ignored_signal_stays_ignored(tmp_path):
    """Oracle: `nohup`, which starts a command with SIGHUP ignored; the work goes on to its end."""

    def nohup() -> None:
        listening()
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    wait = "while not os.path.exists(arguments[1] + '.go'):\n    time.sleep(0.01)"
    with working(tmp_path, wait, preexec_fn=nohup) as process:
        process.send_signal(signal.SIGHUP)
        (tmp_path / "out" / "a.exr.go").touch()
        assert end(process) == (0, "")
    assert (tmp_path / "out" / "a.exr").read_bytes() == b"half"


CRASH = "import ctypes; ctypes.string_at(0)"


REAL_TIME = "os.kill(os.getpid(), 40)"


@pytest.mark.skipif(sys.platform != "linux", reason="real-time signals of Linux")
def test_an_end_by_a_signal_without_a_name_is_one_sentence(tmp_path):
    """Oracle: a real-time signal, which Python has no name for; status 3."""
    with working(tmp_path, REAL_TIME) as process:
        status, err = end(process)
    assert (status, len(err.splitlines())) == (3, 1)
    assert err.startswith("usdsplat: render: found a crash by signal 40, expected none; the report")


@pytest.mark.parametrize(("work", "name"), [(CRASH, "SIGSEGV"), ("os.abort()", "SIGABRT")])
def test_a_crash_is_one_sentence_and_a_report_with_the_stack(tmp_path, work, name):
    """Oracle: status 3, the report that the sentence names, which only the user can read."""
    with working(tmp_path, work) as process:
        status, err = end(process)
    report = Path(err.rstrip("\n").rpartition("the report is in ")[2])
    assert (status, len(err.splitlines())) == (3, 1)
    assert err.startswith(f"usdsplat: render: found a crash by {name}, expected none; the report")
    assert listed(tmp_path) == [report.name]
    assert report.stat().st_mode & 0o777 == 0o600
    text = report.read_text()
    assert "'render'" in text and "Fatal Python error" in text and 'File "<string>"' in text


def test_a_child_that_the_system_kills_is_one_sentence(tmp_path):
    """Oracle: SIGKILL, as Linux sends it to a process when memory runs out; status 2."""
    with working(tmp_path, "os.kill(os.getpid(), 9)") as process:
        status, err = end(process)
    assert (status, len(err.splitlines())) == (2, 1)
    assert err.startswith("usdsplat: render: found an end by SIGKILL")
    assert listed(tmp_path) == []


WAIT = "print('at work', flush=True)\ntime.sleep(1000)"
DEAF = """
while True:
    try:
        print("at work", flush=True)
        time.sleep(1000)
    except BaseException:
        pass
"""


@pytest.mark.parametrize(
    ("work", "said"),
    [(WAIT, "usdsplat: interrupted by SIGTERM\n"), (DEAF, "")],
    ids=["unwinds", "deaf"],
)
def test_a_child_without_its_parent_ends_too(tmp_path, work, said):
    """Oracle: the pipe of stderr, which is open as long as any process of the two lives."""
    with working(tmp_path, work) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "at work\n"
        process.kill()
        assert end(process)[1] == said
    assert listed(tmp_path) == []


def test_a_debuggers_process_is_the_only_one(tmp_path):
    """Oracle: the parent of the process that works is this one."""
    work = "print(os.getppid(), flush=True)"
    with working(tmp_path, work, env={"USDSPLAT_SUPERVISE": "0"}) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == f"{os.getpid()}\n"
        assert end(process) == (0, "")


def test_an_error_in_a_thread_is_a_failure(tmp_path):
    """Oracle: status 3, one sentence and a report, although the main thread succeeds."""
    work = "import threading\nt = threading.Thread(target=lambda: 1 / 0)\nt.start(); t.join()"
    with working(tmp_path, work) as process:
        status, err = end(process)
    assert (status, len(err.splitlines())) == (3, 1)
    assert "found an error that is not foreseen (ZeroDivisionError)" in err
    result, report = listed(tmp_path)
    assert result == "a.exr"
    assert "ZeroDivisionError: division by zero" in (tmp_path / "tmp" / report).read_text()


def test_an_error_that_nothing_can_catch_is_one_sentence(tmp_path):
    """Oracle: `__del__`, whose exception Python would print; the work is whole, so status 0."""
    work = "class A:\n    def __del__(self):\n        1 / 0\nA()"
    with working(tmp_path, work) as process:
        status, err = end(process)
    assert (status, len(err.splitlines())) == (0, 1)
    assert "(ZeroDivisionError)" in err


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux enforces this limit")
@pytest.mark.parametrize("megabytes", [500, 1000])
def test_little_address_space_is_one_sentence(tmp_path, shot, megabytes):
    """Oracle: `ulimit -v`: libraries crash or raise, whichever comes first; status 2."""
    import resource

    def limit() -> None:
        size = megabytes << 20
        resource.setrlimit(resource.RLIMIT_AS, (size, size))

    command = [sys.executable, "-m", "usdsplat", "render", shot, "-o", tmp_path / "a.exr"]
    run = subprocess.run(
        [*command, "--resolution", "32x24", "--threads", "1"],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limit,
        timeout=TOO_LONG * 4,
    )
    if run.returncode:
        expected = "usdsplat: render: found too little memory, expected more, or a smaller task\n"
        assert (run.returncode, run.stderr) == (2, expected)
        assert not (tmp_path / "a.exr").exists()
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".")]


# --- commands ------------------------------------------------------------------------------

COMMANDS: dict[str, Callable[[Path, Path], list[object]]] = {
    "render": lambda shot, out: [
        *("render", shot, "-o", out / "a.####.exr", "--frames", "1-4", "--samples", "64"),
        *("--resolution", "320x240", "--threads", "1"),
    ],
    "convert": lambda shot, out: ["convert", shot, out / "a.usdz"],
    "simulate": lambda shot, out: [
        *("simulate", shot.with_name("sim.usda"), "-o", out / "a.usda", "--frames", "1:40"),
    ],
    "view": lambda shot, out: ["view", shot, "--web", "--no-open"],
    "window": lambda shot, out: ["view", shot],
}
MOMENTS = (0.0, 0.4, 2.5)
"""Times after the command began [s]."""
OTHERS = (0.05, 0.1, 0.2, 0.3, 0.6, 0.75, 0.9, 1.2, 1.8)


def begun(process: subprocess.Popen[str]) -> None:
    """Wait until the command runs in its child process."""
    if not Path(f"/proc/{process.pid}/task/{process.pid}/children").exists():
        time.sleep(1)
        return
    while process.poll() is None and not children_of(process.pid):
        time.sleep(0.002)


def children_of(pid: int) -> list[int]:
    """Processes that a process has started."""
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def interrupted(name: str, number: int, moment: float, shot: Path, out: Path) -> None:
    """Interrupt a command at a moment, and check what is left."""
    out.mkdir()
    (out.parent / "tmp").mkdir(exist_ok=True)
    process = subprocess.Popen(
        [sys.executable, "-m", "usdsplat", *map(str, COMMANDS[name](shot, out))],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(out.parent / "tmp")},
        preexec_fn=listening,
    )
    with process:
        try:
            begun(process)
            time.sleep(moment)
            process.send_signal(number)
            status, err = end(process)
        finally:
            process.kill()
    if status:  # else it was finished before the signal
        assert status == 128 + number
    assert "Traceback" not in err
    of_qt = "propagateSizeHints"  # its platform without a display says so of each window
    told = [line for line in err.splitlines() if of_qt not in line]
    assert [line for line in told if not line.startswith("usdsplat: ")] == []
    hidden = [path.name for path in out.rglob(".*")] + os.listdir(out.parent / "tmp")
    assert hidden == []
    named = out / "a.usdz"
    assert not (status and named.exists())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_ends_at_any_moment_without_litter(name, moment, number, shot, simulated):
    """Oracle: 130 or 143, no traceback, and no file that is not a result."""
    interrupted(name, number, moment, shot, simulated.parent / "out")


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
def test_compilers_end_with_a_command_that_is_killed(tmp_path):
    """Oracle: the pipe of stderr, which is open as long as one of the processes lives; compiling
    everything into an empty folder takes minutes."""
    command = [sys.executable, "-m", "usdsplat", "compile", "--device", "cpu", "--jobs", "2"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "USDSPLAT_CACHE_DIR": str(tmp_path)},
    )
    with process:
        try:
            begun(process)
            (child,) = children_of(process.pid)
            deadline = time.monotonic() + TOO_LONG
            while len(children_of(child)) < 3:  # two compilers, and Python's resource tracker
                assert time.monotonic() < deadline
                time.sleep(0.01)
            os.kill(child, signal.SIGKILL)
            assert end(process)[0] == 2
        finally:
            process.kill()


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("moment", OTHERS)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_ends_at_further_moments(name, moment, number, shot, simulated):
    """Oracle: as above."""
    interrupted(name, number, moment, shot, simulated.parent / "out")


@pytest.fixture
def simulated(shot: Path, capture: Path, run) -> Path:
    """A stage to simulate, beside the shot."""
    status, _, err = run("simulate", "--preset", "grow", capture, "-o", shot.with_name("sim.usda"))
    assert status == 0, err
    return shot
