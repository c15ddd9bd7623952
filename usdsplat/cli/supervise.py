"""Run the command line in a child process, so that it ends in order whatever happens to it.

The parent process is forked before USD and Numba are loaded. It forwards SIGINT, SIGTERM and
SIGHUP, waits for a moment while the command removes its unfinished files, and then kills it: Python
runs no signal handler while C++ code computes, and C++ code may drop the handler's exception. The
parent also removes the temporary files of a child that crashed or was killed, and explains its end.
If the parent is killed, the child ends as after SIGTERM.

Without `fork` (Windows), with USDSPLAT_SUPERVISE=0 (for debuggers and profilers) and for help, the
command runs in this process. The same signals interrupt it, but only while Python code runs.
"""

from __future__ import annotations

import atexit
import os
import select
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NoReturn

from usdsplat.cli.crash_log import CrashLog
from usdsplat.cli.streams import open_streams
from usdsplat.core import interrupt

VARIABLE = "USDSPLAT_SUPERVISE"
GRACE = 1.5
"""Time for the command to end by itself after a signal [s]."""
IMPATIENCE = 0.5
"""Time after which another signal ends the command at once [s]. Two programs may send the same
signal at about the same time, such as a terminal and `make`."""
_MADE, _REMOVED, _DONE, _ADVICE = b"+", b"-", b"=", b"?"
_HELP = {"-h", "--help", "help", "--version"}
"""Words that ask for help, as the first argument or as the only one of a command."""


def entry() -> int:
    """Run the command line of this process, and return its exit status."""
    open_streams()
    arguments = sys.argv[1:]
    if (
        not hasattr(os, "fork")
        or os.environ.get(VARIABLE) == "0"
        or not arguments
        or _asks_for_help(arguments)
    ):
        return _command(None)
    return _supervise(arguments)


def begin_anew(arguments: Sequence[str]) -> int:
    """Run a command line in a process that was forked from one with another command, and return
    its exit status."""
    leave_command()
    sys.argv[1:] = arguments
    return entry()


def leave_command() -> None:
    """Drop what belongs to the command from which this process was forked: its connection to the
    process that watches it, and its record of messages."""
    from usdsplat.cli import reporting
    from usdsplat.core import output

    interrupt.forget()
    interrupt.pass_advice_to(lambda advice: None)
    output.announce = None
    reporting.leave_messages()


def _asks_for_help(arguments: Sequence[str]) -> bool:
    """Return whether a command line only prints help or the version."""
    return arguments[0] in _HELP or (len(arguments) == 2 and arguments[1] in ("-h", "--help"))


def _supervise(arguments: Sequence[str]) -> int:
    """Fork; run the command in the child and watch it in the parent."""
    life, news, wake = os.pipe(), os.pipe(), os.pipe()
    log = CrashLog()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {*interrupt.SIGNALS, signal.SIGCHLD})
    signal.signal(signal.SIGCHLD, _nothing)  # an ignored one would hide the child's status
    try:
        child = os.fork()
    except OSError:  # too many processes, or too little memory
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return _command(None)
    if child == 0:
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for fd in (life[1], news[0], *wake):
            os.close(fd)
        interrupt.handle()
        try:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            log.listen()
            return _command(Child(life[0], news[1]))
        except KeyboardInterrupt as error:  # before the command began
            return interrupt.status(error)
    for fd in (life[0], news[1]):
        os.close(fd)
    os.set_blocking(wake[1], False)
    signal.set_wakeup_fd(wake[1], warn_on_full_buffer=False)
    for number in interrupt.SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _nothing)
    # SIGCHLD tells of the child's end, also if the caller has blocked it
    signal.pthread_sigmask(signal.SIG_SETMASK, set(before) - {signal.SIGCHLD})
    parent = Parent(child, news=news[0], wake=wake[0])
    wait_status = parent.wait()
    _ignore_signals()  # at its end, Python restores the default of those that it handles
    return parent.status(wait_status, arguments, log)


def _command(child: Child | None) -> int:
    """Run the command in this process, and return its status. Later signals have no effect."""
    if child is None:
        interrupt.handle()
    try:
        from usdsplat.cli import failures, hooks
        from usdsplat.cli.main import main

        hooks.install()
        if child is not None:
            child.begin()
        status = hooks.status(main())
    except KeyboardInterrupt as error:  # before the command, or while it explained its end
        from usdsplat.cli import failures

        status = failures.interrupted(error)
    except Exception:  # what a C++ module that was interrupted while it was loaded makes of it
        if not interrupt.received():
            raise
        from usdsplat.cli import failures

        status = failures.interrupted(interrupt.Interrupted(interrupt.received()))
    _ignore_signals()
    if child is not None:
        child.done(status)
        _leave(status)
    return status


def _ignore_signals() -> None:
    for number in interrupt.SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _leave(status: int) -> NoReturn:
    """End this process at once, without the shutdown of the interpreter.

    The shutdown takes half a second of CPU time where USD is loaded, and threads of C++ code that
    was interrupted may still run, and crash while it takes place. Threads of Python are waited for,
    unless there was an interruption.
    """
    if not interrupt.received():
        _join_threads()
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(status)


def _join_threads() -> None:
    """Wait for all threads but daemons, as the interpreter does before it ends.

    Executors of `concurrent.futures` are told to end first.
    """
    import threading

    join: Any = getattr(threading, "_shutdown", None)
    if join is not None:
        join()


class Child:
    """The child's end of the connection to its parent.

    Args:
        life: File descriptor that is at its end when the parent has died.
        news: File descriptor to which temporary paths and the exit status are written.
    """

    def __init__(self, life: int, news: int) -> None:
        self._life = life
        self._news = news
        self._paths: set[str] = set()

    def begin(self) -> None:
        """Report temporary paths from now on, and watch the parent."""
        import threading

        from usdsplat.core import output

        self._lock = threading.Lock()
        output.announce = self._announce
        interrupt.pass_advice_to(lambda advice: self._send(_ADVICE + os.fsencode(advice)))
        threading.Thread(target=self._watch, name=interrupt.WATCHER, daemon=True).start()

    def done(self, status: int) -> None:
        """Report the exit status: all that follows is the end of the interpreter."""
        self._send(_DONE + str(status).encode())

    def _announce(self, path: str, is_made: bool) -> None:
        with self._lock:
            (self._paths.add if is_made else self._paths.discard)(path)
            self._send((_MADE if is_made else _REMOVED) + os.fsencode(path))

    def _send(self, message: bytes) -> None:
        with suppress(OSError):  # the parent was killed; `_watch` sees to it
            os.write(self._news, message + b"\0")

    def _watch(self) -> None:
        """Wait for the parent's death; then end this process as after SIGTERM."""
        os.read(self._life, 1)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(GRACE)
        for path in tuple(self._paths):
            _remove(path)
        os._exit(128 + signal.SIGTERM)


class Parent:
    """The parent process: it forwards signals, and cleans up after the child.

    Args:
        child: Process to watch.
        news: File descriptor to read what `Child` reports.
        wake: File descriptor to which Python writes the number of each signal.
    """

    def __init__(self, child: int, *, news: int, wake: int) -> None:
        self._child = child
        self._news = news
        self._wake = wake
        self._asked = 0
        self._asked_at = 0.0
        self._deadline: float | None = None
        self._rest = b""
        self._paths: set[str] = set()
        self._done: int | None = None

    def wait(self) -> int:
        """Wait for the end of the child, and return its wait status."""
        waiting = select.poll()
        waiting.register(self._wake, select.POLLIN)
        waiting.register(self._news, select.POLLIN)
        while True:
            pid, status = os.waitpid(self._child, os.WNOHANG)
            if pid:
                break
            for fd, _ in waiting.poll(self._patience()):
                data = os.read(fd, 1 << 16)
                if fd == self._wake:
                    self._forward(data)
                elif data:
                    self._hear(data)
                else:  # the child has closed it
                    waiting.unregister(fd)
            if self._deadline is not None and time.monotonic() >= self._deadline:
                os.kill(self._child, signal.SIGKILL)
                self._deadline = None
        os.set_blocking(self._news, False)
        with suppress(BlockingIOError):
            while data := os.read(self._news, 1 << 16):
                self._hear(data)
        return status

    def status(self, wait_status: int, arguments: Sequence[str], log: CrashLog) -> int:
        """Remove what the child left, explain its end if it did not, and return the status."""
        for path in self._paths:
            _remove(path)
        code = os.waitstatus_to_exitcode(wait_status)
        if code >= 0 or self._done is not None:
            log.repeat(is_success=code == 0)
            return code if self._done is None else self._done
        if self._asked:
            from usdsplat.cli import failures

            return failures.interrupted(interrupt.Interrupted(self._asked))
        return log.explain(-code, arguments)

    def _patience(self) -> float | None:
        """Return the time until the child is killed [ms]; None without a signal."""
        if self._deadline is None:
            return None
        return max(0.0, self._deadline - time.monotonic()) * 1000

    def _forward(self, numbers: bytes) -> None:
        """Pass the first signal on; a later one ends the command at once."""
        now = time.monotonic()
        for number in numbers:
            if number not in interrupt.SIGNALS:
                continue
            if not self._asked:
                self._asked, self._asked_at, self._deadline = number, now, now + GRACE
                os.kill(self._child, number)
            elif now - self._asked_at > IMPATIENCE and self._deadline is not None:
                self._deadline = now

    def _hear(self, data: bytes) -> None:
        """Take reports of the child."""
        *messages, self._rest = (self._rest + data).split(b"\0")
        for message in messages:
            kind, text = message[:1], os.fsdecode(message[1:])
            if kind == _DONE:
                self._done = int(text)
            elif kind == _ADVICE:
                interrupt.advise(text)
            elif kind == _MADE:
                self._paths.add(text)
            else:
                self._paths.discard(text)


def _remove(path: str) -> None:
    """Remove a temporary file or folder, if it exists."""
    if os.path.isdir(path) and not os.path.islink(path):
        from pathlib import Path

        from usdsplat.core.output import remove_left_folder

        remove_left_folder(Path(path))
    else:
        with suppress(OSError):
            os.unlink(path)


def _nothing(number: int, frame: object) -> None:
    """Receive a signal: the file descriptor of `signal.set_wakeup_fd` reports it."""
