"""Tests of the whole command line: help, errors, exit statuses and loaded modules."""

from __future__ import annotations

import errno
import importlib
import logging
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import usdsplat
from usdsplat.cli import main as main_module
from usdsplat.cli.arguments import flag_names
from usdsplat.cli.main import COMMANDS, main
from usdsplat.core import interrupt
from usdsplat.core.errors import EarlierFilesError, OutputError


def shell(*argv, **options):
    """Run `usdsplat` as a process of its own."""
    command = [sys.executable, "-m", "usdsplat", *map(str, argv)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


def loaded_after(argv):
    """Names of the modules that a fresh process has loaded once `argv` was run."""
    code = f"import sys; from usdsplat.cli.main import main; main({argv!r}); print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.rsplit("\n", 2)[-2].split())


@pytest.mark.parametrize("flag", ["--help", "-h", "help"])
def test_help_names_every_command_and_shows_examples(flag, capsys):
    """Oracle: the table of commands."""
    assert main([flag]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert all(f"\n  {name} " in out for name in COMMANDS)
    assert "usdsplat convert scan.ply scan.usdc" in out


@pytest.mark.parametrize("name", COMMANDS)
def test_each_commands_help_teaches_by_example(name, capsys):
    """Oracle: the lines below "examples:" call this very command, and nothing goes to stderr."""
    assert main([name, "--help"]) == 0
    out, err = capsys.readouterr()
    examples = out.partition("examples:\n")[2].splitlines()
    assert f"{examples[0]} ".startswith(f"  usdsplat {name} ")
    assert "None" not in out
    assert err == ""


def test_the_overview_loads_neither_numpy_nor_usd():
    """Oracle: the modules of a fresh process."""
    heavy = {"numpy", "pxr", "numba", "rich", "OpenImageIO"}
    assert not heavy & loaded_after(["--help"])


@pytest.mark.parametrize("name", COMMANDS)
def test_a_commands_help_loads_neither_usd_nor_numba_nor_images(name):
    """Oracle: the modules of a fresh process."""
    loaded = loaded_after([name, "--help"])
    assert not {"pxr", "numba", "OpenImageIO", "PIL", "colour", "rich", "scipy"} & loaded
    others = {f"usdsplat.cli.{other}" for other in COMMANDS if other != name}
    assert not others & loaded


def test_version_is_the_packages(capsys):
    """Oracle: usdsplat.__version__."""
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"usdsplat {usdsplat.__version__}\n"


def test_no_command_shows_the_overview_and_fails(capsys):
    """Oracle: status 2 and nothing on stdout, for scripts that forgot something."""
    assert main([]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("usage: usdsplat COMMAND")


def test_an_unknown_command_is_one_line(capsys):
    """Oracle: where: found X, expected Y."""
    assert main(["rendr"]) == 2
    expected = "usdsplat: command: found 'rendr', expected one of convert, lod, info"
    assert capsys.readouterr().err.startswith(expected)


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["render"], ["found no STAGE, expected one"]),
        (["render", "a.usd", "--resolutoin", "9"], ["found --resolutoin, expected --resolution;"]),
        (["render", "a.usd", "--imageWidth", "9"], ["--imageWidth, expected --resolution;"]),
        (["render", "a.usd", "--threads", "x"], ["found --threads 'x', expected a whole number"]),
        (
            ["render", "a.usd", "--half", "--float"],
            ["found --half and --float, expected one of them"],
        ),
    ],
)
def test_mistakes_in_arguments_are_one_sentence(argv, words, capsys):
    """Oracle: where: found X, expected Y in plain ASCII, the cure at the end, status 2."""
    assert main(argv) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.isascii()
    assert err.startswith("usdsplat: render: found ")
    assert len(err.splitlines()) == 1
    assert all(word in err for word in words)
    assert err.endswith("; see 'usdsplat render --help'\n")


def test_ctrl_c_is_one_line_and_130(monkeypatch, capsys):
    """Oracle: what shells return after an interrupt, 128 + SIGINT."""

    def interrupted(arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(main_module, "_run", interrupted)
    assert main(["render"]) == 130
    assert capsys.readouterr().err == "usdsplat: interrupted\n"


def test_ctrl_c_does_not_hide_where_earlier_files_are(monkeypatch, capsys):
    """Oracle: both sentences, and 128 + SIGTERM; another error that an interruption caused is not
    printed."""
    errors = [
        EarlierFilesError("a.usda", "an interruption; earlier files are in x", "space"),
        OutputError("a.usda", "a truncated file", "space"),
    ]

    def failed(arguments):
        interrupt.receive(signal.SIGTERM)
        raise errors.pop(0)

    monkeypatch.setattr(interrupt, "_received", 0)
    monkeypatch.setattr(main_module, "_run", failed)
    assert main(["render"]) == 143
    kept, said = capsys.readouterr().err.splitlines()
    assert "earlier files are in x" in kept and said.startswith("usdsplat: interrupted")
    assert main(["render"]) == 143
    assert capsys.readouterr().err == f"{said}\n"


def test_errors_of_the_system_are_one_line(monkeypatch, capsys):
    """Oracle: the system's own words, status 2."""

    def refused(arguments):
        raise PermissionError(13, "Permission denied", "a.usd")

    monkeypatch.setattr(main_module, "_run", refused)
    assert main(["render"]) == 2
    assert (
        capsys.readouterr().err
        == "usdsplat: a.usd: found permission denied, expected a place to read or write\n"
    )


def test_a_bug_is_one_sentence_and_a_report(monkeypatch, capsys, tmp_path):
    """Oracle: status 3; the report has the command line, versions and the traceback, mode 0600."""

    def broken(arguments):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(main_module, "_run", broken)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert main(["render", "a\udcff.usd"]) == 3
    out, err = capsys.readouterr()
    (report,) = tmp_path.iterdir()
    assert out == ""
    assert err == (
        "usdsplat: render: found an error that is not foreseen (ZeroDivisionError), expected "
        f"none; the report is in {report}\n"
    )
    text = report.read_text()
    assert "'render' 'a\\udcff.usd'" in text
    assert f"usdsplat {usdsplat.__version__}" in text
    assert "Traceback (most recent call last)" in text and "ZeroDivisionError: a bug" in text
    if os.name != "nt":
        assert report.stat().st_mode & 0o777 == 0o600


def test_a_bug_without_a_place_for_a_report_is_one_sentence(monkeypatch, capsys, tmp_path):
    """Oracle: a folder for temporary files that does not exist; status 3."""

    def broken(arguments):
        raise ZeroDivisionError

    monkeypatch.setattr(main_module, "_run", broken)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    assert main(["render"]) == 3
    assert capsys.readouterr().err.endswith("expected none; no report could be written\n")


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        RuntimeError("std::bad_alloc"),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        ImportError("a.so: failed to map segment from shared object"),
    ],
    ids=repr,
)
def test_too_little_memory_is_one_sentence(error, monkeypatch, capsys):
    """Oracle: what Python, C++, the system and the linker raise; status 2, and no report."""

    def greedy(arguments):
        raise error

    monkeypatch.setattr(main_module, "_run", greedy)
    assert main(["render"]) == 2
    expected = "usdsplat: render: found too little memory, expected more, or a smaller task\n"
    assert capsys.readouterr().err == expected


@pytest.mark.parametrize("argv", [["--help"], ["render", "--help"]])
def test_a_reader_that_has_seen_enough_is_no_error(argv):
    """Oracle: `usdsplat --help | true` in a shell leaves stderr empty; 141 is 128 + SIGPIPE."""
    command = [sys.executable, "-m", "usdsplat", *argv]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as process:
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait() == 141


def test_the_process_returns_the_status_and_a_clean_stderr():
    """Oracle: status and streams of a shelled-out run."""
    run = shell("render", "missing.usd", "-o", "a.png")
    assert run.returncode == 2
    assert run.stdout == ""
    assert run.stderr == "usdsplat: missing.usd: found no such file, expected a USD file\n"
    assert shell("--version").returncode == 0


def test_a_full_disk_behind_stdout_is_one_sentence():
    """Oracle: /dev/full, which refuses every byte; status 2 and no traceback at the end."""
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("the system has no device that is always full")
    command = [sys.executable, "-m", "usdsplat", "--help"]
    with full.open("w") as out:
        run = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, check=False)
    assert run.returncode == 2
    place = "standard output: found no space left on device"
    assert run.stderr == f"usdsplat: {place}, expected a place to read or write\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_flag_is_in_the_help_once(name, capsys):
    """Oracle: the fields of the command's options; the help begins a line with each of them."""
    command = importlib.import_module(f"usdsplat.cli.{name.replace('-', '_')}")
    main([name, "--help"])
    listed = re.findall(r"^  (?:-\w(?: \S+)?, )?--([\w-]+)", capsys.readouterr().out, re.MULTILINE)
    assert sorted(listed) == sorted({"help"} | flag_names(command.Options))


def test_the_library_logs_to_nobody_at_the_command_line(capsys):
    """Oracle: logging's own last resort, which would print; the commands speak for themselves."""
    main(["--version"])
    logging.getLogger("usdsplat.anything").warning("heard")
    assert capsys.readouterr().err == ""


FD_MODES = {"out": ">&-", "err": "2>&-", "all": "<&- >&- 2>&-"}


@pytest.mark.skipif(os.name == "nt", reason="a shell of Unix")
@pytest.mark.parametrize("closed", FD_MODES.values(), ids=FD_MODES)
@pytest.mark.parametrize("succeeds", [True, False], ids=["works", "fails"])
def test_closed_streams_change_neither_status_nor_results(closed, succeeds, shot, tmp_path):
    """Oracle: the status with open streams, and a picture that begins like an EXR."""
    source = shot if succeeds else "missing.usd"
    words = [sys.executable, "-m", "usdsplat", "render", source, "-o", tmp_path / "a.exr"]
    words += ["--resolution", "32x24", "--threads", "1"]
    line = " ".join(shlex.quote(str(word)) for word in words)
    log = "" if closed != FD_MODES["out"] else f" 2>{shlex.quote(str(tmp_path / 'log'))}"
    run = subprocess.run(f"{line} {closed}{log}", shell=True, check=False, timeout=120)
    assert run.returncode == (0 if succeeds else 2)
    if succeeds:
        assert (tmp_path / "a.exr").read_bytes()[:4] == bytes([0x76, 0x2F, 0x31, 0x01])
    if log:
        assert "Traceback" not in (tmp_path / "log").read_text()


def test_a_full_disk_behind_stderr_changes_no_status():
    """Oracle: /dev/full as stderr: a wrong command is status 2, help is 0."""
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("the system has no device that is always full")
    command = [sys.executable, "-m", "usdsplat"]
    with full.open("w") as err:
        for argv, status in ((["rendr"], 2), (["render"], 2), ([], 2), (["--help"], 0)):
            run = subprocess.run(
                [*command, *argv],
                capture_output=False,
                stderr=err,
                check=False,
                stdout=subprocess.DEVNULL,
            )
            assert run.returncode == status


@pytest.mark.parametrize("columns", range(1, 6))
@pytest.mark.parametrize("name", ["render", "simulate"])
def test_help_ends_on_the_narrowest_terminal(name, columns, monkeypatch, capsys):
    """Oracle: every flag is there, although the terminal is narrower than a word."""
    monkeypatch.setenv("COLUMNS", str(columns))
    assert main([name, "--help"]) == 0
    assert "--threads" in capsys.readouterr().out
    if name == "simulate":
        assert main([name, "--list-parameters"]) == 0
