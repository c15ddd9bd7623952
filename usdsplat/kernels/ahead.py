"""Compile kernels before they are needed, in several processes.

A task is one kernel with one combination of argument types, from the tables of `signatures`. Each
process writes its results to the `store`.
"""

from __future__ import annotations

import functools
import importlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usdsplat.core.errors import BackendError
from usdsplat.core.progress import Progress, silent
from usdsplat.kernels import signatures, sources, store
from usdsplat.kernels.cuda import support
from usdsplat.kernels.cuda.support import CUB, SORT, SUM, Capability

HERE = "usdsplat.kernels"


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One kernel with one combination of argument types."""

    device: str
    capability: Capability | None
    """Compute capability (major, minor) of the GPU; None for the CPU."""
    name: str
    types: str


def tasks(device: str, capability: Capability | None = None) -> list[Task]:
    """Return the tasks of all kernels that a device launches.

    Args:
        device: "cpu" or "cuda".
        capability: Compute capability of the GPU, such as (9, 0).
    """
    named = signatures.table(device)
    if device == "cuda" and capability == support.capability():
        named += CUB
    return [Task(device=device, capability=capability, name=n, types=t) for n, t in named]


def note(device: str, capability: Capability | None) -> None:
    """Record in the store that all tasks of a device are compiled."""
    store.save(_note(device, capability), b"")


def is_noted(device: str, capability: Capability | None) -> bool:
    """Return whether all tasks of a device are compiled with the present sources and versions.

    It takes a few milliseconds and does not import Numba.
    """
    return store.load(_note(device, capability)) is not None


def compile_task(task: Task) -> None:
    """Compile one kernel and store it, unless the store has it already.

    Raises:
        Exception: Whatever the compiler raises.
    """
    if task.device == "cpu":
        dispatcher, types = _cpu_form(task.name, task.types)
        dispatcher.compile(types)
        return
    assert task.capability is not None
    if task.name in (SORT, SUM):
        from usdsplat.kernels.cuda import cub

        cub.build(task.name, task.types)
        return
    from usdsplat.kernels.cuda import jit

    types = signatures.decode(task.types)
    _load_cuda_kernel(task.name)
    if store.load(jit.KERNELS[task.name]._cache.key(types, task.capability)) is None:
        jit.assemble(task.name, types, task.capability)


def compile_all(
    tasks: Sequence[Task], *, jobs: int | None = None, progress: Progress = silent
) -> list[tuple[Task, str]]:
    """Compile tasks in several processes.

    Args:
        jobs: Number of processes; None for one per core.

    Returns:
        The tasks that failed or could not be stored, each with one line that says why.

    Raises:
        BackendError: If one of the processes is killed, for example for lack of memory.
    """
    failed, done = [], 0
    for device in ("cpu", "cuda"):
        some = [task for task in tasks if task.device == device]
        if not some:
            continue
        with _workers(device, len(some), jobs) as pool:
            pending = {_submit(pool, task): task for task in some}
            for future in as_completed(pending):
                try:
                    problem = future.result()
                except BrokenProcessPool as error:
                    found = "a process that was killed"
                    expected = "more memory, or fewer --jobs"
                    raise BackendError("compile", found, expected) from error
                if problem:
                    failed.append((pending[future], problem))
                done += 1
                progress.step("compiling kernels", done, len(tasks))
    return failed


@contextmanager
def compiling(kernels: Sequence[tuple[str, str]], *, jobs: int | None = None) -> Iterator[None]:
    """Compile CPU kernels in other processes while the context lasts.

    A launch of one of them waits until it is compiled. Kernels that are not compiled at the end are
    dropped. If the store cannot be written, nothing is started.

    Args:
        kernels: (kernel, argument types), in the order in which they will be needed.
        jobs: Number of processes; None for one per core.
    """
    from usdsplat.kernels import jit

    missing = _missing(kernels)
    if not missing or not store.save(store.key_of("compile"), b""):
        yield
        return
    with _workers("cpu", len(missing), jobs) as pool:
        coming = {key: _submit(pool, task) for key, task in missing.items()}
        jit.COMING.update(coming)
        try:
            yield
        finally:
            for key in coming:
                del jit.COMING[key]


# --- private -------------------------------------------------------------------------------


def _note(device: str, capability: Capability | None) -> str:
    modules = {_module_of(name) for name, _ in signatures.table(device)}
    made_of = [sources.digest(each) for each in sorted(modules)]
    return store.key_of("all", device, repr(capability), support.versions(), *made_of)


def _module_of(name: str) -> str:
    """Return the full name of the module that holds a kernel of a table."""
    return f"{HERE}.{name.partition('(')[0].rpartition('.')[0]}"


def _missing(kernels: Sequence[tuple[str, str]]) -> dict[str, Task]:
    """Return the tasks of those CPU kernels that are not in the store, by store key."""
    from numba.core.registry import cpu_target

    from usdsplat.kernels.jit import cpu_key

    processor = cpu_target.target_context.codegen().magic_tuple()
    missing = {}
    for name, types in kernels:
        dispatcher, form = _cpu_form(name, types)
        key = cpu_key(dispatcher.py_func, signatures.encode(form), processor)
        if not store.has(key):
            missing[key] = Task(device="cpu", capability=None, name=name, types=types)
    return missing


@contextmanager
def _workers(device: str, tasks: int, jobs: int | None) -> Iterator[ProcessPoolExecutor]:
    """Start processes that compile for a device and write to this process's store. They are
    terminated at the end of the context, even in the middle of a task."""
    count = min(jobs or os.cpu_count() or 1, tasks)
    if sys.platform == "win32":
        count = min(count, 61)  # Windows cannot wait for more
    context = multiprocessing.get_context("spawn")  # Numba's threads do not survive a fork
    pool = ProcessPoolExecutor(count, context, _begin, (device, str(store.folder())))
    try:
        yield pool
    finally:
        processes = list((pool._processes or {}).values())
        pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()


def _submit(pool: ProcessPoolExecutor, task: Task) -> Future[str]:
    """Submit a task, which may start a process.

    The process inherits that SIGINT is blocked: after Ctrl-C in a terminal, it prints no traceback
    even while it starts.
    """
    if not hasattr(signal, "pthread_sigmask"):
        return pool.submit(_problem_of, task)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return pool.submit(_problem_of, task)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(device: str, folder: str) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process decides
    threading.Thread(target=_end_with_parent, name="usdsplat parent", daemon=True).start()
    store.use(Path(folder))
    if device == "cpu":
        from usdsplat.kernels.unloaded import compile_only

        compile_only()


def _end_with_parent() -> None:
    """End this process when the parent has died, which it may before it can end this one."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _problem_of(task: Task) -> str:
    """Compile a task and return what went wrong; "" if nothing did."""
    try:
        compile_task(task)
    except Exception as error:
        text = f"{type(error).__name__}: {error}".strip()
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        telling = [line for line in lines if "rror" in line]
        return " | ".join(dict.fromkeys([lines[0], *telling]))[:400]
    return store.refusal()


def _cpu_form(name: str, types: str) -> tuple[Any, tuple[Any, ...]]:
    """Return the function that Numba compiles for the CPU, and its argument types."""
    from usdsplat.kernels.launch import Kernel, flattened

    found, form = _host_kernel(name), signatures.decode(types)
    if not isinstance(found, Kernel):
        return found, form
    from numba.core.types import Tuple

    shape, flat = flattened(form[-1])
    return found.cpu(shape), (*form[:-1], Tuple(flat))


@functools.cache
def _host_kernel(name: str) -> Any:
    module, _, function = name.rpartition(".")
    return getattr(importlib.import_module(f"{HERE}.{module}"), function)


def _load_cuda_kernel(name: str) -> None:
    """Import the module that defines a GPU kernel, or make the GPU's loop over its items."""
    from usdsplat.kernels.cuda.loops import gpu_loop

    if name.startswith("cuda."):
        importlib.import_module(_module_of(name))
    else:
        gpu_loop(_host_kernel(name))
