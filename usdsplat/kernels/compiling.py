"""Say that kernels are being compiled: it takes seconds, and happens once for each machine."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event


class _Listener(event.Listener):
    """Calls back as a compilation starts; what is loaded from a cache is not compiled."""

    def __init__(self, callback: Callable[[str], None]) -> None:
        self._callback = callback
        self._thread = threading.get_ident()

    def on_start(self, event: Any) -> None:
        if threading.get_ident() == self._thread:  # Numba tells everybody of everything
            self._callback(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: Any) -> None:
        pass


@contextmanager
def on_compile(callback: Callable[[str], None]) -> Iterator[None]:
    """While the context lasts, call `callback` with the name of each function that is compiled in
    this thread, before it is."""
    with event.install_listener("numba:compile", _Listener(callback)):
        yield


@contextmanager
def compile_time() -> Iterator[Callable[[], float]]:
    """While the context lasts, what it gives says how long compiling has taken so far [s]."""
    timer = event.TimingListener()
    with event.install_listener("numba:compile", timer):
        yield lambda: timer.duration if timer.done else 0.0
