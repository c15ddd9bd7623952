"""Record and read the argument types of all launched kernels, the tables of
`usdsplat.kernels.signatures`.

As a plug-in of pytest, this module records the types for which kernels of either device were
compiled or loaded, and checks that kernels of the CPU write only their declared arguments. Then the
tables are made from the records, which may come from runs on several machines:

    pytest -p tests.kernels.cuda.launches --launches notes tests
    python -m tests.kernels.cuda.launches [--add] notes
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from usdsplat.kernels import signatures
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.launch import Kernel

HOST = "usdsplat.kernels."


def name_of(kernel: Callable[..., Any]) -> str:
    """Such as "sim.grid.keys"."""
    source = source_of(kernel)
    return f"{source.__module__.removeprefix(HOST)}.{source.__name__}"


def source_of(kernel: Any) -> Any:
    """The function that a kernel was made of."""
    return kernel.function if isinstance(kernel, Kernel) else getattr(kernel, "py_func", kernel)


def kernel_of(name: str) -> Callable[..., Any]:
    """The kernel of a name."""
    module, _, function = name.rpartition(".")
    found: Callable[..., Any] = getattr(importlib.import_module(HOST + module), function)
    return found


def example(text: str) -> tuple[Any, ...]:
    """Arguments of the types of a text; arrays have two entries along each axis."""
    return tuple(map(_example, signatures.decode(text)))


def _example(given: Any) -> Any:
    from numba.core import types
    from numba.np.numpy_support import as_dtype

    if isinstance(given, types.BaseTuple):
        return tuple(map(_example, given.types))
    if isinstance(given, types.Array):
        array = np.zeros((2,) * given.ndim, as_dtype(given.dtype))
        array.flags.writeable = given.mutable
        return array
    python = {"int64": int, "float64": float, "bool": bool}.get(str(given))
    return python(1) if python else as_dtype(given).type(1)


# --- the plug-in ------------------------------------------------------------------------


def pytest_addoption(parser: Any) -> None:
    """pytest's hook."""
    parser.addoption("--launches", metavar="DIR", help="where notes of launches go")


def pytest_configure(config: Any) -> None:
    """pytest's hook: compare what a kernel changed with what it is said to write."""
    run = CpuDevice.run

    def held(self: CpuDevice, kernel: Callable[..., Any], *args: Any) -> Any:
        before = {
            k: each.copy()
            for k, each in enumerate(args)
            if isinstance(each, np.ndarray) and k not in kernel.writes
        }
        result = run(self, kernel, *args)
        for k, each in before.items():
            assert each.tobytes() == args[k].tobytes(), f"{name_of(kernel)} wrote argument {k}"
        return result

    pytest.MonkeyPatch().setattr(CpuDevice, "run", held)


def pytest_sessionfinish(session: Any) -> None:
    """pytest's hook: note what there is in this process."""
    folder = session.config.getoption("--launches")
    if folder is None:
        return
    notes = {f"cpu {line}" for line in _of_the_cpu()} | {f"cuda {line}" for line in _of_the_gpu()}
    Path(folder).mkdir(parents=True, exist_ok=True)
    (Path(folder) / f"{os.uname().nodename}-{os.getpid()}.txt").write_text(
        "".join(f"{line}\n" for line in sorted(notes))
    )


def _of_the_cpu() -> set[str]:
    from usdsplat.kernels.jit import KernelCache

    found = set()
    for name, module in list(sys.modules.items()):
        if name.startswith(HOST):
            for each in vars(module).values():
                if isinstance(each, Kernel):
                    found |= set(_of_items(each))
                elif isinstance(getattr(each, "_cache", None), KernelCache):
                    found |= {f"{name_of(each)} {signatures.encode(s)}" for s in each.signatures}
    return found


def _of_items(kernel: Kernel) -> Iterator[str]:
    """Lines of the table, with tuples as they were given."""
    from numba.core.types import Tuple

    for shape, loop in kernel._loops.items():
        for *sizes, flat in loop.signatures:
            rest = iter(flat)
            args = [Tuple([next(rest) for _ in range(k)]) if k else next(rest) for k in shape]
            yield f"{name_of(kernel)} {signatures.encode([*sizes, Tuple(args)])}"


def _of_the_gpu() -> set[str]:
    jit = sys.modules.get("usdsplat.kernels.cuda.jit")
    made = {} if jit is None else jit.KERNELS
    return {f"{name} {signatures.encode(s)}" for name, each in made.items() for s in each.overloads}


def main(folder: str, *, adds: bool) -> None:
    """Make the tables of notes, or add the notes to them; that of a device of which there are none
    stays."""
    notes = {line for each in Path(folder).glob("*.txt") for line in each.read_text().splitlines()}
    for device, name in signatures.TABLES.items():
        lines = sorted(
            line.removeprefix(f"{device} ")
            for line in notes
            if line.startswith(device + " ")
            and "Literal[" not in line  # of kernels called by others
        )
        path = Path(signatures.__file__).parent / name
        if adds:
            lines = sorted({*lines, *path.read_text().splitlines()})
        if lines:
            path.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(sys.argv[-1], adds="--add" in sys.argv)
