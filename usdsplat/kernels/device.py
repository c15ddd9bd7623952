"""Run kernels on a device: threads, launches and buffers.

Callers write `device.run(kernel, ...)`; the device chooses threads and memory.
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

from usdsplat.core.errors import BackendError, UsageError
from usdsplat.kernels.launch import Kernel, chunk_of

_WORKQUEUE_LOCK = threading.Lock()
"""Numba's own `workqueue` layer aborts the process when two threads launch at once; TBB and OpenMP,
which Numba prefers where they exist, do not. All devices of a process share this lock."""

CHUNK = 8
"""Loop items that a thread takes at a time. The number is small, so that other threads can take
over from a slow one."""


def _launch_threads() -> None:
    """Start Numba's threads, once per process, so that idle ones sleep.

    OpenMP's idle threads spin by default. On a busy machine each region then waits for a thread
    that is not running (sorting 68k keys took 64 ms instead of 2), and spinning counts as CPU time.
    The setting is read when the library is loaded and belongs to the user, so it is restored
    afterwards.
    """
    name = "OMP_WAIT_POLICY"
    before = os.environ.get(name)
    os.environ.setdefault(name, "PASSIVE")
    try:
        launcher._launch_threads()
    finally:
        if before is None:
            del os.environ[name]


def load_registries() -> None:
    """Load what Numba needs before it loads the first kernel, but start no thread.

    Processes that are forked later have it then.
    """
    numba.core.registry.cpu_target.typing_context.refresh()
    numba.core.registry.cpu_target.target_context.refresh()


VARIABLE = "USDSPLAT_THREADS"
"""Environment variable with the number of threads where none is asked for: several processes that
use all cores each are much slower together than with a share of them."""


def cores() -> int:
    """Return the largest number of threads."""
    config: Any = numba.config
    return int(config.NUMBA_NUM_THREADS)


def usual_threads() -> int:
    """Return the number of threads where none is asked for: USDSPLAT_THREADS, or that of the cores.

    Raises:
        UsageError: If the variable is no such number.
    """
    asked = os.environ.get(VARIABLE)
    if not asked:
        return cores()
    if not (asked.isascii() and asked.isdigit() and 1 <= int(asked) <= cores()):
        raise UsageError(VARIABLE, repr(asked), f"1 to {cores()}")
    return int(asked)


class Device(Protocol):
    """Device that runs kernels. Only `run` and `fetch` can read the arrays that it keeps."""

    @property
    def name(self) -> str:
        """Name of the device, such as "cpu"."""

    @property
    def threads(self) -> int:
        """Number of host threads that the device may use."""

    @property
    def remark(self) -> str:
        """Reason why a faster device is not used, for the user; usually empty."""

    def upload(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return `array` contiguous, aligned and read-only, as `run` reads it. Copy it only if
        needed."""

    def keep(self, array: npt.NDArray[Any]) -> Any:
        """Return `array` in the device's memory, cached for the lifetime of `array`, which must not
        change."""

    def move(self, array: npt.NDArray[Any]) -> Any:
        """Move `array` to the device's memory. The caller must not use the host array
        afterwards."""

    def copied(self, array: Any) -> Any:
        """Return a new array in the device's memory with the contents of `array`; the caller may
        change it. If `keep` has a copy of `array`, nothing is sent from the host."""

    def publish(self, array: Any) -> npt.NDArray[Any]:
        """Return a device array on the host, see `fetch`. A later `keep` of the result costs
        nothing. Neither array may change."""

    def empty(self, shape: int | tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
        """Return a host buffer with undefined contents."""

    def resident(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        """Return a buffer in the device's memory with undefined contents."""

    def fetch(self, array: Any) -> npt.NDArray[Any]:
        """Return a device array on the host, or a host array unchanged."""

    def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        """Call `kernel` with arrays of the host or the device's own, and return what it returns.

        When `run` returns, host arrays contain the kernel's results. The copies of `keep` are used
        in place of their host arrays, and dropped if the kernel writes these.
        """

    def close(self) -> None:
        """Release everything that the device keeps."""


class CpuDevice:
    """CPU of this machine, with Numba's threads.

    Args:
        threads: Number of threads, 1 to the number of cores; None for `usual_threads`.
        remark: Why a faster device is not used.

    Raises:
        UsageError: If `threads` or USDSPLAT_THREADS is out of range.
    """

    name = "cpu"

    def __init__(self, *, threads: int | None = None, remark: str = "") -> None:
        self.remark = remark
        self.threads = checked_threads(threads) or usual_threads()
        _launch_threads()
        shared = numba.threading_layer() == "workqueue"
        self._launch: AbstractContextManager[Any] = _WORKQUEUE_LOCK if shared else nullcontext()

    def upload(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return `array` contiguous, aligned and read-only. Copy it only if needed."""
        view = np.require(array, requirements=["C", "A"]).view()
        view.flags.writeable = False
        return view

    keep = upload

    def empty(self, shape: int | tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
        """Return a buffer with undefined contents; pages that are never touched take no memory."""
        return np.empty(shape, dtype)

    resident = empty

    def fetch(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return `array` itself."""
        return array

    publish = fetch

    def copied(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return a contiguous copy of `array`."""
        return np.array(array, order="C")

    def move(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return `array`, copied only if it is not contiguous and aligned."""
        return np.require(array, requirements=["C", "A"])

    def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        """Call `kernel` with this device's threads and return what it returns."""
        rounds = CHUNK
        if isinstance(kernel, Kernel):
            rounds = chunk_of(kernel, kernel.size(args), self.threads)
            kernel, args = kernel.on_cpu, (args,)
        with self._launch:
            threads, chunk = numba.get_num_threads(), numba.get_parallel_chunksize()
            numba.set_num_threads(self.threads)
            numba.set_parallel_chunksize(rounds)
            try:
                return kernel(*args)
            finally:
                numba.set_num_threads(threads)
                numba.set_parallel_chunksize(chunk)

    def close(self) -> None:
        """Do nothing; this device keeps nothing."""


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
    """Return `threads` if this machine has that many cores.

    Raises:
        UsageError: If it has not.
    """
    if threads is not None and not 1 <= threads <= cores():
        raise UsageError("threads", str(threads), f"1 to {cores()}")
    return threads
