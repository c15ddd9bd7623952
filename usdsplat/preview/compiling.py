"""Telling that kernels are being compiled: it takes long, and happens once for each machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from usdsplat.kernels.compiling import on_compile
from usdsplat.preview.values import Busy, Event

COMPILING = Busy(what="compiling kernels, once for this machine")


@contextmanager
def telling(publish: Callable[[Event], None]) -> Iterator[Callable[[], None]]:
    """While the context lasts, publish that this thread compiles, from the first kernel on.

    Yields:
        What says that it is over for now; the end of the context says so too.
    """
    is_told = False

    def begun(name: str) -> None:
        nonlocal is_told
        if not is_told:
            is_told = True
            publish(COMPILING)

    def over() -> None:
        nonlocal is_told
        if is_told:
            is_told = False
            publish(Busy(what=""))

    try:
        with on_compile(begun):
            yield over
    finally:
        over()
