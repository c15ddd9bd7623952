"""Compile kernels for a GPU, and store them for later processes.

A kernel is stored as machine code. Its key contains the hash of its sources, its argument types,
the GPU's compute capability and the versions of the compilers. It can be compiled for GPUs of other
machines, because NVIDIA's compiler and assembler need no driver.
"""

from __future__ import annotations

import functools
import importlib
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba import cuda

from usdsplat.kernels import signatures, sources, store
from usdsplat.kernels.cuda.launch import Kernel
from usdsplat.kernels.cuda.support import Capability, is_compiled, versions

PREFIX = "usdsplat.kernels."
KERNELS: dict[str, Any] = {}
"""Name -> Numba's dispatcher, of all kernels in modules that were imported."""
_EXACT: set[Callable[..., Any]] = set()
"""Functions of kernels whose products are not contracted."""


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    name: str | None = None,
    made_of: tuple[str, ...] = (),
    detail: str = "",
    exact: bool = False,
    **options: Any,
) -> Any:
    """Return a kernel of a function, with our cache: a `launch.Kernel`, or the simulator's.

    Args:
        name: Unique name; None for the names of module and function.
        made_of: Further modules that the kernel depends on, besides its own and its imports.
        detail: Everything else that the kernel depends on, as text.
        exact: Round each product and each sum by itself: none is contracted to a fused
            multiply-add. The same expression then has the same bits in every kernel.
        options: Options of `cuda.jit`.
    """
    if function is None:
        return functools.partial(
            kernel, name=name, made_of=made_of, detail=detail, exact=exact, **options
        )
    own = name or f"{function.__module__.removeprefix(PREFIX)}.{function.__name__}"
    if exact and is_compiled():
        _EXACT.add(function)
        options["lto"] = False  # the linker would contract operations
        detail = f"{detail} exact"
    made = cuda.jit(function, **options)  # as a decorator with options it drops `lto`
    if is_compiled() and function.__module__.startswith(PREFIX):
        made._cache = KernelCache(
            own, (function.__module__, *made_of), f"{sorted(options.items())} {detail}"
        )
        KERNELS[own] = made
    return Kernel(made) if is_compiled() else made


def cuda_key(
    name: str, types: str, capability: Capability, modules: tuple[str, ...], options: str
) -> str:
    """Return the store key of one form of a kernel; `types` as `signatures.encode` writes them."""
    made_of = " ".join(sources.digest(each) for each in modules)
    return store.key_of("cuda", name, types, repr(capability), options, versions(), made_of)


class KernelCache:
    """The cache object that numba-cuda's dispatcher of one kernel reads from and writes to."""

    cache_path = None

    def __init__(self, name: str, modules: tuple[str, ...], options: str) -> None:
        self._name, self._modules, self._options = name, modules, options

    def key(self, types: tuple[Any, ...], capability: Capability) -> str:
        """Return the store key of one form."""
        text = signatures.encode(types)
        return cuda_key(self._name, text, capability, self._modules, self._options)

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the stored form of a signature for the GPU in use, or None."""
        from numba.cuda.dispatcher import _Kernel

        data = store.load(self.key(_types(signature), _capability_here()))
        if data is None:
            return None
        try:
            made = _Kernel._rebuild(**pickle.loads(data))
            made.bind()
        except Exception:  # any damaged form can be compiled again
            return None
        return made

    def save_overload(self, signature: Any, made: Any) -> None:
        """Store a form for the GPU in use."""
        self.save(_types(signature), _capability_here(), made)

    def save(self, types: tuple[Any, ...], capability: Capability, made: Any) -> None:
        """Store a form for a GPU of this capability: its machine code, without LLVM IR and PTX."""
        from numba.cuda.serialize import dumps

        state, library = made._reduce_states(), made._codelibrary
        small = library._reduce_states() | {"llvm_strs": [], "ptx_cache": {}}
        state["codelibrary"] = type(library)._rebuild(**small)
        store.save(self.key(types, capability), dumps(state))

    def flush(self) -> None:
        """Do nothing: numba-cuda's interface requires this method, and nothing is buffered."""


def assemble(name: str, types: tuple[Any, ...], capability: Capability) -> bytes:
    """Compile and assemble a kernel of KERNELS for any GPU, and store it.

    Args:
        types: Numba's types of its arguments.
        capability: Compute capability of the GPU, such as (9, 0).

    Returns:
        The machine code.

    Raises:
        Exception: Whatever numba-cuda or NVIDIA's tools raise, if it is not valid.
    """
    with _compiling_for(capability):
        made = _built(name, types)
        code: bytes = made._codelibrary.get_cubin().code
        KERNELS[name]._cache.save(types, capability, made)
    return code


def source_of(name: str, types: tuple[Any, ...], capability: Capability) -> str:
    """Return the PTX of a kernel of KERNELS, the input of NVIDIA's assembler."""
    with _compiling_for(capability):
        text: str = _built(name, types)._codelibrary.get_asm_str()
    return text


# --- private -------------------------------------------------------------------------------


def _without_contraction() -> None:
    """Make numba-cuda pass NVVM's option `-fma=0` for the kernels of _EXACT.

    numba-cuda has no option for that. NVVM then writes instructions with explicit rounding, which
    the assembler does not contract either; `tests/kernels/cuda/test_exact.py` reads them.
    """
    dispatcher: Any = importlib.import_module("numba.cuda.dispatcher")
    compile_cuda = dispatcher.compile_cuda

    def compile_kernel(function: Any, *args: Any, **options: Any) -> Any:
        if function in _EXACT:
            options["nvvm_options"] = {**(options.get("nvvm_options") or {}), "fma": False}
        return compile_cuda(function, *args, **options)

    dispatcher.compile_cuda = compile_kernel


if is_compiled():
    _without_contraction()  # once for each process, as a module is imported


def _built(name: str, types: tuple[Any, ...]) -> Any:
    from numba.cuda.dispatcher import _Kernel

    dispatcher = KERNELS[name]
    return _Kernel(dispatcher.py_func, types, **dispatcher.targetoptions)


def _types(signature: Any) -> tuple[Any, ...]:
    return tuple(signature.args if hasattr(signature, "args") else signature)


def _capability_here() -> Capability:
    major, minor = cuda.get_current_device().compute_capability
    return int(major), int(minor)


@contextmanager
def _compiling_for(capability: Capability) -> Iterator[None]:
    """Make numba-cuda compile for this capability instead of that of the GPU in use."""
    from numba.cuda import codegen

    class Gpu:
        compute_capability = capability

    dispatcher: Any = importlib.import_module("numba.cuda.dispatcher")
    library: Any = codegen.CUDACodeLibrary
    before = dispatcher.get_current_device, library._ensure_cc
    # from Hopper on numba-cuda targets the exact architecture ("sm_90a"), as on such a GPU
    architecture = (*capability, "a" if capability >= (9, 0) else "")
    dispatcher.get_current_device = lambda: Gpu
    library._ensure_cc = lambda self, given: given or architecture
    try:
        yield
    finally:
        dispatcher.get_current_device, library._ensure_cc = before
