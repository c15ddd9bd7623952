"""Say that kernels are being compiled: it takes seconds, and happens once for each machine."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event

TOLD = "usdsplat:told"
"""Event: something is compiled of which Numba itself does not tell; `data` has its "name"."""
SPENT = "usdsplat:spent"
"""Event: from its start to its end such things are compiled."""


@contextmanager
def compiled(name: str) -> Iterator[None]:
    """Tell that the context compiles what is called `name`."""
    with event.trigger_event(TOLD, data={"name": name}), event.trigger_event(SPENT):
        yield


class _Listener(event.Listener):
    """Calls back as a compilation starts; what is loaded from a cache is not compiled."""

    def __init__(self, callback: Callable[[str], None]) -> None:
        self._callback = callback
        self._thread = threading.get_ident()

    def on_start(self, event: Any) -> None:
        if threading.get_ident() == self._thread:  # Numba tells everybody of everything
            told = event.data
            self._callback(told.get("name") or told["dispatcher"].py_func.__name__)

    def on_end(self, event: Any) -> None:
        pass


@contextmanager
def on_compile(callback: Callable[[str], None]) -> Iterator[None]:
    """While the context lasts, call `callback` with the name of each function that is compiled in
    this thread, before it is."""
    listener = _Listener(callback)
    with (
        event.install_listener("numba:compile", listener),
        event.install_listener(TOLD, listener),
    ):
        yield


@contextmanager
def compile_time() -> Iterator[Callable[[], float]]:
    """While the context lasts, what it gives says how long compiling has taken so far [s]."""
    timers = event.TimingListener(), event.TimingListener()
    with (
        event.install_listener("numba:compile", timers[0]),
        event.install_listener(SPENT, timers[1]),
    ):
        yield lambda: sum(timer.duration for timer in timers if timer.done)
