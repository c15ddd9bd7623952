"""Run kernels on one NVIDIA GPU, and keep arrays there.

Host arrays are copied to the GPU for a launch and, if the kernel may have written them, back after
it. `keep`, `move` and `resident` create arrays that stay on the GPU.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import math
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import cuda

from usdsplat.core.errors import BackendError, UsdSplatError
from usdsplat.kernels.cuda.arrays import with_views
from usdsplat.kernels.cuda.compiling import connect
from usdsplat.kernels.cuda.loops import BLOCKS, THREADS, gpu_loop, grid_of
from usdsplat.kernels.cuda.support import is_compiled, is_simulated
from usdsplat.kernels.cuda.transfers import CONSTANT, SMALL, Constants, PinnedPool, Rings
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.launch import Kernel, Reduction, rounds

if is_compiled():
    from numba.cuda.cudadrv.driver import device_to_host

connect()  # once per process, on import

HERE = "usdsplat.kernels.cuda"

TOOLS = ("numba.", "cuda.")
"""Prefixes of the modules of GPU drivers and compilers."""

PUBLISHED = 1 << 30
"""Largest total size of the copies that `publish` keeps on the GPU [byte]. A running simulation
publishes arrays in every frame, and a window keeps the frames."""

Form = Callable[..., Any]


def form_of(kernel: Callable[..., Any]) -> Form | None:
    """Return the function that a GPU runs for a kernel, or None if the CPU runs it.

    It is called with the device and the kernel's arguments, whose arrays are on the GPU.
    """
    if isinstance(kernel, Kernel):
        return functools.partial(_launch, kernel)
    name: str = getattr(kernel, "gpu", "")
    return _imported(name) if name else None


@functools.cache
def _imported(name: str) -> Form:
    module, _, function = name.rpartition(".")
    form: Form = getattr(importlib.import_module(f"{HERE}.{module}"), function)
    return form


def _launch(kernel: Kernel, device: CudaDevice, *args: Any) -> Any:
    """Run a kernel over its items; return the result of a reduction."""
    size = kernel.size(args)
    if isinstance(kernel, Reduction):
        assert isinstance(size, int)
        blocks = rounds(size)
        partial = device.borrow("partial", blocks, kernel.dtype)
        if blocks:
            gpu_loop(kernel)[min(BLOCKS, blocks), THREADS, device.stream](
                size, blocks, partial, args
            )
        return kernel.total(device.fetch(partial)[:blocks])
    count = math.prod(size) if isinstance(size, tuple) else size
    if count:
        blocks = min(BLOCKS, count) if kernel.team else grid_of(count)
        gpu_loop(kernel)[blocks, THREADS, device.stream](size, args)
    return None


class CudaDevice:
    """First GPU in CUDA's order.

    Args:
        threads: Host threads for the CPU's part, 1 to the number of cores; None for all.

    Raises:
        UsageError: If `threads` is out of range.
    """

    name = "cuda"
    remark = ""

    def __init__(self, *, threads: int | None = None) -> None:
        self._cpu = CpuDevice(threads=threads)
        self.threads = self._cpu.threads
        self.stream = cuda.stream()
        """Stream on which everything is launched, in order."""
        self._primitives: Any = None
        self._pinned, self._rings = PinnedPool(), Rings(self.stream)
        self._constants = Constants(self.stream)
        self._kept: dict[int, tuple[weakref.ref[Any], Any]] = {}
        self._published: dict[int, int] = {}
        """Host arrays whose copies `publish` keeps: id(array) -> size [byte]. The first one was
        used least recently."""
        self._lent: dict[tuple[int, str], Any] = {}

    def upload(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return `array` contiguous, aligned and read-only, as `run` reads it. Copy it only if
        needed."""
        return self._cpu.upload(array)

    def keep(self, array: npt.NDArray[Any]) -> Any:
        """Return a copy of `array` on the GPU, cached for the lifetime of `array`, which must not
        change.

        Small arrays with the same contents share their memory.
        """
        found = self._kept_copy(array)
        if found is not None:
            return found
        whole = np.require(array, requirements=["C", "A"])
        if whole.nbytes > CONSTANT or is_simulated():
            return self._remember(array, self._in(whole))
        with in_words():
            return self._remember(array, self._constants.get(whole))

    def move(self, array: npt.NDArray[Any]) -> Any:
        """Move `array` to the GPU. The caller must not use the host array afterwards."""
        return self._in(np.require(array, requirements=["C", "A"]))

    def copied(self, array: Any) -> Any:
        """Return a new array on the GPU with the contents of `array`; the caller may change it. If
        `keep` has a copy of `array`, nothing is sent from the host."""
        source = self._kept_copy(array) if isinstance(array, np.ndarray) else array
        if source is None:
            return self._in(array)
        out = self.resident(source.shape, source.dtype)
        with in_words():
            if out.size:
                out.copy_to_device(source, stream=self.stream)
        return out

    def publish(self, array: Any) -> npt.NDArray[Any]:
        """Return a GPU array on the host, see `fetch`. A later `keep` of the result costs nothing,
        as long as no more than PUBLISHED was published or used since. Neither array may change."""
        if isinstance(array, np.ndarray):
            return array
        out = self.fetch(array)
        self._remember(out, array)
        self._published[id(out)] = out.nbytes
        while sum(self._published.values()) > PUBLISHED and len(self._published) > 1:
            oldest = next(iter(self._published))
            self._published.pop(oldest)
            self._kept.pop(oldest, None)
        return out

    def empty(self, shape: int | tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
        """Return a host buffer with undefined contents."""
        return np.empty(shape, dtype)

    def resident(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        """Return a GPU buffer with undefined contents.

        Raises:
            BackendError: If the GPU has too little memory.
        """
        with in_words():
            return with_views(cuda.device_array(shape, dtype, stream=self.stream))

    def borrow(self, name: str, size: int, dtype: Any) -> Any:
        """Return a temporary GPU buffer with undefined contents, for one kernel call.

        It is reused by the next call of the same host thread, and grows. The order of the stream
        prevents conflicts.
        """
        key = threading.get_ident(), name
        found = self._lent.get(key)
        if found is None or found.size < size or found.dtype != np.dtype(dtype):
            self._lent.pop(key, None)
            found = self._lent[key] = self.resident(max(size, 1), dtype)
        return found

    def fetch(self, array: Any) -> npt.NDArray[Any]:
        """Return a GPU array on the host, or a host array unchanged."""
        if isinstance(array, np.ndarray):
            return array
        with in_words():
            out = self._pinned.take(array.shape, array.dtype)
            if out.size:
                array.copy_to_host(out, stream=self.stream)
                self.stream.synchronize()
        return out

    def number(self, array: Any, place: int) -> int:
        """Return one number of a flat GPU array. The host waits for it."""
        if is_simulated():
            return int(array[place])
        size = array.dtype.itemsize
        part = array.gpu_data.view(place * size, (place + 1) * size)
        out = np.empty(1, array.dtype)
        device_to_host(out, part, size, self.stream)
        self.stream.synchronize()
        return int(out[0])

    def run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        """Call `kernel` with host or GPU arrays and return its result.

        Raises:
            BackendError: If the GPU's driver or compiler fails.
        """
        with in_words():
            return self._run(kernel, *args)

    def _run(self, kernel: Callable[..., Any], *args: Any) -> Any:
        form, changed = form_of(kernel), kernel.writes  # type: ignore[attr-defined]
        moves = (
            _Moves(self._arrive, _is_host)
            if form
            else _Moves(lambda array, _: self.fetch(array), _is_resident)
        )
        for k in changed:
            if k < len(args):
                moves.mark(args[k])
                self._drop(args[k])
        moved = tuple(map(moves.arrive, args))
        result = form(self, *moved) if form else self._cpu.run(kernel, *moved)
        back = moves.changed()
        for original, copy in back:
            if form:
                self._out(copy, original)
            else:
                original.copy_to_device(copy, stream=self.stream)
        if back:
            self.stream.synchronize()
        return result

    @property
    def primitives(self) -> Any:
        """Sort and prefix sum of this device, a `primitives.Primitives`."""
        if self._primitives is None:
            from usdsplat.kernels.cuda.primitives import Primitives

            self._primitives = Primitives(self.stream)
        return self._primitives

    def close(self) -> None:
        """Release everything that is kept, and arrays released earlier, which Numba frees with a
        delay."""
        self._kept.clear()
        self._published.clear()
        self._lent.clear()
        self._pinned.clear()
        self._rings.clear()
        self._constants.clear()
        self._primitives = None
        if not is_simulated():
            with suppress(Exception):  # a failed GPU cannot free memory
                cuda.current_context().deallocations.clear()

    # --- private ---------------------------------------------------------------------------

    def _remember(self, array: npt.NDArray[Any], copy: Any) -> Any:
        """Cache the copy of an array for `keep`, for the lifetime of the array."""
        kept, published, key = self._kept, self._published, id(array)

        def forget(_: Any) -> None:
            kept.pop(key, None)
            published.pop(key, None)

        kept[key] = weakref.ref(array, forget), copy
        return copy

    def _kept_copy(self, array: npt.NDArray[Any]) -> Any:
        """Return the copy of an array that is kept, or None."""
        key = id(array)
        found = self._kept.get(key)
        if found is None or found[0]() is not array:
            return None
        if key in self._published:
            self._published[key] = self._published.pop(key)
        return found[1]

    def _drop(self, value: Any) -> None:
        """Drop the copies of host arrays that a kernel writes."""
        if isinstance(value, tuple):
            for each in value:
                self._drop(each)
        elif isinstance(value, np.ndarray) and value.flags.writeable:
            self._kept.pop(id(value), None)
            self._published.pop(id(value), None)

    def _arrive(self, array: npt.NDArray[Any], is_changed: bool) -> Any:
        """Return a copy of a host array for one launch, which may change it."""
        if not is_changed and (kept := self._kept_copy(array)) is not None:
            return kept
        whole = np.ascontiguousarray(array)
        if is_simulated() or whole.nbytes > SMALL:
            return self._in(whole)
        if is_changed and whole.size:
            return self._rings.put(whole)
        return self._constants.get(whole) if whole.nbytes <= CONSTANT else self._rings.put(whole)

    def _in(self, array: npt.NDArray[Any]) -> Any:
        with in_words():
            return with_views(cuda.to_device(np.ascontiguousarray(array), stream=self.stream))

    def _out(self, copy: Any, original: npt.NDArray[Any]) -> None:
        if not original.flags.writeable:
            return
        if original.flags.c_contiguous:
            copy.copy_to_host(original, stream=self.stream)
        else:
            original[...] = self.fetch(copy)


@contextmanager
def in_words() -> Iterator[None]:
    """Convert exceptions of a GPU's driver or compiler to one-line errors.

    Raises:
        BackendError: Instead of the original exception.
    """
    try:
        yield
    except UsdSplatError:
        raise
    except Exception as error:
        if not type(error).__module__.startswith(TOOLS) and "CUDA" not in str(error):
            raise
        if "OUT_OF_MEMORY" in str(error):
            expected = "fewer splats, a smaller picture, or --device cpu"
            raise BackendError("device cuda", "too little memory on the GPU", expected) from error
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        found = f"{type(error).__name__} ({lines[0] if lines else 'no reason given'})"
        raise BackendError("device cuda", found, "a GPU that works, or --device cpu") from error


def _is_host(value: Any) -> bool:
    return isinstance(value, np.ndarray)


def _is_resident(value: Any) -> bool:
    return hasattr(value, "copy_to_host")


class _Moves:
    """Copies of arrays for one call between host and GPU. Each array is copied once."""

    def __init__(
        self, move: Callable[[Any, bool], Any], is_elsewhere: Callable[[Any], bool]
    ) -> None:
        self._move, self._is_elsewhere = move, is_elsewhere
        self.made: dict[int, tuple[Any, Any]] = {}
        """id(array) -> the array and its copy."""
        self._changed: set[int] = set()

    def mark(self, value: Any) -> None:
        """Mark `value`, or tuples of values, to be copied back, because the kernel may change
        it."""
        if isinstance(value, tuple):
            for each in value:
                self.mark(each)
        elif self._is_elsewhere(value) and value.size:
            self._changed.add(id(value))

    def arrive(self, value: Any) -> Any:
        """Return `value`, or tuples of values, with all arrays replaced by copies."""
        if isinstance(value, tuple):
            return tuple(map(self.arrive, value))
        if not self._is_elsewhere(value):
            return value
        if id(value) not in self.made:
            self.made[id(value)] = value, self._move(value, id(value) in self._changed)
        return self.made[id(value)][1]

    def changed(self) -> list[tuple[Any, Any]]:
        """Return the arrays that may have been changed, with their copies."""
        return [self.made[each] for each in self.made if each in self._changed]
