"""A GPU replacement that assembles each launch to machine code, with its actual types, and does not
run it.

It needs numba-cuda and NVIDIA's compiler and assembler, but neither GPU nor driver.
"""

from __future__ import annotations

import functools
import importlib.util
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

CAPABILITY = (9, 0)
REQUIRED = "USDSPLAT_REQUIRE_NUMBA_CUDA"
"""Environment variable by which tests fail, rather than skip, where it cannot be done."""


@functools.cache
def obstacle() -> str | None:
    """What is missing to compile for CUDA here, or None."""
    from usdsplat.kernels.cuda.support import is_simulated

    if is_simulated():
        return "Numba simulates, and compiles nothing"
    if importlib.util.find_spec("numba_cuda") is None:
        return "no package numba-cuda to compile with"
    try:
        from numba import cuda

        cuda.compile(_nothing, (), device=False, cc=CAPABILITY, abi="numba")
    except Exception as error:
        return f"cannot compile for CUDA here: {type(error).__name__} {error}".split("\n")[0][:200]
    return None


def require() -> None:
    """Skip the test visibly where it cannot be done, or fail it where it must be."""
    missing = obstacle()
    if missing and os.environ.get(REQUIRED):
        pytest.fail(missing)
    if missing:
        pytest.skip(missing)


def _nothing() -> None:
    return None


class _Nothing:
    """Sorting and summing, of which nothing is to be seen on paper."""

    def sort_pairs(self, *args: Any, **options: Any) -> None:
        """Sort nothing."""

    def running_sum(self, *args: Any) -> None:
        """Sum nothing."""


def device() -> Any:
    """A `CudaDevice` whose arrays are the host's."""
    from usdsplat.kernels.cuda.device import CudaDevice, form_of

    class Paper(CudaDevice):
        def __init__(self) -> None:
            self.stream = 0
            self._kept, self._lent = {}, {}

        primitives = _Nothing()

        def resident(self, shape: Any, dtype: Any) -> Any:
            return np.zeros(shape, dtype)

        def fetch(self, array: Any) -> Any:
            return array

        def number(self, array: Any, place: int) -> int:
            return int(array[place])

        def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
            form = form_of(kernel)
            assert form is not None, "the CPU runs it"
            return form(self, *args)

    return Paper()


@contextmanager
def compiling() -> Iterator[dict[str, bytes]]:
    """While the context lasts, a launch of a kernel of CUDA adds its machine code, by name and
    types, and nothing runs. What is not in the table of launches fails."""
    from usdsplat.kernels import signatures, store
    from usdsplat.kernels.cuda import jit
    from usdsplat.kernels.cuda.launch import Kernel

    made: dict[str, bytes] = {}
    known = {f"{name} {types}" for name, types in signatures.table("cuda")}
    names = {id(each): name for name, each in jit.KERNELS.items()}

    def launcher(self: Any, shape: Any) -> Callable[..., None]:
        def launch(*args: Any) -> None:
            dispatcher = self.dispatcher
            given = tuple(dispatcher.typeof_pyval(each) for each in args)
            name = names.get(id(dispatcher)) or _name_of(dispatcher)
            line = f"{name} {signatures.encode(given)}"
            if line not in made:
                key = jit.KERNELS[name]._cache.key(given, CAPABILITY)
                made[line] = store.load(key) or jit.assemble(name, given, CAPABILITY)
                is_ours = name != "cuda.sim.lists._clear"  # which one test gives what it likes
                assert line in known or not is_ours, f"the table of launches lacks: {line}"

        return launch

    def _name_of(kernel: Any) -> str:
        names.update({id(each): name for name, each in jit.KERNELS.items()})
        return names[id(kernel)]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Kernel, "__getitem__", launcher)
        yield made
