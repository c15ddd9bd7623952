"""The one door to the machine: threads, launches, buffers.

Callers write `device.run(kernel, ...)` and never say how many threads there are, nor where.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Protocol

import numba
import numpy as np
import numpy.typing as npt
from numba.np.ufunc import parallel as launcher

from usdsplat.core.errors import BackendError, UsageError, UsdSplatError

_WORKQUEUE_LOCK = threading.Lock()
"""Numba's own `workqueue` layer aborts the process when two threads launch at once; TBB and OpenMP,
which Numba prefers where they exist, do not. A property of the process, hence a module's lock."""

CHUNK = 8
"""Loop items handed to a thread at a time: small, so that a thread that lags is helped by the
rest."""


def _launch_threads() -> None:
    """Start Numba's threads, once per process, so that idle ones sleep.

    OpenMP's idle threads spin by default: on a busy machine each region then waits for a thread
    that does not run (sorting 68k keys took 64 ms instead of 2), and spinning is billed as CPU
    time. The setting is read when the library is loaded and belongs to the user, so it is put back.
    """
    name = "OMP_WAIT_POLICY"
    before = os.environ.get(name)
    os.environ.setdefault(name, "PASSIVE")
    try:
        launcher._launch_threads()
    finally:
        if before is None:
            del os.environ[name]


def _cores() -> int:
    config: Any = numba.config
    return int(config.NUMBA_NUM_THREADS)


class Device(Protocol):
    """What runs kernels. Arrays that it keeps are its own: only `run` and `fetch` know them."""

    @property
    def name(self) -> str:
        """Such as "cpu"."""

    @property
    def threads(self) -> int:
        """Threads of the host that it may use."""

    @property
    def remark(self) -> str:
        """Why it is not the fastest device that this machine could have; mostly empty."""

    def upload(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """`array` as `run` reads it: contiguous, aligned and read-only, copied only if it is
        not."""

    def keep(self, array: npt.NDArray[Any]) -> Any:
        """`array` where kernels reach it fastest, for as long as it lives. It must never change."""

    def move(self, array: npt.NDArray[Any]) -> Any:
        """A buffer where kernels reach it fastest, with what `array` holds; the host must not use
        `array` any more, which may be the buffer itself."""

    def publish(self, array: Any) -> npt.NDArray[Any]:
        """`fetch`, after which to `keep` what it gives costs nothing; neither may change."""

    def empty(self, shape: int | tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
        """A buffer of the host with undefined contents."""

    def resident(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        """A buffer where kernels reach it fastest, with undefined contents."""

    def fetch(self, array: Any) -> npt.NDArray[Any]:
        """What a kept or resident array holds, for the host to read; a host's array as it is."""

    def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        """Call `kernel` with arrays of the host or the device's own, and return what it returns.

        An array of the host holds what the kernel wrote when `run` is back.
        """

    def close(self) -> None:
        """Release what it keeps."""


class CpuDevice:
    """Threads of this machine, by Numba.

    Args:
        threads: How many to use, 1 to the number of cores; None for all.
        remark: Why a faster device is not used.

    Raises:
        UsageError: If `threads` is out of range.
    """

    name = "cpu"

    def __init__(self, *, threads: int | None = None, remark: str = "") -> None:
        self.remark = remark
        self.threads = checked_threads(threads) or _cores()
        _launch_threads()
        shared = numba.threading_layer() == "workqueue"
        self._launch: AbstractContextManager[Any] = _WORKQUEUE_LOCK if shared else nullcontext()

    def upload(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """`array` as kernels want it: contiguous, aligned and read-only, copied only if it is
        not."""
        view = np.require(array, requirements=["C", "A"]).view()
        view.flags.writeable = False
        return view

    keep = upload

    def empty(self, shape: int | tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
        """A buffer with undefined contents; pages that nobody touches cost nothing."""
        return np.empty(shape, dtype)

    resident = empty

    def fetch(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """`array` itself."""
        return array

    publish = fetch

    def move(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """`array` itself, contiguous and aligned."""
        return np.require(array, requirements=["C", "A"])

    def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        """Call `kernel` with this device's threads and return what it returns."""
        with self._launch:
            threads, chunk = numba.get_num_threads(), numba.get_parallel_chunksize()
            numba.set_num_threads(self.threads)
            numba.set_parallel_chunksize(CHUNK)
            try:
                return kernel(*args)
            finally:
                numba.set_num_threads(threads)
                numba.set_parallel_chunksize(chunk)

    def close(self) -> None:
        """Nothing is kept."""


DEVICES = ("cpu", "cuda")


def checked_name(name: str) -> str:
    """Return `name` if it is "auto" or one of DEVICES.

    Raises:
        BackendError: If it is not.
    """
    if name not in ("auto", *DEVICES):
        raise BackendError("device", repr(name), f"auto or one of: {', '.join(DEVICES)}")
    return name


def checked_threads(threads: int | None) -> int | None:
    """Return `threads` if this machine has so many.

    Raises:
        UsageError: If it has not.
    """
    if threads is not None and not 1 <= threads <= _cores():
        raise UsageError("threads", str(threads), f"1 to {_cores()}")
    return threads


TASKS = ("pictures", "geometry")
START = 1.5
"""[s] That a GPU takes from the beginning of a process to its first picture, besides what the CPU
takes."""
COMPILING = 60.0
"""[s] That its kernels take where they were not compiled ahead."""


def automatic(task: str, seconds: float | None = None) -> tuple[str, str]:
    """Return the device that "auto" is, and a remark, mostly empty: where a faster one would have
    to be prepared first.

    Pictures are drawn by a GPU where that is done sooner, its start and what it has to compile
    counted. Geometry is the CPU's: between kernels of simulations arrays would cross the bus, and a
    frame takes longer on a GPU at every size that was measured.

    Args:
        task: One of TASKS.
        seconds: About what the task takes on the CPU; None if nobody knows when it ends.
    """
    from usdsplat.kernels import ahead
    from usdsplat.kernels.cuda.support import capability, obstacle

    here = capability() if task == "pictures" else None
    if here is None:
        return "cpu", ""
    is_ready = ahead.is_noted("cuda", here)
    if seconds is None:
        if is_ready:
            return "cuda", ""
        found, expected = obstacle() or ("kernels not compiled yet", "'usdsplat compile' once")
        return "cpu", f"device cuda: found {found}, expected {expected}"
    return ("cuda", "") if seconds > START + (0 if is_ready else COMPILING) else ("cpu", "")


def open_device(
    name: str = "auto",
    *,
    threads: int | None = None,
    task: str = "pictures",
    seconds: float | None = None,
) -> Device:
    """Return the device called `name`; "auto" is what `automatic` says of `task` and `seconds`, or
    the CPU where a GPU cannot be used, and then its `remark` says why.

    Raises:
        BackendError: If no such device is usable here.
        UsageError: If `threads` is out of range.
    """
    chosen, remark = automatic(task, seconds) if checked_name(name) == "auto" else (name, "")
    if chosen == "cpu":
        return CpuDevice(threads=threads, remark=remark)
    from usdsplat.kernels.cuda.support import obstacle

    missing = obstacle()
    if missing is None:
        try:
            from usdsplat.kernels.cuda.device import CudaDevice

            return CudaDevice(threads=threads)
        except UsdSplatError:
            raise
        except Exception as error:  # of a driver too old for a package, or a GPU that is taken
            found = f"a GPU that does not start ({type(error).__name__}: {error})"
            missing = " ".join(found.split()), "one that does"
    if name == "cuda":
        raise BackendError("device cuda", *missing)
    remark = f"device cuda: found {missing[0]}, expected {missing[1]}; the CPU does the work"
    return CpuDevice(threads=threads, remark=remark)
