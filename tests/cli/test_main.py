"""Tests of the whole command line: help, errors, exit statuses and loaded modules."""

from __future__ import annotations

import importlib
import logging
import re
import subprocess
import sys
from pathlib import Path

import pytest

import usdsplat
from usdsplat.cli import main as main_module
from usdsplat.cli.arguments import flag_names
from usdsplat.cli.main import COMMANDS, main


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
    expected = "usdsplat: command: found 'rendr', expected one of convert, info, validate"
    assert capsys.readouterr().err.startswith(expected)


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["render"], ["found no STAGE, expected one"]),
        (["render", "a.usd", "--resolutoin", "9"], ["found --resolutoin, expected --resolution;"]),
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


def test_bugs_keep_their_traceback(monkeypatch):
    """Oracle: what is no mistake of the user's is not hidden from who must mend it."""

    def broken(arguments):
        raise ZeroDivisionError

    monkeypatch.setattr(main_module, "_run", broken)
    with pytest.raises(ZeroDivisionError):
        main(["render"])


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
