"""Fuzz test of the command line: random flags, values and names, in this process."""

from __future__ import annotations

import importlib
import os
import random
from pathlib import Path

import pytest

from usdsplat.cli.arguments import Argument, arguments_of
from usdsplat.cli.main import COMMANDS, main

STATUSES = {0, 1, 2, 141}
"""Documented ones, without those of signals and of bugs."""
LEFT_OUT = {
    "view": "it waits for its window or its page to be closed",
    "compile": "it compiles for minutes",
    "demo": "it renders for minutes",
}
"""Command -> why it gets only arguments that cannot be right."""
NUMBERS = (
    "0",
    "-1",
    "1",
    "2",
    "1e9",
    "1e999",
    "-inf",
    "nan",
    "2147483648",
    "9" * 40,
    "0x10",
    "1.5",
)
WORDS = (
    "", " ", "-", "--", "=", "#", "####", "%04d", "%n", "a\nb", "a\tb", "\x1b[2J", "\u202e", "é",
    "\ud800", os.fsdecode(b"\xff\xfe"), "a" * 300, "/", "/A", "/A.b", "..", "~", "*", "{}",
    "1-3", "1:3", "1:10x2", "3-1", "-5--1", "1-999999999999", "1,2", "64x48", "0x0", "rdf", "xyz",
    "0,0,1,1", "color,Z", "all", "auto", "cpu", "/World/Ball", "/World/Cam", "season=autumn",
)  # fmt: skip
SUFFIXES = (".exr", ".png", ".ply", ".usda", ".usdz", ".spz", ".splat", ".abc", "", ".mp4")
KNOWN = ("shot.usda", "ball.ply", "missing.usda", "missing.ply")
SEVERAL = 25
"""Command lines of one test."""


def line(rng: random.Random, name: str) -> list[str]:
    """A random command line of a command."""
    command = importlib.import_module(f"usdsplat.cli.{name.replace('-', '_')}")
    known = list(arguments_of(command.Options))
    words = [rng.choice(KNOWN) if rng.random() < 0.8 else value(rng)]
    words += [target(rng)] if name == "convert" else []
    if name in ("render", "match", "normals", "simulate") and rng.random() < 0.9:
        words += ["-o", target(rng)]
    if name == "render":  # small and short, if nothing else is asked for
        words += ["--resolution", "16x12", "--threads", "1"]
    flags = [each for each in known if not each.shown.is_positional]
    for each in rng.choices(flags, k=rng.randint(0, 3)) if flags else ():  # a worker has none
        words += spelled(rng, each)
    if rng.random() < 0.2:
        words.insert(rng.randint(0, len(words)), value(rng))
    if name in LEFT_OUT:
        words.append("--no-such-flag")
    return [name, *words]


def spelled(rng: random.Random, argument: Argument) -> list[str]:
    """A flag, with a value if it takes one, or sometimes without."""
    if not argument.takes_value or rng.random() < 0.05:
        return [argument.flag]
    numeric = argument.kind in (int, float) and rng.random() < 0.8
    given = rng.choice(NUMBERS) if numeric else value(rng)
    return [f"{argument.flag}={given}"] if rng.random() < 0.7 else [argument.flag, given]


def value(rng: random.Random) -> str:
    """A number, a word or a name."""
    return rng.choice((rng.choice(NUMBERS), rng.choice(WORDS), target(rng)))


def target(rng: random.Random) -> str:
    """A name in the folder of results."""
    stem = "".join(rng.choices("ab\n\t \x7f#%é\udcff'\"\\", k=rng.randint(1, 4)))
    return f"out/{stem}{rng.choice(SUFFIXES)}"


def check(seed: int, folder: Path, capture: pytest.CaptureFixture[bytes]) -> None:
    """Run command lines, and check status, stderr and the folder after each."""
    rng = random.Random(seed)
    for _ in range(SEVERAL):
        words = line(rng, rng.choice(tuple(COMMANDS)))
        status = main(words)
        err = capture.readouterr().err.decode(errors="surrogateescape")
        assert status in STATUSES, (words, err)
        assert "Traceback" not in err, words
        if status == 2 and len(words) > 1:
            last = err.splitlines()[-1]
            assert last.startswith("usdsplat: "), (words, err)
            assert last.isprintable(), (words, err)
        hidden = [path.name for path in folder.rglob(".*")]
        assert hidden == [], words


@pytest.fixture
def folder(shot: Path, capture: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder: a shot, a capture and a folder for results."""
    monkeypatch.chdir(shot.parent)
    assert capture.parent == shot.parent
    (shot.parent / "out").mkdir()
    return shot.parent


@pytest.mark.timeout(300)
@pytest.mark.parametrize("seed", range(4))
def test_a_hundred_command_lines_end_with_a_documented_status(seed, folder, capsysbinary, compiled):
    """Oracle: the table of exit statuses; a sentence on stderr; no hidden file."""
    check(seed, folder, capsysbinary)


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("seed", range(4, 80))
def test_further_command_lines_end_with_a_documented_status(seed, folder, capsysbinary, compiled):
    """Oracle: as above."""
    check(seed, folder, capsysbinary)
