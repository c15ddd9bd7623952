"""Tests of `usdsplat compile`."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from usdsplat.cli.main import main
from usdsplat.kernels import ahead, signatures, store

PATIENCE = 60.0
"""[s] For a machine with much else to do."""


@pytest.fixture(autouse=True)
def few(monkeypatch, tmp_path):
    """Two kernels, of which none takes long, and a folder for them."""
    table = [line for line in signatures.table("cpu") if line[0] in ("surface.clear", "total.add")]
    monkeypatch.setattr(signatures, "table", lambda device: list(table) if device == "cpu" else [])
    monkeypatch.setattr(store, "_chosen", None)
    monkeypatch.setattr(store, "_refusal", "")
    monkeypatch.setenv(store.VARIABLE, str(tmp_path / "elsewhere"))


def test_kernels_are_compiled_and_it_says_where_they_are(tmp_path, capsys) -> None:
    """Oracle: what is there afterwards, and the note that all is; a second time nothing changes."""
    folder = tmp_path / "kernels"
    arguments = ["compile", "--device", "cpu", "--cache-dir", str(folder), "--jobs", "2"]
    assert main(arguments) == 0
    assert capsys.readouterr().out == f"{folder}: 2 kernels\n"
    assert ahead.is_noted("cpu", None)
    entries = {
        path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.stat().st_size > 5000
    }
    assert len(entries) == 2
    assert main([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"folder": str(folder), "kernels": 2}
    assert {path: path.stat().st_mtime_ns for path in entries} == entries
    assert not (tmp_path / "elsewhere").exists()


def test_a_kernel_that_does_not_compile_is_named(tmp_path, capsys, monkeypatch) -> None:
    """Oracle: the sentence of its error; nothing is noted."""
    wrong = [("total.add", "f4:3C bool"), ("surface.clear", "f4:1C")]
    monkeypatch.setattr(signatures, "table", lambda device: wrong if device == "cpu" else [])
    assert main(["compile", "--device", "cpu", "--cache-dir", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "total.add for cpu: " in said and "Error" in said
    assert "compile: found 2 kernels of 2 that failed, expected none" in said
    assert not ahead.is_noted("cpu", None)


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's")
def test_an_interrupted_one_ends_at_once(tmp_path) -> None:
    """Oracle: what Ctrl-C in a terminal does: the signal goes to all processes; status 130, one
    sentence, and no process is left in the group."""
    program = (
        "import signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a terminal leaves it so
        "from usdsplat.cli.main import main\n"
        "sys.exit(main())\n"
    )
    arguments = ["compile", "--device", "cpu", "--cache-dir", str(tmp_path), "--jobs", "2"]
    process = subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        while not any(path.stat().st_size > 5000 for path in tmp_path.rglob("*")):
            assert process.poll() is None
            time.sleep(0.1)
        os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE)
        assert process.returncode == 130
        assert said.splitlines()[-1] == "usdsplat: interrupted" and "Traceback" not in said
        deadline = time.monotonic() + PATIENCE
        while is_there(process.pid):
            assert time.monotonic() < deadline, "processes are left"
            time.sleep(0.1)
    finally:
        if is_there(process.pid):
            os.killpg(process.pid, signal.SIGKILL)


def is_there(group: int) -> bool:
    """Whether a process of a group is."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--device", "abacus"], "--device: found 'abacus', expected auto, cpu or cuda"),
        (["--jobs", "0"], "--jobs: found 0, expected 1 or more"),
        (["--device", "cpu", "--capability", "9.0"], "--capability: found --device cpu, expected"),
        (["--capability", "abc"], "--capability: found 'abc', expected numbers such as 8.9 or"),
        (["--cache-dir", ""], "--cache-dir: found '', expected a folder"),
        (
            ["--cache-dir", "{file}"],
            "--cache-dir: found {file}: not a directory, expected a folder that can be written",
        ),
    ],
)
def test_mistakes_are_one_sentence(tmp_path, capsys, arguments, said) -> None:
    """Oracle: the wording of errors."""
    (tmp_path / "file").write_text("")
    file = str(tmp_path / "file")
    assert main(["compile", *(each.format(file=file) for each in arguments)]) == 2
    error = capsys.readouterr().err
    assert said.format(file=file) in error and error.count("\n") == 1
