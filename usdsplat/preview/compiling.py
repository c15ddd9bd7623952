"""Publish that kernels are being compiled, which is slow and happens once per machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from usdsplat.kernels.compiling import on_compile
from usdsplat.preview.values import Busy, Event

COMPILING = Busy(what="compiling kernels, once for this machine")


@contextmanager
def telling(publish: Callable[[Event], None]) -> Iterator[Callable[[], None]]:
    """Publish, within the context, that this thread compiles, from the first kernel on.

    Yields:
        Function that ends the message early; the end of the context does so too.
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
