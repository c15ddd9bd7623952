"""Tests of progress reports."""

from __future__ import annotations

from usdsplat.core.progress import Progress, silent


def test_silent_takes_every_step_and_prints_nothing(capsys) -> None:
    """Oracle: the captured output of the process."""
    listener: Progress = silent
    listener.step("reading", 0, 0)
    listener.step("reading", 5, 5)
    assert capsys.readouterr() == ("", "")
