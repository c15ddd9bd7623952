"""A process that is forked from this one, with what `jobs.local` uses of `subprocess.Popen`."""

from __future__ import annotations

import faulthandler
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from typing import NoReturn

from usdsplat.core import interrupt

_BEAT = 0.01
"""Time between looks at a process whose end is waited for [s]."""


class ForkedProcess:
    """A process that runs a function, with pipes as stdin and as stdout and stderr.

    It has a session of its own, and no file descriptor of this process but the pipes. Only the
    thread that calls exists in it: see `usdsplat.cli.forking` for when that is safe.

    Args:
        run: What it runs; the result is its exit status.
        environment: Its variables, in addition to those of this process.
    """

    def __init__(self, run: Callable[[], int], environment: Mapping[str, str]) -> None:
        given, told = os.pipe(), os.pipe()
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()  # what waits in their buffers would be written twice
        # a signal must not raise in the new process, which would go on as this one
        before = signal.pthread_sigmask(signal.SIG_BLOCK, interrupt.SIGNALS)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # of threads that only wait
                self.pid = os.fork()
            if self.pid == 0:
                _become(run, environment, given[0], told[1], before)
        except OSError:
            for fd in (*given, *told):
                os.close(fd)
            raise
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        os.close(given[0])
        os.close(told[1])
        self.stdin = os.fdopen(given[1], "w", encoding="utf-8", errors="surrogateescape")
        self.stdout = os.fdopen(told[0], encoding="utf-8", errors="surrogateescape")
        self._lock = threading.Lock()
        self._status: int | None = None

    def poll(self) -> int | None:
        """Return the exit status, negative for a signal; None if the process runs."""
        with self._lock:
            if self._status is None:
                try:
                    pid, status = os.waitpid(self.pid, os.WNOHANG)
                except ChildProcessError:  # the caller ignores SIGCHLD: no status is kept
                    pid, status = self.pid, 0
                if pid:
                    self._status = os.waitstatus_to_exitcode(status)
            return self._status

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end of the process, and return its exit status.

        Raises:
            subprocess.TimeoutExpired: If it takes longer than `timeout` [s].
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while (status := self.poll()) is None:
            if timeout is not None and deadline is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(["usdsplat", "worker"], timeout)
            time.sleep(_BEAT)
        return status

    def send_signal(self, number: int) -> None:
        """Send a signal to the process, if it runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Send SIGKILL to the process, if it runs."""
        self.send_signal(signal.SIGKILL)


def _become(
    run: Callable[[], int],
    environment: Mapping[str, str],
    stdin: int,
    stdout: int,
    signals: Iterable[int],
) -> NoReturn:
    """Be the new process, which blocks `signals`. Nothing of the old one is left but its memory."""
    status = 1
    try:
        faulthandler.disable()  # its file is closed
        os.setsid()  # Ctrl-C reaches the old process only, which ends this one
        signal.pthread_sigmask(signal.SIG_SETMASK, signals)
        for fd, number in ((stdin, 0), (stdout, 1), (stdout, 2)):
            os.dup2(fd, number)
        for fd in map(int, os.listdir("/proc/self/fd")):
            with suppress(OSError):  # the listing's own is closed
                if fd > 2:
                    os.close(fd)
        os.environ.update(environment)
        sys.stdin = os.fdopen(0, encoding="utf-8", closefd=False)
        sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
        sys.stderr = os.fdopen(
            2, "w", buffering=1, encoding="utf-8", errors="backslashreplace", closefd=False
        )
        status = run()
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)
