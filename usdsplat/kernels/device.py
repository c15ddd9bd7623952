"""The one door to the machine: threads, launches, buffers.

Callers write `device.run(kernel, ...)` and never say how many threads there are.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from numba.np.ufunc import parallel as launcher

from usdsplat.core.errors import BackendError, UsageError

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


class CpuDevice:
    """Threads of this machine, by Numba.

    Args:
        threads: How many to use, 1 to the number of cores; None for all.

    Raises:
        UsageError: If `threads` is out of range.
    """

    name = "cpu"

    def __init__(self, *, threads: int | None = None) -> None:
        most = _cores()
        if threads is not None and not 1 <= threads <= most:
            raise UsageError("threads", str(threads), f"1 to {most}")
        self.threads = threads or most
        _launch_threads()
        shared = numba.threading_layer() == "workqueue"
        self._launch: AbstractContextManager[Any] = _WORKQUEUE_LOCK if shared else nullcontext()

    def upload(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """`array` as kernels want it: contiguous, aligned and read-only, copied only if it is
        not."""
        view = np.require(array, requirements=["C", "A"]).view()
        view.flags.writeable = False
        return view

    def empty(self, shape: int | tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
        """A buffer with undefined contents; pages that nobody touches cost nothing."""
        return np.empty(shape, dtype)

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


DEVICES = {"cpu": CpuDevice}


def open_device(name: str = "auto", *, threads: int | None = None) -> CpuDevice:
    """Return the device called `name`; "auto" is the fastest one here.

    Raises:
        BackendError: If no such device is usable here.
        UsageError: If `threads` is out of range.
    """
    if name not in ("auto", *DEVICES):
        raise BackendError("device", repr(name), f"auto or one of: {', '.join(DEVICES)}")
    return DEVICES["cpu" if name == "auto" else name](threads=threads)
