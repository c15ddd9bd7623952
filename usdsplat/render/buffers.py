"""Buffers declared by shape and type, for allocation and for the memory estimate.

A group of buffers is a class, and each buffer is an attribute of it:

    class SplatBuffers(BufferGroup):
        keys = Buffer(lambda slots: (slots,), np.float32)

`SplatBuffers.keys.nbytes(sizes)` is the size of a buffer, `group.keys(slots)` its array.
"""

from __future__ import annotations

import inspect
import math
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
import numpy.typing as npt

Shape = tuple[int, ...]
Empty = Callable[[int, Any], Any]
"""Allocate a number of elements of a type: `Device.resident`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """Numbers that shapes of buffers depend on.

    Parameters of `Buffer` shapes have the names of these fields.
    """

    slots: int = 0
    """Rows of the draw list, visible or not."""
    blocks: int = 0
    """Blocks of slots."""
    boxes: int = 0
    """Bounded blocks of the largest group."""
    visible: int = 0
    """Visible splats."""
    shown: int = 0
    """Splats that a display mode draws instead."""
    drawn: int = 0
    """Splats that are drawn: visible ones, or those that a display mode draws instead."""
    chunks: int = 0
    """Chunks of the depth order, each sorted by one thread at a time."""
    height: int = 0
    """Rows of a band [pixel]."""
    width: int = 0
    """Columns of a band [pixel]."""
    tile_rows: int = 0
    """Rows of tiles of a band."""
    tile_columns: int = 0
    """Columns of tiles of a band."""
    crossings: int = 0
    """Pairs of a splat and a row of tiles that it touches."""
    pairs: int = 0
    """Pairs of a splat and a tile that it touches."""
    rank_pairs: int = 0
    """Groups of four channels of a layer of Cryptomatte; each holds two prims."""
    triangle_pairs: int = 0
    """Pairs of a triangle and a tile that it touches."""
    light_parts: int = 0
    """AOVs of light groups."""


class Buffer:
    """Declaration of a buffer.

    Args:
        shape: Its shape as a function of some of `Sizes`, by their names.
        dtype: Type of its elements.
        touched: Shape of the part that is written, if it is smaller: pages that are never touched
            take no memory. None stands for the whole buffer.
    """

    def __init__(
        self,
        shape: Callable[..., Shape],
        dtype: npt.DTypeLike,
        *,
        touched: Callable[..., Shape] | None = None,
    ) -> None:
        self.shape, self.dtype = shape, np.dtype(dtype)
        self._touched = touched or shape
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, group: None, owner: type) -> Buffer: ...

    @overload
    def __get__(self, group: BufferGroup, owner: type) -> Memory: ...

    def __get__(self, group: BufferGroup | None, owner: type) -> Buffer | Memory:
        if group is None:
            return self
        memory = Memory(group.empty, self)
        group.__dict__[self.name] = memory  # an instance's own attribute precedes the declaration
        return memory

    def nbytes(self, sizes: Sizes) -> int:
        """Return the number of allocated bytes."""
        return self._bytes(self.shape, sizes)

    def touched_bytes(self, sizes: Sizes) -> int:
        """Return the number of written bytes."""
        return self._bytes(self._touched, sizes)

    def _bytes(self, shape: Callable[..., Shape], sizes: Sizes) -> int:
        counts = (getattr(sizes, name) for name in inspect.signature(shape).parameters)
        return self.dtype.itemsize * math.prod(shape(*counts))


class Memory:
    """Memory of one buffer, which grows and never shrinks.

    Args:
        empty: Allocates memory.
        buffer: The declaration; None for a buffer that only kernels of one device use.
    """

    def __init__(self, empty: Empty, buffer: Buffer | None = None) -> None:
        self._empty, self._buffer = empty, buffer
        self._array: Any = None
        self._none: Any = None
        """Empty array, cached because a device takes long to allocate one."""
        self.content: Any = None
        """Description of the contents, set by the caller. None after a new allocation."""

    def __call__(self, *counts: int) -> Any:
        """Return the buffer in its declared shape; its contents are undefined.

        Args:
            counts: Sizes, in the order in which the declared shape takes them.
        """
        assert self._buffer is not None  # undeclared buffers use `take`
        return self.take(self._buffer.shape(*counts), self._buffer.dtype)

    def take(self, shape: Shape, dtype: npt.DTypeLike) -> Any:
        """Return the buffer as an array of any shape; its contents are undefined."""
        size, dtype = math.prod(shape), np.dtype(dtype)
        if size == 0:
            if self._none is None or self._none.dtype != dtype:
                self._none = self._empty(0, dtype)
            return self._none.reshape(shape)
        if self._array is None or self._array.size < size or self._array.dtype != dtype:
            self._array = self.content = None  # released before more is allocated
            self._array = self._empty(size, dtype)
        return self._array[:size].reshape(shape)

    @property
    def nbytes(self) -> int:
        """Bytes that are allocated."""
        return 0 if self._array is None else int(self._array.nbytes)


class LentMemory:
    """Memory of float32 results that a caller may keep.

    It is used again as soon as no array refers to it: writing to new memory takes two to nine times
    as long, because the system has to provide each page. Memory of a GPU is not used again, because
    the caller gets copies on the host.

    Args:
        empty: Allocates memory.
    """

    def __init__(self, empty: Empty) -> None:
        self._empty = empty
        self._reuses = isinstance(empty(0, np.float32), np.ndarray)
        self._idle: list[npt.NDArray[np.float32]] = []

    def take(self, count: int) -> Any:
        """Return a flat array of `count` numbers; its contents are undefined."""
        if not self._reuses:
            return self._empty(count, np.float32)
        memory = next((each for each in self._idle if each.size >= count), None)
        if memory is None:
            self._idle.clear()  # released before more is allocated
            # Half more than needed, for a later band: pages that are never touched take no memory.
            memory = self._empty(max(1, count + count // 2), np.float32)
        else:
            self._idle = [each for each in self._idle if each is not memory]
        # A slice keeps only the array that owns its memory alive. Slices of `lent` must keep `lent`
        # alive, which is therefore made from a memoryview: no other array owns its memory.
        lent = np.frombuffer(memory.data, np.float32, count)
        weakref.finalize(lent, self._take_back, memory).atexit = False
        return lent

    def _take_back(self, memory: npt.NDArray[np.float32]) -> None:
        self._idle.append(memory)


class BufferGroup:
    """Buffers that one step of a frame uses.

    Args:
        empty: Allocates memory.
    """

    def __init__(self, empty: Empty) -> None:
        self.empty = empty

    @classmethod
    def declared(cls) -> dict[str, Buffer]:
        """Return the declarations by name."""
        return {name: each for name, each in vars(cls).items() if isinstance(each, Buffer)}

    def allocated(self) -> dict[str, int]:
        """Return the bytes of each allocated buffer, by name."""
        memories = ((name, each) for name, each in vars(self).items() if isinstance(each, Memory))
        return {name: each.nbytes for name, each in memories if each.nbytes}


class KernelBuffers(BufferGroup):
    """Buffers that kernels request by name, because only the kernels know the sizes.

    Declared names are those of the CPU's kernels. A GPU's kernels may request others.
    """

    PREFIX = ""
    """Prefix that kernels put before the declared names."""

    def get(self, name: str, shape: Shape, dtype: npt.DTypeLike) -> Any:
        """Return a buffer of this shape; its contents are undefined."""
        key = name.removeprefix(self.PREFIX).replace(" ", "_")
        declared = isinstance(getattr(type(self), key, None), Buffer)
        if not declared and key not in vars(self):
            setattr(self, key, Memory(self.empty))
        memory: Memory = getattr(self, key)
        return memory.take(shape, dtype)
