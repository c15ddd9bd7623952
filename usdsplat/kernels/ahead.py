"""Everything compiled before it is needed: what the tables of launched kernels name.

What a device needs is a list of tasks, each of which any process can do: it leaves its result with
the other kept kernels, see `store`.
"""

from __future__ import annotations

import functools
import importlib
import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usdsplat.core.progress import Progress, silent
from usdsplat.kernels import signatures, sources, store
from usdsplat.kernels.cuda import support

HERE = "usdsplat.kernels"
SORT, SUM = "sort", "sum"
CUB = (
    (SORT, "u2 i4"), (SORT, "u4 i4"), (SUM, "i4 i4"), (SUM, "i8 i8"),
)  # fmt: skip
"""What is sorted and summed on a GPU: the algorithm, and the types of keys and values, or of what
comes in and goes out. Built on that GPU only, see `cuda.cub`."""

Capability = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One kernel with one set of types."""

    device: str
    capability: Capability | None
    """Compute capability (major, minor) of the GPU; None for the CPU."""
    name: str
    types: str


def tasks(device: str, capability: Capability | None = None) -> list[Task]:
    """Return all that a device runs.

    Args:
        device: "cpu" or "cuda".
        capability: Of the GPU, such as (9, 0).
    """
    named = signatures.table(device)
    if device == "cuda" and capability == support.capability():
        named += CUB
    return [Task(device=device, capability=capability, name=n, types=t) for n, t in named]


def note(device: str, capability: Capability | None) -> None:
    """Remember that all tasks of a device are done."""
    store.save(_note(device, capability), b"")


def is_noted(device: str, capability: Capability | None) -> bool:
    """Return whether all tasks of a device were done, of the sources and versions that are here
    now. It takes a few milliseconds, and nothing of Numba's."""
    return store.load(_note(device, capability)) is not None


def compile_task(task: Task) -> None:
    """Compile one kernel and keep it, unless it is kept.

    Raises:
        Exception: Whatever the compiler raises.
    """
    if task.device == "cpu":
        _cpu_kernel(task.name).compile(signatures.decode(task.types))
        return
    assert task.capability is not None
    if task.name in (SORT, SUM):
        from usdsplat.kernels.cuda import cub

        cub.build(task.name, task.types)
        return
    from usdsplat.kernels.cuda import jit

    types = signatures.decode(task.types)
    _load_cuda_kernel(task.name)
    if not store.has(jit.KERNELS[task.name]._cache.key(types, task.capability)):
        jit.assemble(task.name, types, task.capability)


def missing(tasks: Sequence[Task]) -> list[Task]:
    """Return those tasks for the CPU of which nothing is kept."""
    from numba.core.registry import cpu_target

    from usdsplat.kernels.jit import cpu_key

    processor = cpu_target.target_context.codegen().magic_tuple()
    return [
        task
        for task in tasks
        if not store.has(cpu_key(_cpu_kernel(task.name).py_func, task.types, processor))
    ]


def compile_all(
    tasks: Sequence[Task], *, jobs: int | None = None, progress: Progress = silent
) -> list[tuple[Task, str]]:
    """Compile in several processes.

    Args:
        jobs: How many; None for one for each core.

    Returns:
        The tasks that failed, each with the first line of the reason.
    """
    jobs = min(jobs or os.cpu_count() or 1, max(1, len(tasks)))
    context = multiprocessing.get_context("spawn")  # Numba's threads do not survive a fork
    failed = []
    with ProcessPoolExecutor(
        jobs, context, initializer=_keep_in, initargs=(str(store.folder()),)
    ) as pool:
        pending = {pool.submit(_problem_of, task): task for task in tasks}
        for done, future in enumerate(as_completed(pending)):
            problem = future.result()
            if problem:
                failed.append((pending[future], problem))
            progress.step("compiling kernels", done + 1, len(tasks))
    return failed


@contextmanager
def compiling(tasks: Sequence[Task], *, jobs: int) -> Iterator[None]:
    """While the context lasts, compile in other processes, the last task first: who needs the first
    ones now compiles those meanwhile. What is not done in the end is left out.

    Args:
        jobs: How many processes; none for 0.
    """
    if jobs < 1 or not tasks:
        yield
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, context, initializer=_keep_in, initargs=(str(store.folder()),))
    try:
        for task in reversed(tasks):
            pool.submit(_problem_of, task)
        yield
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


# --- private -------------------------------------------------------------------------------


def _note(device: str, capability: Capability | None) -> str:
    modules = {_module_of(name) for name, _ in signatures.table(device)}
    made_of = [sources.digest(each) for each in sorted(modules)]
    return store.key_of("all", device, repr(capability), support.versions(), *made_of)


def _module_of(name: str) -> str:
    """Return the full name of the module that holds a kernel of a table."""
    return f"{HERE}.{name.partition('(')[0].rpartition('.')[0]}"


def _keep_in(folder: str) -> None:
    store.use(Path(folder))


def _problem_of(task: Task) -> str:
    """Compile, and say what went wrong."""
    try:
        compile_task(task)
    except Exception as error:
        text = f"{type(error).__name__}: {error}".strip()
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        telling = [line for line in lines if "rror" in line]
        return " | ".join(dict.fromkeys([lines[0], *telling]))[:400]
    return ""


@functools.cache
def _cpu_kernel(name: str) -> Any:
    module, _, function = name.rpartition(".")
    return getattr(importlib.import_module(f"{HERE}.{module}"), function)


def _load_cuda_kernel(name: str) -> None:
    """Import what makes a kernel of the GPU: its module, or that of the CPU's from which it is
    derived."""
    from usdsplat.kernels.cuda.device import form_of

    if name.startswith("cuda."):
        importlib.import_module(_module_of(name))
    else:
        made: Callable[..., Any] | None = form_of(_cpu_kernel(name))
        assert made is not None, name
