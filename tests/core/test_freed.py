"""Tests that freed memory is used again, and returned to the system."""

from __future__ import annotations

import os
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


ARENAS_OF = """
import ctypes, sys, tempfile, threading
from usdsplat.core.freed import ARENAS, share_freed_memory

libc = ctypes.CDLL(None)
if not hasattr(libc, "malloc_info"):
    raise SystemExit
libc.malloc.restype = libc.fopen.restype = ctypes.c_void_p
libc.malloc.argtypes = (ctypes.c_size_t,)
libc.malloc_info.argtypes = (ctypes.c_int, ctypes.c_void_p)
libc.fclose.argtypes = (ctypes.c_void_p,)

def arenas():
    with tempfile.NamedTemporaryFile() as target:
        file = libc.fopen(target.name.encode(), b"w")
        libc.malloc_info(0, file)
        libc.fclose(file)
        return target.read().count(b"<heap nr=")

if sys.argv[1] == "few":
    share_freed_memory()
threads = 6
together = threading.Barrier(threads + 1)

def work():
    libc.malloc(100_000)
    together.wait()
    together.wait()

for _ in range(threads):
    threading.Thread(target=work).start()
together.wait()
found = arenas()
together.wait()
assert (found <= ARENAS) == (sys.argv[1] == "few"), found
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's own function")
@pytest.mark.parametrize("how", ["few", "usual"])
def test_threads_share_their_arenas(how: str) -> None:
    """Oracle: glibc's own list of arenas, of six threads that allocate; and without the call."""
    own = {name: value for name, value in os.environ.items() if name != "MALLOC_ARENA_MAX"}
    subprocess.run([sys.executable, "-c", ARENAS_OF, how], check=True, env=own)
