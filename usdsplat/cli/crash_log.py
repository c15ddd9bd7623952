"""Keep what the interpreter and C++ libraries say when a command crashes, and explain the crash."""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress

TIGHT = 4 << 30
"""Address space below which a crash is ascribed to a lack of memory [byte]."""


class CrashLog:
    """File without a name that parent and child share, made before the fork."""

    def __init__(self) -> None:
        self._fd = _nameless()

    def listen(self) -> None:
        """Write the stacks of all threads to the log if this process crashes.

        If the address space is small, libraries abort with messages of their own where memory
        runs out. They are then written to the log too: Python keeps the terminal, file descriptor 2
        is the log.
        """
        if self._fd < 0:
            return
        with suppress(OSError, ValueError, RuntimeError):
            faulthandler.enable(self._fd)
        if _is_tight():
            terminal = os.dup(2)
            os.dup2(self._fd, 2)
            encoding = sys.stderr.encoding
            sys.stderr = os.fdopen(terminal, "w", 1, encoding=encoding, errors="backslashreplace")

    def repeat(self, *, is_success: bool) -> None:
        """Print the messages of libraries after a success; an error has its own sentence."""
        if is_success and (text := self._text()):
            from usdsplat.cli import console

            console.tell(text.rstrip("\n"))

    def explain(self, number: int, arguments: Sequence[str]) -> int:
        """Explain the end of the child by a signal that nobody sent through this process.

        Args:
            number: The signal.
            arguments: The command line after the program's name.

        Returns:
            The exit status.
        """
        from usdsplat.cli import console, failures
        from usdsplat.core import interrupt

        if number in interrupt.SIGNALS:
            return failures.interrupted(interrupt.Interrupted(number))
        name, text = _name(number), self._text()
        if _is_tight() or failures.text_lacks_memory(text):
            console.complain(f"{failures.command(arguments)}: {failures.MEMORY}")
            return failures.FOUND
        if number == signal.SIGKILL:
            found = "an end by SIGKILL, which the system sends when memory runs out"
            console.complain(
                f"{failures.command(arguments)}: found {found}, expected more memory, or a "
                "smaller task"
            )
            return failures.FOUND
        return failures.unforeseen(arguments, f"a crash by {name}", text)

    def _text(self) -> str:
        """Return what was written to the log."""
        if self._fd < 0:
            return ""
        os.lseek(self._fd, 0, os.SEEK_SET)
        with open(self._fd, "rb", closefd=False) as file:
            return file.read().decode("utf-8", "backslashreplace")


def _name(number: int) -> str:
    """Return the name of a signal; real-time signals between the first and the last have none."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _nameless() -> int:
    """Return the descriptor of a file without a name; -1 if none can be made."""
    try:
        if hasattr(os, "memfd_create"):
            return os.memfd_create("usdsplat-crash")
        import tempfile

        file, path = tempfile.mkstemp(prefix="usdsplat-")
        os.unlink(path)
        return file
    except OSError:
        return -1


def _is_tight() -> bool:
    """Return whether the address space of this process is limited to less than `TIGHT`, as by
    `ulimit -v`."""
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return limit != resource.RLIM_INFINITY and limit < TIGHT
