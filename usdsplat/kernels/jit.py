"""Compile kernels for the CPU, and store them for later processes.

Numba's own cache checks the modification time of one file, and misses edits of functions in other
files. Here the key of a kernel contains the hash of its module and of all modules that it imports,
see `sources`: after an edit, exactly the kernels that may depend on it are compiled again.
"""

from __future__ import annotations

import functools
import inspect
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
"""Numba options: no division checks, multiply-add contracted. Nothing is re-associated and NaN
keeps its meaning, so a loop gives the same bits whether LLVM vectorises it or not."""
ONLY: set[str] = set()
"""The kernels that this process may store, as names relative to KEPT; empty: all."""
COMING: dict[str, Future[Any]] = {}
"""Key -> the compilation of that kernel in another process, waiting or running, see
`ahead.compiling`."""
KEPT = "usdsplat.kernels."
"""Prefix of the modules whose kernels are stored; kernels that tests define are not."""


@functools.cache
def versions() -> str:
    """Return a text with the compiler's versions and options, as part of store keys."""
    tools = f"python {sys.version_info[:2]} numba {numba.__version__} llvm {llvmlite.__version__}"
    return f"{tools} opt {int(config.OPT)} bounds {config.BOUNDSCHECK} svml {config.USING_SVML}"


class KernelCache:
    """The cache object that Numba's dispatcher of one kernel reads from and writes to."""

    cache_path = None

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the stored form of a signature, or None; wait if another process compiles it."""
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
        except Exception:  # any damaged form can be compiled again
            return None

    def save_overload(self, signature: Any, made: Any) -> None:
        """Store a form that Numba has compiled."""
        name = f"{self._function.__module__}.{self._function.__qualname__}"
        if ONLY and name.removeprefix(KEPT) not in ONLY:
            return
        is_plain: Any = CompileResultCacheImpl.check_cachable
        if is_plain(None, made):
            store.save(self._key(signature, made.library.codegen), dumps(made._reduce()))

    def enable(self) -> None:
        """Do nothing: Numba's interface requires this method, and this cache is always enabled."""

    disable = flush = enable

    def _key(self, signature: Any, codegen: Any) -> str:
        types = signature.args if hasattr(signature, "args") else signature
        return cpu_key(self._function, signatures.encode(types), codegen.magic_tuple())


def cpu_key(function: Callable[..., Any], types: str, processor: Any) -> str:
    """Return the store key of one form of a kernel.

    Args:
        function: The kernel in plain Python.
        types: Its argument types, as `signatures.encode` writes them.
        processor: As LLVM describes it, from `codegen.magic_tuple`.
    """
    made_of = sources.digest(function.__module__)
    name = f"{function.__module__}.{function.__qualname__}"
    return store.key_of("cpu", name, types, repr(processor), versions(), made_of)


def _compile(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return numba.njit of a kernel, with our cache."""
    kernel = numba.njit(**FLAGS, **options)(function)
    if not config.DISABLE_JIT and function.__module__.startswith(KEPT):
        kernel._cache = KernelCache(function)
    return kernel


def scalar(function: Callable[..., Any]) -> Any:
    """Compile the mathematics of one element. It is inlined into the loops that call it, so that
    they vectorise."""
    return numba.njit(forceinline=True, **FLAGS)(function)


def exact(function: Callable[..., Any]) -> Any:
    """Compile as `scalar`, but without contraction, for results that decide a branch.

    The result has the same bits in every loop, and whether the loop was compiled by this process or
    loaded.
    """
    return numba.njit(forceinline=True, error_model="numpy", fastmath={"nsz"})(function)


def routine(function: Callable[..., Any]) -> Any:
    """Compile a function that loops call. `lanes.apart` prevents it from being inlined."""
    return numba.njit(**FLAGS)(function)


def serial(
    function: Callable[..., Any] | None = None, *, writes: tuple[str, ...] = (), gpu: str = ""
) -> Any:
    """Compile a loop for one thread, which does not hold the GIL. It is run by a device, or called
    by others.

    Args:
        writes: Names of the arguments that it changes.
        gpu: The function that a GPU runs instead, such as "sort.settle": function `settle` of
            module `kernels.cuda.sort`. It is called with the device and the same arguments. If
            empty, the CPU runs it for a GPU too.
    """
    if function is None:
        return functools.partial(serial, writes=writes, gpu=gpu)
    return declared(_compile(function, {"nogil": True}), function, writes, gpu)


def loop(function: Callable[..., Any], *, allocates: bool) -> Any:
    """Compile a loop for all threads of the device.

    Reference counts of arrays are omitted, because they take longer than most items. Only a loop
    that allocates arrays needs them.
    """
    return _compile(function, {"nogil": True, "parallel": True, "_nrt": allocates})


def parallel(
    function: Callable[..., Any] | None = None, *, writes: tuple[str, ...] = (), gpu: str = ""
) -> Any:
    """Compile a loop for all threads of the CPU that `launch.kernel` cannot express: over tiles, or
    in steps.

    `prange` marks what may run at the same time. For the arguments see `serial`.
    """
    if function is None:
        return functools.partial(parallel, writes=writes, gpu=gpu)
    return declared(_compile(function, {"nogil": True, "parallel": True}), function, writes, gpu)


def launcher(*, writes: tuple[str, ...] = (), gpu: str = "") -> Any:
    """Declare a host function that calls several kernels. For the arguments see `serial`."""
    return lambda function: declared(function, function, writes, gpu)


def declared(kernel: Any, function: Callable[..., Any], writes: tuple[str, ...], gpu: str) -> Any:
    """Store in a kernel which arguments it writes, by index from 0, and its form for a GPU.

    Raises:
        ValueError: If a name is not that of an argument.
    """
    names = list(inspect.signature(function).parameters)
    kernel.writes = frozenset(names.index(name) for name in writes)
    kernel.gpu = gpu
    return kernel
