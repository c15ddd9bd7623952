"""Launch compiled kernels at little cost for the host.

numba-cuda examines each array again at each launch, which takes longer than the small kernels.
Here, the kernel's arguments for an array are computed once for each array object.
"""

from __future__ import annotations

import functools
import threading
from typing import Any

from numba import cuda

_KNOWN = "_usdsplat_launch"
"""Attribute of a GPU array that caches its type, as text, and its kernel arguments."""


class Kernel:
    """Compiled kernel, launched as `kernel[blocks, threads, stream](*args)`.

    Arrays are numba-cuda's, on the GPU. An `int` is passed as int64, a `float` as float64, NumPy's
    numbers as their own type.

    Args:
        dispatcher: numba-cuda's dispatcher, which compiles.
    """

    def __init__(self, dispatcher: Any) -> None:
        self.dispatcher = dispatcher
        self._forms: dict[tuple[Any, ...], Any] = {}
        """Types of arguments -> function that the driver launches."""

    def __getitem__(self, shape: tuple[int, int, Any]) -> functools.partial[None]:
        return functools.partial(self._launch, *shape)

    def _launch(self, blocks: int, threads: int, stream: Any, *args: Any) -> None:
        from cuda.core import launch

        keys: list[Any] = []
        values: list[Any] = []
        _append_arguments(args, keys, values)
        key = tuple(keys)
        form = self._forms.get(key)
        if form is None:
            form = self._forms[key] = self._compiled(args)
        _enter()
        launch(_stream(int(stream.handle)), _config(int(blocks), int(threads)), form, *values)

    def _compiled(self, args: tuple[Any, ...]) -> Any:
        """Return the form for arguments of these types, compiled or loaded."""
        types = tuple(self.dispatcher.typeof_pyval(each) for each in args)
        return self.dispatcher.compile(types)._codelibrary.get_cufunc().kernel


# --- private -------------------------------------------------------------------------------


class _Thread(threading.local):
    """State of a host thread: whether it uses the GPU's context, of which a process has one."""

    is_ready = False


_THREAD = _Thread()


def _enter() -> None:
    if not _THREAD.is_ready:
        cuda.current_context()
        _THREAD.is_ready = True


def _append_arguments(args: tuple[Any, ...], keys: list[Any], values: list[Any]) -> None:
    """Append the types of arguments to `keys`, and their kernel arguments to `values`."""
    for arg in args:
        if isinstance(arg, tuple):
            keys.append(len(arg))
            _append_arguments(arg, keys, values)
        elif hasattr(arg, "gpu_data"):
            known = arg.__dict__.get(_KNOWN)
            if known is None:
                known = arg.__dict__[_KNOWN] = _array_fields(arg)
            keys.append(known[0])
            values += known[1]
        else:
            keys.append(type(arg))
            values.append(arg)


def _array_fields(array: Any) -> tuple[str, tuple[int, ...]]:
    """Return the type of an array, and its fields in the order of numba-cuda's kernel arguments:
    two unused ones, elements, bytes per element, address, shape, strides."""
    address = array.device_ctypes_pointer.value or 0
    fields = 0, 0, array.size, array.dtype.itemsize, address, *array.shape, *array.strides
    return array._numba_type_.name, tuple(int(each) for each in fields)


@functools.lru_cache(maxsize=1024)
def _config(blocks: int, threads: int) -> Any:
    from cuda.core import LaunchConfig

    return LaunchConfig(grid=blocks, block=threads)


@functools.lru_cache(maxsize=64)
def _stream(handle: int) -> Any:
    from cuda.core import Stream

    return Stream.from_handle(handle)
