"""Use freed memory again, and return it to the system.

glibc gives threads arenas of their own, up to eight for each core, and keeps what was freed in
them. Each document of a window has threads of its own: one for the stage, others for kernels and
for nodes of splat trees. The memory of closed documents would stay with the process, in pieces that
no other arena can use.
"""

from __future__ import annotations

import ctypes
import os
import sys
from typing import Any

ARENAS = 2
"""Maximum number of arenas: after 25 splat trees, 0.1 GB were free in them instead of 0.6 GB. Small
pieces are allocated without one, from a cache of each thread."""
_ARENA_MAX = -8  # glibc's M_ARENA_MAX


def share_freed_memory() -> None:
    """Let all threads allocate from a few arenas from now on, where the C library has arenas. The
    environment variable MALLOC_ARENA_MAX counts more."""
    option = _of_glibc("mallopt")
    if option is not None and "MALLOC_ARENA_MAX" not in os.environ:
        option(ctypes.c_int(_ARENA_MAX), ctypes.c_int(ARENAS))


def return_freed_memory() -> None:
    """Return freed memory to the system, where the C library has a function for it."""
    trim = _of_glibc("malloc_trim")
    if trim is not None:
        trim(ctypes.c_size_t(0))


def _of_glibc(name: str) -> Any:
    """Return a function of glibc; None elsewhere."""
    library = ctypes.CDLL(None) if sys.platform.startswith("linux") else None
    return getattr(library, name, None) if hasattr(library, "malloc_trim") else None
