"""Decide whether the workers of a job can be made by `fork`, instead of starting Python anew.

The command has loaded the program, which takes more than a second of CPU time; a fork takes a few
milliseconds. But a forked process has only one thread, the one that called `fork`: a lock that
another thread held stays locked, and a library may wait for threads that are gone.

So USD is told to use one thread before it can start others, and workers are forked before a stage
is opened and before a kernel runs. `prepared` counts the threads. Workers start Python anew if a
thread has begun meanwhile, as the drivers of GPUs start some, and in programs that loaded USD or
Numba themselves.
"""

from __future__ import annotations

import gc
import importlib
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from usdsplat.core.interrupt import WATCHER

LIBRARIES = ("pxr", "numba")
"""Packages that start threads which do not survive a fork."""
DRAWING = (
    "usdsplat.products.drawing", "usdsplat.products.planning", "usdsplat.cli.stages",
)  # fmt: skip
"""Modules that tasks which draw pictures need."""
_BLAS = "OPENBLAS_NUM_THREADS"
_THREADS = "/proc/self/task"
_before: int | None = None
"""Number of threads when USD was held; None if it is not."""


@contextmanager
def held() -> Iterator[None]:
    """Keep USD from starting threads in this context, until `release`, if it is not loaded yet, and
    the process has no threads of a program that calls ours."""
    global _before
    others = {each.name for each in threading.enumerate()} - {"MainThread", WATCHER}
    is_loaded = any(name in sys.modules for name in LIBRARIES)
    is_countable = os.path.isdir(_THREADS)
    if sys.platform == "linux" and is_countable and not is_loaded and not others:
        from pxr import Work

        Work.SetConcurrencyLimit(1)
        if Work.GetConcurrencyLimit() == 1:  # PXR_WORK_THREAD_LIMIT comes first
            _before = _threads()
    try:
        yield
    finally:
        release()


def release() -> None:
    """Let USD use its threads from now on; fork no worker any more."""
    global _before
    if _before is not None:
        from pxr import Work

        _before = None
        Work.SetMaximumConcurrencyLimit()


def prepared(modules: Sequence[str]) -> bool:
    """Load what workers need, and return whether they can be forked now.

    Args:
        modules: Names of modules.
    """
    if _before is None:
        return False
    kept = os.environ.get(_BLAS)
    os.environ[_BLAS] = "1"  # SciPy's, which Numba loads and nothing uses
    try:
        try:
            for name in modules:
                importlib.import_module(name)
        except ImportError:  # of Dask, say; the caller explains it
            return False
        from usdsplat.kernels.device import load_registries

        load_registries()
        gc.freeze()  # collections of forked processes do not touch, and thereby copy, what is here
    finally:
        if kept is None:
            del os.environ[_BLAS]
        else:
            os.environ[_BLAS] = kept
    return _threads() == _before


def _threads() -> int:
    """Return the number of threads of this process."""
    return len(os.listdir(_THREADS))
