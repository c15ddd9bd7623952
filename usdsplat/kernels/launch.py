"""Define kernels as functions of one item, and the loops that run them on each device.

    @kernel(over="positions", writes=("positions",))
    def advance(i, velocities, dt, positions):
        for axis in range(3):
            positions[i, axis] += dt * velocities[i, axis]

    device.run(advance, velocities, dt, positions)

The function is compiled into a parallel loop for the CPU and into a grid loop for the GPU, so there
is one implementation for both. Items are processed in any order and concurrently: no item may read
what another one writes.

After the kernels of Warp (Macklin 2022, "Warp: A High-performance Python Framework for GPU
Simulation and Graphics"). The number of items is declared once, with the kernel, instead of at each
launch.
"""

from __future__ import annotations

import functools
import inspect
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import prange
from numba.core.types import BaseTuple

from usdsplat.kernels import jit

Size = int | tuple[int, int]
"""Number of items of a launch: n, or (rows, columns)."""
ROWS = 8
"""Rows of pixels that a CPU thread takes at a time. The number is small, so that other threads can
take over from a slow one."""


GRAIN = 64
"""Minimum number of items in a chunk; a CPU thread takes 0.2 µs to fetch a chunk."""
ROUND = 1024
"""Number of items in a block of a reduction."""


@jit.scalar
def _add(a, b):
    return a + b


@jit.scalar
def _larger(a, b):
    return max(a, b)


@jit.scalar
def _either(a, b):
    return a | b


COMBINE: dict[str, tuple[Any, Any]] = {
    "sum": (np.float64, _add),
    "max": (np.float64, _larger),
    "any": (np.bool_, _either),
}
"""Reduction -> its type, whose zero is the initial value, and the function that combines two
numbers."""


Shape = tuple[int, ...]
"""Shape of an argument list, in order: 0 for a plain argument, k for a tuple of k."""


def flattened(args: Sequence[Any]) -> tuple[Shape, tuple[Any, ...]]:
    """Return the shape of arguments, or of their types, and the arguments without nested tuples.

    Numba does not pass tuples to the body of a parallel loop.
    """
    shape = tuple(len(each) if isinstance(each, tuple | BaseTuple) else 0 for each in args)
    if not any(shape):
        return shape, tuple(args)
    flat: list[Any] = []
    for each, count in zip(args, shape, strict=True):
        flat.extend(each if count else (each,))
    return shape, tuple(flat)


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockArray:
    """Private array of each block of a `block_kernel`, with undefined contents."""

    shape: int | tuple[int, ...]
    """Constant shape, in which EACH stands for the number of items of a block."""
    dtype: Any
    """NumPy's scalar type, such as np.float64."""

    def sized(self, block: int) -> int | tuple[int, ...]:
        """Return the shape for a block of that many items."""
        if isinstance(self.shape, int):
            return block if self.shape == EACH else self.shape
        return tuple(block if each == EACH else each for each in self.shape)


EACH = -1
"""Number of items of a block, in the shape of a `BlockArray`. It is larger on the CPU than on a
GPU."""


class Kernel:
    """A function of one item, or of one block of items, that devices run.

    Args:
        function: Called as function(i, *args) for each item i; as function(y, x, *args) if `axes`
            is 2; as function(first, last, *scratch, *args) for items first..last-1 if `block` is
            not 0.
        over: Name of the argument whose rows are the items, or whose rows and columns if `axes` is
            2; or which is a tuple (rows, columns). Or the names of two arguments, whose rows are
            the two axes.
        writes: Names of the arguments that it changes.
        axes: Indices of an item, 1 or 2.
        exact: On a GPU no product is contracted with a sum, in the function and all that it calls.
        team: Several lanes share an item: the function is called as function(i, lane, lanes, *args)
            for each lane 0..lanes-1. On the CPU there is one.
        grain: Minimum number of items that a CPU thread takes at a time.
        block: Items of a block on the CPU; a thread of a GPU takes one at a time. 0: no blocks.
        scratch: Private arrays of each block, at most two.

    Raises:
        TypeError: If `over` or `writes` names no argument.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        *,
        over: str | tuple[str, str],
        writes: tuple[str, ...],
        axes: int = 1,
        exact: bool = False,
        team: bool = False,
        grain: int = GRAIN,
        block: int = 0,
        scratch: tuple[BlockArray, ...] = (),
    ) -> None:
        self.__doc__, self.__module__ = function.__doc__, function.__module__
        self.__name__, self.__qualname__ = function.__name__, function.__qualname__
        self.function = function
        self._loops: dict[Shape, Any] = {}
        self.axes, self.exact, self.team = axes, exact, team
        self.grain = ROWS if team else grain
        self.block, self.scratch = block, scratch
        names = list(inspect.signature(function).parameters)
        own = (3 if team else 2 if block else axes) + len(scratch)
        places = {name: k for k, name in enumerate(names[own:])}
        lengths = (over,) if isinstance(over, str) else over
        unknown = sorted({*lengths, *writes} - set(places))
        if unknown:
            raise TypeError(f"{function.__name__}: no argument {', '.join(unknown)}")
        self._over = tuple(places[name] for name in lengths)
        self.writes = frozenset(places[name] for name in writes)
        """Indices, from 0, of the arguments that the kernel changes."""

    def __call__(self, *args: Any) -> Any:
        """Call the function, in plain Python."""
        return self.function(*args)

    def size(self, args: Sequence[Any]) -> Size:
        """Return the number of items of a launch with these arguments."""
        if self.axes == 1:
            return int(args[self._over[0]].shape[0])
        if len(self._over) == 1:
            over = args[self._over[0]]
            rows, columns = over if isinstance(over, tuple) else over.shape[:2]
        else:
            rows, columns = (args[k].shape[0] for k in self._over)
        return int(rows), int(columns)

    @functools.cached_property
    def item(self) -> Any:
        """The compiled function that both loops call."""
        return jit.scalar(self.function)

    def cpu(self, shape: Shape) -> Any:
        """Return the loop for the CPU's threads for arguments of a shape. It is called with the
        size and a flat tuple of arguments."""
        if shape not in self._loops:
            made = jit.loop(self.named(self._cpu_loop(_nest(shape))), allocates=bool(self.scratch))
            self._loops[shape] = made
        return self._loops[shape]

    def on_cpu(self, args: tuple[Any, ...]) -> Any:
        """Run all items on the CPU's threads."""
        shape, flat = flattened(args)
        return self.cpu(shape)(self.size(args), flat)

    def _cpu_loop(self, nest: Any) -> Callable[..., None]:
        if self.block:
            return _cpu_blocks(self.item, self.block, self.scratch, nest)
        item = self.item

        def items(n, args):
            for i in prange(n):
                item(i, *nest(args))

        def pixels(size, args):
            rows, columns = size
            for y in prange(rows):
                for x in range(columns):
                    item(y, x, *nest(args))

        def teams(n, args):
            for i in prange(n):
                item(i, 0, 1, *nest(args))

        if self.team:
            return teams
        return items if self.axes == 1 else pixels

    def named(self, loop: Callable[..., Any]) -> Callable[..., Any]:
        """Give a loop the name of the function, for messages and for the store."""
        loop.__module__ = self.function.__module__
        loop.__name__, loop.__qualname__ = self.function.__name__, self.function.__qualname__
        return loop


class Reduction(Kernel):
    """Kernel whose items return one number each, and whose launch returns the combined number.

    Blocks of ROUND items are reduced in order, then the results of the blocks. The result does not
    depend on the number of threads.

    Args:
        by: "sum"; "max", of non-negative numbers, 0 without items; or "any".
    """

    def __init__(
        self, function: Callable[..., Any], *, over: str, writes: tuple[str, ...], by: str
    ) -> None:
        super().__init__(function, over=over, writes=writes)
        self.dtype, self.combine = COMBINE[by]

    def _cpu_loop(self, nest: Any) -> Callable[..., None]:
        item, combine, dtype = self.item, self.combine, self.dtype

        def blocks(n, partial, args):
            for k in prange(len(partial)):
                total = dtype(0)
                for i in range(k * ROUND, min(n, (k + 1) * ROUND)):
                    total = combine(total, item(i, *nest(args)))
                partial[k] = total

        return blocks

    def on_cpu(self, args: tuple[Any, ...]) -> Any:
        """Run all items on the CPU's threads and return the combined number."""
        size = self.size(args)
        assert isinstance(size, int)
        partial = np.empty(rounds(size), self.dtype)
        shape, flat = flattened(args)
        self.cpu(shape)(size, partial, flat)
        return self.total(partial)

    def total(self, partial: npt.NDArray[Any]) -> Any:
        """Combine the numbers of all blocks."""
        if self.dtype is np.bool_:
            return bool(partial.any())
        return float(partial.sum() if self.combine is _add else partial.max(initial=0.0))


def rounds(size: int) -> int:
    """Return the number of blocks of a reduction."""
    return (size + ROUND - 1) // ROUND


def kernel(
    *,
    over: str | tuple[str, str],
    writes: tuple[str, ...],
    axes: int = 1,
    exact: bool = False,
    team: bool = False,
    grain: int = GRAIN,
) -> Callable[[Callable[..., Any]], Kernel]:
    """Make a `Kernel` of a function of one item; see there for the arguments."""
    options: dict[str, Any] = {"exact": exact, "team": team, "grain": grain}
    return functools.partial(Kernel, over=over, writes=writes, axes=axes, **options)


def reduction(
    *, over: str, by: str, writes: tuple[str, ...] = ()
) -> Callable[[Callable[..., Any]], Reduction]:
    """Make a `Reduction` of a function of one item; see there for the arguments."""
    return functools.partial(Reduction, over=over, writes=writes, by=by)


def block_kernel(
    *,
    over: str,
    writes: tuple[str, ...],
    block: int = 1024,
    scratch: tuple[BlockArray, ...] = (),
    exact: bool = False,
) -> Callable[[Callable[..., Any]], Kernel]:
    """Make a `Kernel` of a function of a block of items; see there for the arguments."""
    return functools.partial(
        Kernel, over=over, writes=writes, block=block, scratch=scratch, exact=exact
    )


def chunk_of(kernel: Kernel, size: Size, threads: int) -> int:
    """Return the number of iterations of the CPU's loop that a thread takes at a time.

    About 32 chunks for each thread keep all of them busy until the end.
    """
    if isinstance(size, tuple):
        return ROWS
    if kernel.block or isinstance(kernel, Reduction):
        return 1
    return max(kernel.grain, min(4096, size // (32 * threads)))


# --- private -------------------------------------------------------------------------------


def _nest(shape: Shape) -> Any:
    """Return the compiled function that undoes `flattened`."""

    def same(args):
        return args

    if not any(shape):
        return jit.scalar(same)
    nest, first = None, 0
    for is_tuple, counts in itertools.groupby(shape, key=bool):
        for count in counts if is_tuple else (len(list(counts)),):
            nest, first = _joined(nest, first, first + count, is_tuple), first + count
    return nest


def _joined(before: Any, first: int, end: int, is_tuple: bool) -> Any:
    """Return a function that appends arguments first..end-1 to the result of `before`, one by one
    or as a tuple."""

    def only_plain(args):
        return args[first:end]

    def only_tuple(args):
        return (args[first:end],)

    def plain(args):
        return before(args) + args[first:end]

    def as_tuple(args):
        return (*before(args), args[first:end])

    if before is None:
        return jit.scalar(only_tuple if is_tuple else only_plain)
    return jit.scalar(as_tuple if is_tuple else plain)


def _cpu_blocks(
    item: Any, block: int, scratch: tuple[BlockArray, ...], nest: Any
) -> Callable[..., None]:
    def blocks(n, args):
        for k in prange((n + block - 1) // block):
            item(k * block, min(n, (k + 1) * block), *nest(args))

    if not scratch:
        return blocks
    shape, dtype = scratch[0].sized(block), scratch[0].dtype

    def with_one(n, args):
        for k in prange((n + block - 1) // block):
            item(k * block, min(n, (k + 1) * block), np.empty(shape, dtype), *nest(args))

    if len(scratch) == 1:
        return with_one
    shape2, dtype2 = scratch[1].sized(block), scratch[1].dtype

    def with_two(n, args):
        for k in prange((n + block - 1) // block):
            one, two = np.empty(shape, dtype), np.empty(shape2, dtype2)
            item(k * block, min(n, (k + 1) * block), one, two, *nest(args))

    return with_two
