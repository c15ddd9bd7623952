"""None, True and False as PySide6 expects them.

PySide6 6.12 is built as if they were immortal, which they are since Python 3.12 (PEP 683). It runs
in 3.11 too, where each call that returns one of them takes a reference away that nobody gave, so
that some thousand calls later the interpreter ends: "deallocating None". Here they are given more
references than any window can use up, which is what immortal means.
"""

from __future__ import annotations

import ctypes
import sys

PLENTY = 1 << 40
"""References; a million calls a second use them up in twelve days."""


def make_immortal() -> None:
    """Have PySide6 run in Pythons in which constants are counted; elsewhere nothing happens."""
    is_counted = sys.implementation.name == "cpython" and sys.version_info < (3, 12)
    if is_counted and sys.maxsize > PLENTY:
        for constant in (None, True, False, NotImplemented, ...):
            count = ctypes.c_ssize_t.from_address(id(constant))
            count.value = max(count.value, PLENTY)
