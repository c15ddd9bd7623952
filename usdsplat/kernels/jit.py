"""How kernels are compiled for the CPU: flags, and what is kept of them between processes.

Numba's own cache looks at the time of the file of the function that it caches, and not at the
functions that this one calls. Here a kernel is kept under the hash of all modules that it is made
of, see `sources`: edit one formula, and what may use it is compiled again, and nothing else.
"""

from __future__ import annotations

import functools
import pickle
import sys
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any

import llvmlite
import numba
from numba.core.caching import CompileResultCacheImpl
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from usdsplat.kernels import signatures, sources, store
from usdsplat.kernels.compiling import compiled

config: Any = numba.core.config

FLAGS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "nsz"}}
"""No division checks, multiply-add contracted. Nothing is re-associated and NaN keeps its meaning,
so a loop gives the same bits whether LLVM vectorises it or not."""
ONLY: set[str] = set()
"""Names below KEPT: all that this process keeps; everything where there is none."""
COMING: dict[str, Future[Any]] = {}
"""By key: what another process compiles or is going to compile, see `ahead.compiling`."""
KEPT = "usdsplat.kernels."
"""Kernels of modules that begin so are kept; those that tests make are not."""


@functools.cache
def versions() -> str:
    """What compiles, and how it was told to, as text."""
    tools = f"python {sys.version_info[:2]} numba {numba.__version__} llvm {llvmlite.__version__}"
    return f"{tools} opt {int(config.OPT)} bounds {config.BOUNDSCHECK} svml {config.USING_SVML}"


class KernelCache:
    """What Numba asks for compiled forms of one kernel, and gives those it has made."""

    cache_path = None

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return what is kept of a signature, or None."""
        key = self._key(signature, context.codegen())
        data = store.load(key)
        coming = COMING.get(key) if data is None else None
        if coming is not None:
            with compiled(self._function.__name__):
                wait([coming])
            data = store.load(key)
        if data is None:
            return None
        context.refresh()
        try:
            return CompileResult._rebuild(context, *pickle.loads(data))
        except Exception:  # whatever is wrong with it, it can be compiled
            return None

    def save_overload(self, signature: Any, made: Any) -> None:
        """Keep what was compiled."""
        name = f"{self._function.__module__}.{self._function.__qualname__}"
        if ONLY and name.removeprefix(KEPT) not in ONLY:
            return
        is_plain: Any = CompileResultCacheImpl.check_cachable
        if is_plain(None, made):
            store.save(self._key(signature, made.library.codegen), dumps(made._reduce()))

    def enable(self) -> None:
        """Numba's word for what is always so."""

    disable = flush = enable

    def _key(self, signature: Any, codegen: Any) -> str:
        types = signature.args if hasattr(signature, "args") else signature
        return cpu_key(self._function, signatures.encode(types), codegen.magic_tuple())


def cpu_key(function: Callable[..., Any], types: str, processor: Any) -> str:
    """Return the key of a kernel for the CPU, with the types of its arguments as `signatures` has
    them and the processor as LLVM names it."""
    made_of = sources.digest(function.__module__)
    name = f"{function.__module__}.{function.__qualname__}"
    return store.key_of("cpu", name, types, repr(processor), versions(), made_of)


def _compile(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """njit, kept between processes."""
    kernel = numba.njit(**FLAGS, **options)(function)
    if not config.DISABLE_JIT and function.__module__.startswith(KEPT):
        kernel._cache = KernelCache(function)
    return kernel


def scalar(function: Callable[..., Any]) -> Any:
    """Mathematics of one element, inlined into the loops that call it so that they vectorise."""
    return numba.njit(forceinline=True, **FLAGS)(function)


def exact(function: Callable[..., Any]) -> Any:
    """`scalar` without contraction: the same bits in every loop that it is inlined into, and
    whether the loop was compiled by this process or loaded; for what decisions hang on."""
    return numba.njit(forceinline=True, error_model="numpy", fastmath={"nsz"})(function)


def routine(function: Callable[..., Any]) -> Any:
    """What loops call; `lanes.apart` keeps it from being inlined into them."""
    return numba.njit(**FLAGS)(function)


def serial(function: Callable[..., Any]) -> Any:
    """A loop for one thread. It does not hold the GIL."""
    return _compile(function, {"nogil": True})


def parallel(function: Callable[..., Any]) -> Any:
    """A loop for all threads of the device; `prange` marks what may run at once."""
    return _compile(function, {"nogil": True, "parallel": True})
