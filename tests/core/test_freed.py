"""Tests that freed memory is returned to the system."""

from __future__ import annotations

import subprocess
import sys

import pytest

CODE = """
import ctypes
from usdsplat.core.freed import return_freed_memory

def resident():
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmRSS"))

libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
libc.malloc.argtypes = (ctypes.c_size_t,)
libc.free.argtypes = (ctypes.c_void_p,)
if not hasattr(libc, "malloc_trim"):
    raise SystemExit
blocks = [libc.malloc(100_000) for _ in range(1000)]  # too small to be mapped alone
for block in blocks:
    ctypes.memset(block, 1, 100_000)
last = libc.malloc(100_000)  # what is freed below it stays with the process
for block in blocks:
    libc.free(block)
before = resident()
return_freed_memory()
assert before - resident() > 80_000, (before, resident())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's own function")
def test_freed_blocks_leave_the_process() -> None:
    """Oracle: the system's number of resident bytes: 100 MB were freed below a block that stays."""
    subprocess.run([sys.executable, "-c", CODE], check=True)
