"""Functions of the CPU with others in the place of some that they call."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

from numba import cuda


def rebound(function: Callable[..., Any], **names: Any) -> Any:
    """`function` for kernels of CUDA, with what it knows by these names replaced."""
    source = getattr(function, "py_func", function)
    known = {**source.__globals__, **names}
    return cuda.jit(device=True)(FunctionType(source.__code__, known, source.__name__))
