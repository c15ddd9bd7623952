"""Make Numba compile kernels without loading them, in processes that only fill the store.

For every function that it compiles, Numba generates machine code and wrappers for Python and C,
also for inlined helpers and for the bodies of parallel loops. None of that is part of the stored
kernel. Skipping it reduces compile time by about a quarter.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.cpu import CPUContext
from numba.core.registry import cpu_target

from usdsplat.kernels import jit, signatures


def compile_only() -> None:
    """Change Numba for the rest of this process. Calling a compiled CPU function crashes then."""
    jit.ONLY.update(name for name, _ in signatures.table("cpu"))
    context = cpu_target.target_context
    context.codegen().__class__ = _Codegen
    context.__class__ = _Context


# --- private -------------------------------------------------------------------------------


class _Library(JITCodeLibrary):
    """A library that generates machine code only when it is stored."""

    def get_pointer_to_function(self, name: str) -> int:
        """Return a null pointer, because nothing is loaded.

        Numba calls it after each compilation.
        """
        self._ensure_finalized()
        return 0

    def _finalize_specific(self) -> None:
        """Do nothing; Numba generates machine code here."""

    def _get_compiled_object(self) -> Any:
        """Generate machine code and return it."""
        if not self._compiled:
            super(_Codegen, self._codegen)._add_module(self._final_module)
            super()._finalize_specific()
        return super()._get_compiled_object()


class _Codegen(JITCPUCodegen):
    """Numba's code generator, which makes such libraries."""

    _library_class = _Library

    def _add_module(self, module: Any) -> None:
        """Do nothing; Numba loads each finished module here."""

    def set_env(self, name: str, env: Any) -> None:
        """Do nothing; Numba writes into the memory of a loaded function here."""


class _Context(CPUContext):
    """Numba's CPU target, limited to the wrappers that are needed."""

    def create_cpython_wrapper(
        self, library: Any, fndesc: Any, env: Any, call_helper: Any, release_gil: bool = False
    ) -> None:
        """Write the wrapper for Python, only of kernels that are launched."""
        if f"{fndesc.modname}.{fndesc.qualname}".removeprefix(jit.KEPT) in jit.ONLY:
            super().create_cpython_wrapper(library, fndesc, env, call_helper, release_gil)

    def create_cfunc_wrapper(self, library: Any, fndesc: Any, env: Any, call_helper: Any) -> None:
        """Do nothing; no C code calls our kernels."""
