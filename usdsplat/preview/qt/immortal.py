"""Work around PySide6's assumption that None, True and False are immortal.

PySide6 6.12 assumes that these constants are immortal, which is true since Python 3.12 (PEP 683).
In Python 3.11 each call that returns one of them drops a reference too many, so that after some
thousand calls the interpreter aborts: "deallocating None". This module adds more references than
any window can use up.
"""

from __future__ import annotations

import ctypes
import sys

PLENTY = 1 << 40
"""Number of references; a million calls a second use them up in twelve days."""


def make_immortal() -> None:
    """Add references to constants in Pythons that count them; elsewhere do nothing."""
    is_counted = sys.implementation.name == "cpython" and sys.version_info < (3, 12)
    if is_counted and sys.maxsize > PLENTY:
        for constant in (None, True, False, NotImplemented, ...):
            count = ctypes.c_ssize_t.from_address(id(constant))
            count.value = max(count.value, PLENTY)
