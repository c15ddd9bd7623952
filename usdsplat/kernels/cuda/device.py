"""One NVIDIA GPU: what it keeps, and how kernels get there.

Arrays of the host are copied in for a launch and, where the kernel may have written them, back
after it. What stays on the GPU between launches was asked for: `keep`, `move`, `resident`.
"""

from __future__ import annotations

import importlib
import importlib.util
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt

if not hasattr(np, "row_stack"):  # NumPy 2.5 has dropped the name that numba-cuda 0.30 imports
    vars(np)["row_stack"] = np.vstack

from numba import cuda

from usdsplat.core.errors import BackendError
from usdsplat.kernels.cuda.compiling import connect
from usdsplat.kernels.cuda.derive import Underivable, counts, derive
from usdsplat.kernels.cuda.support import is_simulated
from usdsplat.kernels.cuda.written import written
from usdsplat.kernels.device import CpuDevice

connect()  # once for each process, as a module is imported

HOST = "usdsplat.kernels"
HERE = "usdsplat.kernels.cuda"
THREADS = 128
"""Of a block of a derived kernel."""
BLOCKS = 132 * 16
"""Of a derived kernel: enough to fill any GPU; loops take what is left."""

Form = Callable[..., Any]
_FORMS: dict[Callable[..., Any], Form | None] = {}
"""Kernel -> how it runs on a GPU, or None for on the CPU: a property of the sources."""


def form_of(kernel: Callable[..., Any]) -> Form | None:
    """How `kernel` runs on a GPU: called with the device, then with the kernel's arguments, its
    arrays on the GPU. None where the CPU does it."""
    if kernel not in _FORMS:
        _FORMS[kernel] = _written(kernel) or _derived(kernel)
    return _FORMS[kernel]


def _written(kernel: Callable[..., Any]) -> Form | None:
    """The function of the same name in the same place under this folder, if there is one."""
    source = getattr(kernel, "py_func", kernel)
    place = HERE + source.__module__.removeprefix(HOST)
    try:
        is_there = source.__module__.startswith(HOST) and importlib.util.find_spec(place)
    except ModuleNotFoundError:  # not even the folder that it would be in
        is_there = None
    found = getattr(importlib.import_module(place), source.__name__, None) if is_there else None
    return found if found is not None and getattr(found, "is_form", False) else None


def form(function: Form) -> Form:
    """Mark the function as what a device runs in place of the kernel of the same name."""
    function.is_form = True  # type: ignore[attr-defined]
    return function


def spread(kernel: Callable[..., Any]) -> Form:
    """The form of a kernel whose items are blocks of threads, see `derive`."""
    threads_of = cuda.jit(derive(kernel, THREADS, spread=True))

    @form
    def launch(device: CudaDevice, *args: Any) -> None:
        threads_of[BLOCKS, THREADS, device.stream](*args)

    return launch


def _derived(kernel: Callable[..., Any]) -> Form | None:
    try:
        derived = derive(kernel, THREADS)
    except Underivable:
        return None
    threads_of = cuda.jit(derived)

    def launch(device: CudaDevice, *args: Any) -> None:
        threads_of[BLOCKS, THREADS, device.stream](*args)

    def launch_and_count(device: CudaDevice, *args: Any) -> int:
        counted = device.zeros(1, np.int64)
        launch(device, *args, counted)
        return int(device.fetch(counted)[0])

    return launch_and_count if counts(derived) else launch


@cuda.jit
def _clear(out):
    for i in range(cuda.grid(1), out.shape[0], cuda.gridsize(1)):
        out[i] = 0


class CudaDevice:
    """The GPU that CUDA counts first.

    Args:
        threads: Of the host, for what the CPU does, 1 to the number of cores; None for all.

    Raises:
        UsageError: If `threads` is out of range.
    """

    name = "cuda"
    remark = ""

    def __init__(self, *, threads: int | None = None) -> None:
        self._cpu = CpuDevice(threads=threads)
        self.threads = self._cpu.threads
        self.stream = cuda.stream()
        """In whose order everything happens."""
        self._primitives: Any = None
        self._kept: dict[int, tuple[weakref.ref[Any], Any]] = {}
        self._lent: dict[tuple[int, str], Any] = {}

    def upload(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """`array` as `run` reads it: contiguous, aligned and read-only, copied only if it is
        not."""
        return self._cpu.upload(array)

    def keep(self, array: npt.NDArray[Any]) -> Any:
        """`array` on the GPU, copied there once, for as long as it lives. It must never change."""
        found = self._kept.get(id(array))
        if found is None or found[0]() is not array:
            return self._remember(array, self.move(array))
        return found[1]

    def move(self, array: npt.NDArray[Any]) -> Any:
        """A buffer of the GPU that holds what `array` does, of which the host takes its leave."""
        return self._in(np.require(array, requirements=["C", "A"]))

    def publish(self, array: Any) -> npt.NDArray[Any]:
        """`fetch`, after which to `keep` what it gives costs nothing; neither may change."""
        if isinstance(array, np.ndarray):
            return array
        out = self.fetch(array)
        self._remember(out, array)
        return out

    def empty(self, shape: int | tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
        """A buffer of the host with undefined contents."""
        return np.empty(shape, dtype)

    def resident(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        """A buffer of the GPU with undefined contents.

        Raises:
            BackendError: If it has no room for it.
        """
        with _in_room():
            return cuda.device_array(shape, dtype, stream=self.stream)

    def borrow(self, name: str, size: int, dtype: Any) -> Any:
        """A buffer of the GPU for the time of one form, with undefined contents: kept for the next
        that the same thread of the host runs, and grown. The stream orders who uses it."""
        key = threading.get_ident(), name
        found = self._lent.get(key)
        if found is None or found.size < size or found.dtype != np.dtype(dtype):
            self._lent.pop(key, None)
            found = self._lent[key] = self.resident(max(size, 1), dtype)
        return found

    def zeros(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        """A buffer of the GPU that holds zeros."""
        out = self.resident(shape, dtype)
        _clear[BLOCKS, THREADS, self.stream](out.reshape(-1).view(np.uint8))
        return out

    def fetch(self, array: Any) -> npt.NDArray[Any]:
        """What an array of the GPU holds, for the host to read; a host's array as it is."""
        if isinstance(array, np.ndarray):
            return array
        out: npt.NDArray[Any] = array.copy_to_host(stream=self.stream)
        self.stream.synchronize()
        return out

    def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        """Call `kernel` with arrays of the host or the GPU and return what it returns."""
        form, changed = form_of(kernel), written(kernel)
        moves = _Moves(self._in if form else self.fetch, _is_host if form else _is_resident)
        moved = tuple(moves.arrive(each, k in changed) for k, each in enumerate(args))
        result = form(self, *moved) if form else self._cpu.run(kernel, *moved)
        for original, copy in moves.changed():
            if form:
                self._out(copy, original)
            else:
                original.copy_to_device(copy, stream=self.stream)
        if moves.made:
            self.stream.synchronize()
        return result

    @property
    def primitives(self) -> Any:
        """What sorts and sums, a `primitives.Primitives`."""
        if self._primitives is None:
            from usdsplat.kernels.cuda.primitives import Primitives

            self._primitives = Primitives(self.stream)
        return self._primitives

    def close(self) -> None:
        """Release what it keeps, and what was let go of before: Numba frees some time later."""
        self._kept.clear()
        self._lent.clear()
        self._primitives = None
        if not is_simulated():
            cuda.current_context().deallocations.clear()

    # --- private ---------------------------------------------------------------------------

    def _remember(self, array: npt.NDArray[Any], copy: Any) -> Any:
        """Let `keep` find the copy of an array for as long as that lives."""
        kept, key = self._kept, id(array)
        kept[key] = weakref.ref(array, lambda _: kept.pop(key, None)), copy
        return copy

    def _in(self, array: npt.NDArray[Any]) -> Any:
        with _in_room():
            return cuda.to_device(np.ascontiguousarray(array), stream=self.stream)

    def _out(self, copy: Any, original: npt.NDArray[Any]) -> None:
        if not original.flags.writeable:
            return
        if original.flags.c_contiguous:
            copy.copy_to_host(original, stream=self.stream)
        else:
            original[...] = self.fetch(copy)


@contextmanager
def _in_room() -> Iterator[None]:
    """Say in a sentence that the GPU's memory is full."""
    try:
        yield
    except Exception as error:  # the driver's own class is another one where Numba simulates
        if "OUT_OF_MEMORY" not in str(error):
            raise
        expected = "fewer splats, a smaller picture, or --device cpu"
        raise BackendError("device cuda", "too little memory on the GPU", expected) from error


def _is_host(value: Any) -> bool:
    return isinstance(value, np.ndarray)


def _is_resident(value: Any) -> bool:
    return hasattr(value, "copy_to_host")


class _Moves:
    """Arrays that go to the other side for one call; the same array goes once."""

    def __init__(self, move: Callable[[Any], Any], is_elsewhere: Callable[[Any], bool]) -> None:
        self._move, self._is_elsewhere = move, is_elsewhere
        self.made: dict[int, tuple[Any, Any]] = {}
        """Identity of each that went -> it and its copy."""
        self._changed: set[int] = set()

    def arrive(self, value: Any, is_changed: bool) -> Any:
        """`value`, or tuples of values, with arrays on this side; where it may be changed, they
        are to come back."""
        if isinstance(value, tuple):
            return tuple(self.arrive(each, is_changed) for each in value)
        if not self._is_elsewhere(value):
            return value
        if is_changed:
            self._changed.add(id(value))
        if id(value) not in self.made:
            self.made[id(value)] = value, self._move(value)
        return self.made[id(value)][1]

    def changed(self) -> list[tuple[Any, Any]]:
        """Those that may have been changed, with their copies."""
        return [self.made[each] for each in self.made if each in self._changed]
