"""Interruption of the process by a signal, recorded so that it cannot be lost.

Python raises the exception of a signal handler wherever the main thread is. C++ code that called
Python, such as USD's and OpenImageIO's while they are imported, drops the exception and goes on.
Long work therefore looks at the record too: reports of progress, and whoever commits a finished
file.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""The signals that ask a process to end."""
WATCHER = "usdsplat parent"
"""Name of the thread that waits for the death of the parent process, which ends this one."""

_PAUSE = 0.01  # s

_IN_CPP = (
    "pxr", "OpenImageIO", "PyOpenColorIO", "PySide6", "shiboken6", "shibokensupport",
    "signature_bootstrap",
)  # fmt: skip
"""C++ packages that ignore an exception raised by a signal handler while they are imported."""

_received = 0
_advice = ""
_tell: Callable[[str], None] | None = None


class Interrupted(KeyboardInterrupt):
    """Signal that the process was asked to end. Unfinished files are removed.

    Args:
        number: Number of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def handle() -> None:
    """Make each of `SIGNALS` raise `Interrupted` in the main thread, unless it is ignored.

    `nohup` and the background jobs of a shell start a process with ignored signals.
    """
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _handler)


def receive(number: int) -> bool:
    """Record that the process received a signal. Return whether it is the first one.

    Later signals must not disturb the removal of unfinished files.
    """
    global _received
    is_first = not _received
    _received = _received or number
    return is_first


def received() -> int:
    """Return the number of the signal that the process received; 0 if there was none."""
    return _received


def forget() -> None:
    """Remove the record, and the advice."""
    global _received, _advice
    _received, _advice = 0, ""


def advise(text: str) -> None:
    """Set what to tell the user if the process is interrupted: how to go on.

    Args:
        text: Continues the sentence "interrupted; ", such as "go on with: usdsplat ..."; "" for
            nothing.
    """
    global _advice
    _advice = text
    if _tell is not None:
        _tell(text)


@contextmanager
def advising(text: str) -> Iterator[None]:
    """Advise this while the context lasts, and after it if it was interrupted."""
    advise(text)
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException:
        if not _received:  # else this error may be what came of a lost interruption
            advise("")
        raise
    advise("")


def pass_advice_to(receiver: Callable[[str], None]) -> None:
    """Call a function with each new advice: the parent process needs it when it kills this one."""
    global _tell
    _tell = receiver


def advice() -> str:
    """Return what `advise` set last."""
    return _advice


def check() -> None:
    """Raise an error if the process was asked to end.

    Raises:
        Interrupted: If it was.
    """
    if _received:
        raise Interrupted(_received)


def status(error: KeyboardInterrupt) -> int:
    """Return the exit status after an interruption: 128 + the signal's number, as in shells."""
    return 128 + (error.number if isinstance(error, Interrupted) else signal.SIGINT)


def sender(number: int) -> str:
    """Return " by SIGTERM" and the like for a message; nothing for Ctrl-C."""
    return "" if number == signal.SIGINT else f" by {signal.Signals(number).name}"


def _handler(number: int, frame: FrameType | None) -> None:
    if receive(number):
        _raise(frame)


def _again(number: int, frame: FrameType | None) -> None:
    _raise(frame)


def _raise(frame: FrameType | None) -> None:
    """Raise the interruption, or try again after `_PAUSE` while code of `_IN_CPP` runs.

    Such modules print and drop an exception that is raised while they are imported.

    Raises:
        Interrupted: If no such code runs.
    """
    if hasattr(signal, "setitimer") and _is_in_cpp(frame):
        signal.signal(signal.SIGALRM, _again)
        signal.setitimer(signal.ITIMER_REAL, _PAUSE)
        return
    raise Interrupted(_received)


def _is_in_cpp(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] in _IN_CPP:
            return True
        frame = frame.f_back
    return False
