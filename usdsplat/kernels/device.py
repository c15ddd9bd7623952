"""What runs kernels: threads, launches and buffers of one device.

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

from usdsplat.core.errors import BackendError, UsageError
from usdsplat.kernels.launch import Kernel, chunk_of

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
