"""Whether kernels can run on a GPU here, found out without loading what that needs."""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import os
import sys

INSTALL = "pip install 'usdsplat[cuda]'"


def is_simulated() -> bool:
    """Whether Numba simulates a GPU: for tests, slowly."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0")


def is_compiled() -> bool:
    """Whether numba-cuda is there to compile kernels: where it is not, tests only read them."""
    return not is_simulated() and importlib.util.find_spec("numba_cuda") is not None


@functools.cache
def has_gpu() -> bool:
    """Whether the driver is there and has a GPU to use."""
    name = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"
    try:
        driver = ctypes.CDLL(name)
    except OSError:
        return False
    count = ctypes.c_int(0)
    if driver.cuInit(0) != 0 or driver.cuDeviceGetCount(ctypes.byref(count)) != 0:
        return False
    return count.value > 0


@functools.cache
def obstacle() -> tuple[str, str] | None:
    """What keeps kernels from running on a GPU here: (found, expected), or None."""
    if is_simulated():
        return None
    if not has_gpu():
        return "no NVIDIA GPU that its driver can use", "one, or --device cpu"
    for module, package in (("numba_cuda", "numba-cuda"), ("cuda.compute", "cuda-cccl")):
        try:
            there = importlib.util.find_spec(module) is not None
        except ModuleNotFoundError:  # not even the package around it
            there = False
        if not there:
            return f"a GPU but no package {package}", INSTALL
    return None
