"""What kernels are launched with: the types of arguments that real work has given them.

`launches.txt` has a line for each kernel and each set of types: arrays as kind, size and axes
("f4:2"), other arguments as their type, tuples in brackets. As a plug-in of pytest this writes it,
from all that the tests launch on the CPU, and holds kernels to what they are said to write:

    pytest -p tests.kernels.cuda.launches tests/kernels tests/sim
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from usdsplat.kernels.cuda.written import written
from usdsplat.kernels.device import CpuDevice

TABLE = Path(__file__).parent / "launches.txt"
HOST = "usdsplat.kernels."
_SEEN: set[str] = set()

Values = tuple[Any, ...]


def name_of(kernel: Callable[..., Any]) -> str:
    """Such as "sim.grid.keys"."""
    source = getattr(kernel, "py_func", kernel)
    return f"{source.__module__.removeprefix(HOST)}.{source.__name__}"


def kernel_of(name: str) -> Callable[..., Any]:
    """The kernel of a name."""
    module, _, function = name.rpartition(".")
    found: Callable[..., Any] = getattr(importlib.import_module(HOST + module), function)
    return found


def described(value: Any) -> str:
    """The type of an argument."""
    if isinstance(value, tuple):
        return f"({','.join(described(each) for each in value)})"
    if isinstance(value, np.ndarray):
        assert value.dtype.names is None
        return f"{value.dtype.str[1:]}:{value.ndim}"
    return value.dtype.name if isinstance(value, np.generic) else type(value).__name__


def example(text: str) -> Any:
    """An argument of a type; arrays have two entries along each axis."""
    if text.startswith("("):
        return tuple(example(each) for each in re.findall(r"[^,()]+", text))
    if ":" in text:
        kind, axes = text.split(":")
        return np.zeros((2,) * int(axes), kind)
    plain: dict[str, Any] = {"int": 1, "float": 1.0, "bool": True}
    return plain[text] if text in plain else np.dtype(text).type(1)


def launches() -> list[tuple[str, list[str]]]:
    """Kernels' names, and types of the arguments."""
    lines = TABLE.read_text().splitlines()
    return [(line.split(" ")[0], line.split(" ")[1:]) for line in lines]


def pytest_configure(config: Any) -> None:
    """pytest's hook: begin to record."""
    run = CpuDevice.run

    def recorded(self: CpuDevice, kernel: Callable[..., Any], *args: Any) -> Any:
        _SEEN.add(" ".join([name_of(kernel), *map(described, args)]))
        before = {
            k: each.copy()
            for k, each in enumerate(args)
            if isinstance(each, np.ndarray) and k not in written(kernel)
        }
        result = run(self, kernel, *args)
        for k, each in before.items():
            assert each.tobytes() == args[k].tobytes(), f"{name_of(kernel)} wrote argument {k}"
        return result

    CpuDevice.run = recorded  # type: ignore[method-assign]


def pytest_sessionfinish(session: Any, exitstatus: int) -> None:
    """pytest's hook: write the table."""
    TABLE.write_text("\n".join(sorted(_SEEN)) + "\n")
