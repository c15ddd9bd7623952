"""A process that compiles kernels and runs none: machine code is made of what is kept, not of more.

Numba makes everything that it compiles ready to run: each function that is inlined into others, and
the body of each parallel loop, goes through LLVM's code generator and gets entries for Python and
for C. That is a third of the time that our kernels take, and nothing is left of it in the end.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.cpu import CPUContext
from numba.core.registry import cpu_target

from usdsplat.kernels import jit, signatures


def compile_only() -> None:
    """Run nothing that Numba compiles for the CPU in the rest of this process: it would crash."""
    jit.ONLY.update(name for name, _ in signatures.table("cpu"))
    context = cpu_target.target_context
    context.codegen().__class__ = _Codegen
    context.__class__ = _Context


# --- private -------------------------------------------------------------------------------


class _Library(JITCodeLibrary):
    """LLVM code of which machine code is made when it is asked for."""

    def get_pointer_to_function(self, name: str) -> int:
        """Return what stands for a function that is nowhere; Numba asks as soon as it has one."""
        self._ensure_finalized()
        return 0

    def _finalize_specific(self) -> None:
        """Numba generates code here."""

    def _get_compiled_object(self) -> Any:
        """Return the machine code."""
        if not self._compiled:
            super(_Codegen, self._codegen)._add_module(self._final_module)
            super()._finalize_specific()
        return super()._get_compiled_object()


class _Codegen(JITCPUCodegen):
    """What makes such libraries."""

    _library_class = _Library

    def _add_module(self, module: Any) -> None:
        """Numba gives all modules to what generates code, once they are whole."""

    def set_env(self, name: str, env: Any) -> None:
        """Numba leaves the constants of a loaded function where it finds them."""


class _Context(CPUContext):
    """What gives kernels an entry for Python."""

    def create_cpython_wrapper(
        self, library: Any, fndesc: Any, env: Any, call_helper: Any, release_gil: bool = False
    ) -> None:
        """Make that entry for what is launched."""
        if f"{fndesc.modname}.{fndesc.qualname}".removeprefix(jit.KEPT) in jit.ONLY:
            super().create_cpython_wrapper(library, fndesc, env, call_helper, release_gil)

    def create_cfunc_wrapper(self, library: Any, fndesc: Any, env: Any, call_helper: Any) -> None:
        """Nobody asks for a kernel's address."""
