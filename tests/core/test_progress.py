"""Tests of progress reports."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from usdsplat.core import interrupt
from usdsplat.core import progress as module
from usdsplat.core.progress import PATIENCE, Progress, Rates, phase, reporting, silent, steps


def test_silent_takes_every_step_and_prints_nothing(capsys) -> None:
    """Oracle: the captured output of the process."""
    listener: Progress = silent
    listener.step("reading", 0, 0)
    listener.step("reading", 5, 5)
    assert capsys.readouterr() == ("", "")


class Log:
    """A receiver that writes down what it is told."""

    def __init__(self) -> None:
        self.told: list[tuple[object, ...]] = []

    def step(self, label: str, done: int, total: int) -> None:
        self.told.append((label, done, total))


class TimedLog(Log):
    """One that also shows the time of work without steps."""

    def expect(self, label: str, seconds: float | None, spent: float = 0.0) -> None:
        self.told.append((label, None if seconds is None else round(seconds, 6)))


class Clock:
    """Seconds that pass only when a test says so."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 50.0
        monkeypatch.setattr(module.time, "monotonic", lambda: self.now)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def test_a_phase_reports_its_steps() -> None:
    """Oracle: written out by hand."""
    log = Log()
    with reporting(log), phase("even spacing", total=2) as sweep:
        sweep.step(1)
        sweep.step(2)
    assert log.told == [("even spacing", n, 2) for n in (0, 1, 2)]


def test_without_a_receiver_phases_are_silent() -> None:
    """Oracle: nothing happens; within and after `reporting` of another phase."""
    log = Log()
    with phase("a", total=1) as made:
        made.step(1)
    with reporting(log):
        pass
    assert list(steps("b", 3)) == [0, 1, 2] and log.told == []


def test_a_loop_counts_its_steps_and_may_be_left() -> None:
    """Oracle: written out by hand: the third step is begun, not finished; its time counts."""
    log = Log()
    with reporting(log) as spent:
        for number in steps("sweeps", 9):
            if number == 2:
                break
    assert log.told == [("sweeps", n, 9) for n in (0, 1, 2)]
    assert list(spent) == ["sweeps"]


def test_a_phase_in_a_phase_has_both_names(clock: Clock) -> None:
    """Oracle: written out by hand; the outer phase goes on after the inner one."""
    log = TimedLog()
    with reporting(log), phase("carriers", work=10):
        for _ in steps("even spacing", 1):
            pass
        with phase("neighbours"):
            pass
    inner = "carriers: even spacing"
    assert log.told == [
        ("carriers", None), (inner, 0, 1), (inner, 1, 1), ("carriers", None),
        ("carriers: neighbours", None), ("carriers", None),
    ]  # fmt: skip


def test_below_a_phase_with_steps_only_long_phases_are_reported(clock: Clock) -> None:
    """Oracle: written out by hand: the frames of a simulation are told, and the steps of a
    distance field after two seconds."""
    log = Log()
    with reporting(log), phase("simulating", total=2) as frames:
        for _ in steps("distance field", 3):
            clock.now += 0.7 * PATIENCE
        frames.step(1)
    assert log.told == [
        ("simulating", 0, 2), ("distance field", 2, 3), ("distance field", 3, 3),
        ("simulating", 1, 2),
    ]  # fmt: skip


def test_times_are_those_of_each_phase_alone(clock: Clock) -> None:
    """Oracle: by hand, in seconds; the compilation of kernels counts to none."""
    compiled = [0.0]
    with reporting(Log(), compiled=lambda: compiled[0]) as spent:
        with phase("outer"):
            clock.now += 1
            with phase("inner"):
                clock.now += 5
                compiled[0] += 3
            clock.now += 0.5
        with phase("outer"):
            clock.now += 1
    assert spent == {"outer: inner": 2.0, "outer": 2.5}


def test_work_that_was_done_before_has_an_expected_time(clock: Clock, tmp_path: Path) -> None:
    """Oracle: the rate of the first run: 1,000 splats in 4 s; another machine has none."""
    file = tmp_path / "cache" / "rates.json"
    for number, expected in enumerate((None, 8.0)):
        log = TimedLog()
        with reporting(log, rates=Rates(file, "cpu")), phase("lists", work=1000 * (number + 1)):
            clock.now += 4
        assert log.told == [("lists", expected)]
    kept = json.loads(file.read_text())
    assert list(kept) == ["cpu: lists"] and 250 < kept["cpu: lists"] < 500
    log = TimedLog()
    with reporting(log, rates=Rates(file, "cuda")), phase("lists", work=1000):
        clock.now += 0.01
    assert log.told == [("lists", None)]


def test_what_fails_or_is_short_is_no_rate(clock: Clock, tmp_path: Path) -> None:
    """Oracle: no file; a damaged one counts as empty."""
    file = tmp_path / "rates.json"
    with pytest.raises(OSError), reporting(Log(), rates=Rates(file)), phase("a", work=1):
        clock.now += 4
        raise OSError
    with reporting(Log(), rates=Rates(file)), phase("b", work=1):
        clock.now += 0.1
    assert not file.exists()
    file.write_text("[]")
    assert Rates(file).seconds("a", 1) is None


def test_a_phase_ends_at_an_interruption() -> None:
    """Oracle: the exception, where no receiver looks at the record."""
    interrupt.forget()
    interrupt.receive(2)
    try:
        with pytest.raises(interrupt.Interrupted), phase("a"):
            pass
        with pytest.raises(interrupt.Interrupted), reporting(TimedLog()), phase("a"):
            pass
    finally:
        interrupt.forget()
