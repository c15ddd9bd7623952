"""Tests of what the soak of a window calls growth."""

from __future__ import annotations

from benchmarks.leaks import WARM, Minute, growth


def minute(megabytes: float, *, threads: int = 9, files: int = 9) -> Minute:
    """A minute of a window."""
    return Minute(megabytes=megabytes, threads=threads, files=files, opened=1, pictures=1)


def test_only_what_grows_after_the_first_minutes_is_told() -> None:
    """Oracle: written down by hand: a start that grows and memory that varies are fine, a leak of
    two percent a minute, and of a thread and two files, is not."""
    start = [minute(100.0 * number) for number in range(WARM)]
    flat = [minute(1000.0 + number % 3) for number in range(7)]
    assert growth(start + flat) == []
    leaks = [
        minute(1000.0 + 20 * number, threads=9 + number, files=9 + 2 * number)
        for number in range(7)
    ]
    assert [each.split(":")[0] for each in growth(start + leaks)] == [
        "megabytes", "threads", "files",
    ]  # fmt: skip
    assert growth(start + flat[:1]) == ["found 4 minutes, expected at least 5"]
