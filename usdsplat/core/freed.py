"""Return freed memory to the system.

glibc keeps what each thread has freed, for that thread. Each document of a window has a thread of
its own, so the memory of closed ones would stay with the process: twice as much as is used after
some files were opened.
"""

from __future__ import annotations

import ctypes
import sys


def return_freed_memory() -> None:
    """Return freed memory to the system, where the C library has a function for it."""
    if sys.platform.startswith("linux"):
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc's own
        if trim is not None:
            trim(ctypes.c_size_t(0))
