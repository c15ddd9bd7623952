"""Tests of the record of signals."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from usdsplat.core import interrupt
from usdsplat.core.output import output_file
from usdsplat.core.progress import silent


@pytest.fixture(autouse=True)
def _restored() -> Iterator[None]:
    """Default handlers and no record; afterwards the handlers of this process, as they were."""
    before = {number: signal.getsignal(number) for number in interrupt.SIGNALS}
    interrupt.forget()
    for number in interrupt.SIGNALS:
        signal.signal(number, signal.SIG_DFL)  # the background jobs of a shell ignore SIGINT
    yield
    interrupt.forget()
    for number, handler in before.items():
        signal.signal(number, handler)


def test_a_lost_exception_is_raised_again_by_progress_and_by_a_commit(tmp_path: Path) -> None:
    """Oracle: the record is set, the exception dropped; no file appears."""
    assert interrupt.receive(signal.SIGTERM)
    with pytest.raises(interrupt.Interrupted):
        silent.step("drawing", 1, 2)
    with pytest.raises(interrupt.Interrupted) as caught, output_file(tmp_path / "a") as output:
        output.path.write_bytes(b"whole")
    assert os.listdir(tmp_path) == []
    assert interrupt.status(caught.value) == 128 + signal.SIGTERM


def test_without_a_signal_nothing_is_raised() -> None:
    """Oracle: the record is empty."""
    interrupt.check()
    silent.step("drawing", 1, 2)
    assert interrupt.received() == 0


@pytest.mark.skipif(os.name == "nt", reason="signals of Unix")
def test_only_the_first_signal_raises() -> None:
    """Oracle: signals of this process; the second would disturb the removal of files."""
    interrupt.handle()
    with pytest.raises(interrupt.Interrupted) as caught:
        os.kill(os.getpid(), signal.SIGTERM)
    os.kill(os.getpid(), signal.SIGINT)
    assert caught.value.number == interrupt.received() == signal.SIGTERM


@pytest.mark.skipif(os.name == "nt", reason="signals of Unix")
def test_a_signal_waits_until_usds_own_code_has_ended() -> None:
    """Oracle: a function whose module is named like USD's, where USD would drop the exception.

    The alarm may come before the loop is reached, so that waiting for one more signal could take
    for ever.
    """
    interrupt.handle()
    code = "def work():\n    os.kill(os.getpid(), number)\n    ran.append(1)\n"
    space: dict = {"__name__": "pxr.Sdf", "os": os, "number": signal.SIGINT, "ran": []}
    exec(code, space)
    with pytest.raises(interrupt.Interrupted):
        space["work"]()
        for _ in range(3000):
            time.sleep(0.01)
    assert space["ran"] == [1]


def test_an_ignored_signal_stays_ignored() -> None:
    """Oracle: the handler after `handle`."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    interrupt.handle()
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_IGN


def test_the_status_is_that_of_a_shell() -> None:
    """Oracle: 128 + 2, 15 and 1; Ctrl-C in a program without our handlers counts as SIGINT."""
    assert interrupt.status(KeyboardInterrupt()) == 130
    numbers = (2, 15, 1)
    found = [interrupt.status(interrupt.Interrupted(number)) for number in numbers]
    assert found == [130, 143, 129]


@pytest.mark.parametrize(
    ("error", "left"),
    [(None, ""), (ValueError, ""), (KeyboardInterrupt, "go on"), (interrupt.Interrupted, "go on")],
    ids=str,
)
def test_advice_lasts_as_long_as_what_it_is_about(
    error: type[BaseException] | None, left: str
) -> None:
    """Oracle: by hand: only an interruption leaves the advice, for the sentence at the end."""
    try:
        with interrupt.advising("go on"):
            assert interrupt.advice() == "go on"
            if error is not None:
                raise error(2)
    except (ValueError, KeyboardInterrupt):
        pass
    assert interrupt.advice() == left
