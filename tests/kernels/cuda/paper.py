"""A GPU on paper: a launch is compiled to PTX, with the types that it really has, and not run.

It needs numba-cuda and NVIDIA's NVVM, and no GPU.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

CAPABILITY = (9, 0)


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


def _nothing() -> None:
    return None


class _Gpu:
    """What kernels are compiled for."""

    compute_capability = CAPABILITY


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

        def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
            form = form_of(kernel)
            assert form is not None, "the CPU runs it"
            return form(self, *args)

    return Paper()


@contextmanager
def compiling() -> Iterator[dict[str, str]]:
    """While the context lasts, a launch of a kernel of CUDA adds its PTX, by name and types."""
    from numba import cuda, types
    from numba.cuda import dispatcher

    made: dict[str, str] = {}

    def launcher(self: Any, shape: Any) -> Callable[..., None]:
        def launch(*args: Any) -> None:
            given = tuple(self.typeof_pyval(each) for each in args)
            name = f"{self.py_func.__module__}.{self.py_func.__name__}{given}"
            if name not in made:
                made[name] = cuda.compile(
                    self.py_func, types.void(*given), device=False, cc=CAPABILITY, abi="numba"
                )[0]

        return launch

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dispatcher.CUDADispatcher, "__getitem__", launcher)
        patch.setattr(dispatcher, "get_current_device", _Gpu)
        yield made
