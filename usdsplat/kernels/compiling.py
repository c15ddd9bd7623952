"""Report that kernels are being compiled, which takes seconds and happens once per machine."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event

TOLD = "usdsplat:told"
"""Event: compilation that Numba itself does not report; `data` has its "name"."""
SPENT = "usdsplat:spent"
"""Event whose start and end enclose such a compilation."""


@contextmanager
def compiled(name: str) -> Iterator[None]:
    """Report that the context compiles the function `name`."""
    with event.trigger_event(TOLD, data={"name": name}), event.trigger_event(SPENT):
        yield


class _Listener(event.Listener):
    """Listener that calls back when a compilation starts; kernels loaded from a cache are not
    reported."""

    def __init__(self, callback: Callable[[str], None]) -> None:
        self._callback = callback
        self._thread = threading.get_ident()

    def on_start(self, event: Any) -> None:
        if threading.get_ident() == self._thread:  # Numba reports to the listeners of all threads
            told = event.data
            self._callback(told.get("name") or told["dispatcher"].py_func.__name__)

    def on_end(self, event: Any) -> None:
        pass


@contextmanager
def on_compile(callback: Callable[[str], None]) -> Iterator[None]:
    """Call `callback` with the name of each function before it is compiled in this thread, while
    the context lasts."""
    listener = _Listener(callback)
    with (
        event.install_listener("numba:compile", listener),
        event.install_listener(TOLD, listener),
    ):
        yield


@contextmanager
def compile_time() -> Iterator[Callable[[], float]]:
    """Yield a function that returns the time spent on compiling in the context so far [s]."""
    timers = event.TimingListener(), event.TimingListener()
    with (
        event.install_listener("numba:compile", timers[0]),
        event.install_listener(SPENT, timers[1]),
    ):
        yield lambda: sum(timer.duration for timer in timers if timer.done)
