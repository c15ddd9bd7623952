"""Find out whether kernels can run on a GPU of this machine, without loading GPU packages."""

from __future__ import annotations

import ctypes
import functools
import importlib.metadata
import importlib.util
import os
import sys
import threading

Capability = tuple[int, int]
"""Compute capability of a GPU: (major, minor)."""
SORT, SUM = "sort", "sum"
CUB = (
    (SORT, "u2 i4"), (SORT, "u4 i4"), (SORT, "u8 i4"), (SUM, "i4 i4"), (SUM, "i8 i8"),
)  # fmt: skip
"""CUB algorithms: SORT with the types of keys and values, SUM with those of input and output. They
can be built only on the GPU that runs them, see `cuda.cub`."""
INSTALL = "pip install 'usdsplat[cuda]'"
PACKAGES = ("numba-cuda", "numba", "nvidia-nvvm", "nvidia-nvjitlink", "cuda-core", "cuda-bindings")
"""The packages that compile and assemble CUDA kernels."""
_ASKING = threading.Lock()
CAPABILITY_MAJOR, CAPABILITY_MINOR = 75, 76
"""Numbers of these device attributes in the driver's API (CUdevice_attribute)."""


def is_simulated() -> bool:
    """Return whether Numba simulates a GPU, which is slow and for tests only."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0")


def is_compiled() -> bool:
    """Return whether numba-cuda is installed to compile kernels. Without it, tests only read
    kernels."""
    return not is_simulated() and importlib.util.find_spec("numba_cuda") is not None


def has_gpu() -> bool:
    """Return whether a driver with a usable GPU is installed."""
    return capability() is not None


def capability() -> Capability | None:
    """Return the compute capability of the first GPU; None if there is no usable GPU."""
    with _ASKING:
        return _capability()


@functools.cache
def _capability() -> Capability | None:
    name = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"
    try:
        driver = ctypes.CDLL(name)
    except OSError:
        return None
    device, major, minor = ctypes.c_int(0), ctypes.c_int(0), ctypes.c_int(0)
    if driver.cuInit(0) != 0 or driver.cuDeviceGet(ctypes.byref(device), 0) != 0:
        return None
    for number, kind in ((major, CAPABILITY_MAJOR), (minor, CAPABILITY_MINOR)):
        if driver.cuDeviceGetAttribute(ctypes.byref(number), kind, device) != 0:
            return None
    return major.value, minor.value


def begin() -> None:
    """Let a thread start the driver, which takes up to a second on a host with several GPUs, while
    this one loads the program. `capability` waits for what is left of it."""
    threading.Thread(target=capability, name="usdsplat driver", daemon=True).start()


def gpu_count() -> int:
    """Return the number of GPUs that the driver shows to this process; 0 without a driver."""
    if capability() is None:
        return 0
    count = ctypes.c_int(0)
    driver = ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
    return count.value if driver.cuDeviceGetCount(ctypes.byref(count)) == 0 else 0


@functools.cache
def obstacle() -> tuple[str, str] | None:
    """Return the reason why kernels cannot run on a GPU here, as (found, expected), or None."""
    if is_simulated():
        return None
    if not has_gpu():
        return "no NVIDIA GPU that its driver can use", "one, or --device cpu"
    for module, package in (("numba_cuda", "numba-cuda"), ("cuda.compute", "cuda-cccl")):
        try:
            there = importlib.util.find_spec(module) is not None
        except ModuleNotFoundError:  # the parent package is missing too
            there = False
        if not there:
            return f"a GPU but no package {package}", INSTALL
    return None


@functools.cache
def versions() -> str:
    """Return the versions of Python and of PACKAGES, as one text."""

    def version(package: str) -> str:
        try:
            return f"{package} {importlib.metadata.version(package)}"
        except importlib.metadata.PackageNotFoundError:
            return ""

    return " ".join([f"python {sys.version_info[:2]}", *map(version, PACKAGES)])
