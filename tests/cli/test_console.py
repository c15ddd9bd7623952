"""Tests of progress and remarks."""

from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest

from usdsplat.cli import console
from usdsplat.cli import progress as progress_lines


class Clock:
    """Seconds that pass only when a test says so."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(progress_lines.time, "monotonic", lambda: self.now)


class Terminal(io.StringIO):
    """A stderr that says it is a terminal."""

    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


def run(progress, clock, seconds, label="reading", total=10):
    """Ten steps, so many seconds each."""
    for done in range(total + 1):
        progress.step(label, done, total)
        clock.now += seconds


def test_short_work_is_not_mentioned(clock, capsys):
    """Oracle: the promise, nothing below about a second; 0.9 s pass here."""
    with progress_lines.listening() as progress:
        run(progress, clock, 0.09)
    assert capsys.readouterr() == ("", "")


def test_long_work_is_plain_lines_a_step_each(clock, capsys):
    """Oracle: written out by hand: two seconds a step, so that the time left is known."""
    with progress_lines.listening() as progress:
        run(progress, clock, 2.0, total=4)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "usdsplat: reading 1/4 (25 %, 0:06 left)",
        "usdsplat: reading 2/4 (50 %, 0:04 left)",
        "usdsplat: reading 3/4 (75 %, 0:02 left)",
        "usdsplat: reading 4/4 (100 %)",
    ]


def test_many_small_steps_make_few_lines(clock, capsys):
    """Oracle: 3 s of work at one line per second, and the end."""
    with progress_lines.listening() as progress:
        run(progress, clock, 0.01, total=300)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert lines[-1] == "usdsplat: reading 300/300 (100 %)"


def test_each_label_is_timed_by_itself(clock, capsys):
    """Oracle: two pieces of work of 0.9 s each are both short."""
    with progress_lines.listening() as progress:
        run(progress, clock, 0.09, label="reading")
        run(progress, clock, 0.09, label="writing")
    assert capsys.readouterr().err == ""


def test_work_of_unknown_size_says_how_much_is_done(clock, capsys):
    """Oracle: written out by hand; there is no share and no time left."""
    with progress_lines.listening() as progress:
        progress.step("compiling", 0, 0)
        clock.now += 2
        progress.step("compiling", 0, 0)
        clock.now += 2
        progress.step("compiling", 7, 0)
    assert capsys.readouterr().err.splitlines() == ["usdsplat: compiling", "usdsplat: compiling 7"]


def test_a_terminal_gets_a_bar_that_goes_away(clock, monkeypatch):
    """Oracle: rich shows label and share, and erases its lines in the end (ANSI CSI 2 K)."""
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with progress_lines.listening() as progress:
        run(progress, clock, 2.0)
        run(progress, clock, 2.0, label="writing")
    text = terminal.getvalue()
    assert "reading" in text
    assert "writing" in text
    assert text.rstrip("\n").endswith("\x1b[2K")


def test_a_terminal_gets_no_bar_for_short_work(clock, monkeypatch):
    """Oracle: the promise, nothing below about a second."""
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with progress_lines.listening() as progress:
        run(progress, clock, 0.05)
    assert terminal.getvalue() == ""


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0:00"), (59.6, "1:00"), (754, "12:34"), (3723, "1:02:03")]
)
def test_durations_are_read_aloud(seconds, text):
    """Oracle: written out by hand."""
    assert progress_lines.duration(seconds) == text


def test_work_without_steps_says_how_long_it_takes(clock, capsys):
    """Oracle: written out by hand: unknown at first, then with 20 s expected, then too long."""
    progress = progress_lines.Lines()
    progress.expect("carriers", None)
    for seconds in (0.5, 0.6, 1.0):
        clock.now += seconds
        progress.beat()
    progress.expect("lists", 20.0)
    for seconds in (5.0, 5.0, 20.0):
        clock.now += seconds
        progress.beat()
    progress.step("reading", 0, 5)
    clock.now += 5
    progress.beat()
    assert capsys.readouterr().err.splitlines() == [
        "usdsplat: carriers 0:01 so far",
        "usdsplat: carriers 0:02 so far",
        "usdsplat: lists 0:05 (25 %, about 0:15 left)",
        "usdsplat: lists 0:10 (50 %, about 0:10 left)",
        "usdsplat: lists 0:30 so far, 0:20 was expected",
    ]


def test_a_task_that_goes_on_keeps_its_rate(clock, capsys):
    """Oracle: three seconds a frame, with other work that is reported in each of them."""
    progress = progress_lines.Lines()
    progress.step("frames", 0, 4)
    for done in (1, 2, 3):
        clock.now += 2
        progress.step("lists", 0, 1)
        clock.now += 1
        progress.step("frames", done, 4)
    lines = [line for line in capsys.readouterr().err.splitlines() if "frames" in line]
    assert lines == [
        "usdsplat: frames 1/4 (25 %, 0:09 left)",
        "usdsplat: frames 2/4 (50 %, 0:06 left)",
        "usdsplat: frames 3/4 (75 %, 0:03 left)",
    ]


def test_the_time_left_is_of_the_steps_that_were_seen(clock, capsys):
    """Oracle: two seconds a step, where the first ones were there already."""
    progress = progress_lines.Lines()
    progress.step("frames", 90, 100)
    clock.now += 4
    progress.step("frames", 92, 100)
    assert capsys.readouterr().err == "usdsplat: frames 92/100 (92 %, 0:16 left)\n"


def test_compilation_is_no_work(clock, capsys):
    """Oracle: 1 s of work and 9 s of compilation."""
    compiled = [0.0]
    progress = progress_lines.Lines(lambda: compiled[0])
    progress.step("frames", 0, 4)
    clock.now, compiled[0] = clock.now + 10, 9.0
    progress.step("frames", 1, 4)
    assert capsys.readouterr().err == "usdsplat: frames 1/4 (25 %, 0:03 left)\n"


def test_results_and_remarks_take_different_roads(capsys):
    """Oracle: stdout is for results, stderr for the rest; JSON has no word for infinity."""
    console.print_json({"a": [1, math.nan], "b": (math.inf,)})
    console.remark("b")
    out, err = capsys.readouterr()
    assert json.loads(out) == {"a": [1, None], "b": [None]}
    assert err == "usdsplat: b\n"


def test_compilation_is_announced_once(capsys):
    """Oracle: a dozen kernels are compiled, one line is said."""
    announce = console.announce_compilation()
    for kernel in ("project", "blend"):
        announce(kernel)
    assert capsys.readouterr().err.splitlines() == [
        "usdsplat: compiling kernels, once for each kind of picture; it takes up to half a minute"
    ]


@pytest.mark.parametrize("seconds", [0.1, 0.7, 3.0])
def test_the_longer_work_takes_the_fewer_lines_it_gets(clock, capsys, seconds):
    """Oracle: the promise: a line a second for 10 s, every 10 s for a minute, then every minute."""
    heard = []
    progress = progress_lines.Lines()
    steps = round(600 / seconds)
    for done in range(steps + 1):
        progress.step("rendering", done, steps)
        if capsys.readouterr().err:
            heard.append(clock.now - 100)
        clock.now += seconds
    gaps = np.diff([0, *heard])
    ends = np.array(heard)
    slack = 1e-6
    assert heard[-1] == pytest.approx(steps * seconds)
    assert (gaps[:-1] >= 1 - slack).all()
    assert (gaps[:-1][ends[:-1] > 10 + slack] >= 10 - slack).all()
    assert (gaps[:-1][ends[:-1] > 60 + slack] >= 60 - slack).all()
    assert (gaps <= 60 + seconds + slack).all()
    assert len(heard) <= 10 + 5 + 9 + 1
