"""Simulated GPU with warps: CUDA kernels run as Python code, lane after lane.

Numba's own simulator has no warp primitives, starts a Python thread for each CUDA thread, and does
not detect threads that wait at different barriers. Here a lane is a greenlet that runs until it has
to wait for others. A launch is therefore serial and repeatable, and a deadlock is an error. Shared
and local arrays are initialized with invalid values, because they are undefined on a GPU.

Numbers are NumPy's: float32 times a Python float stays float32, and integers keep their width,
whereas Numba widens them. Types are checked by compiling, see `test_compiling`.

Modules of tests run here in a separate pytest process, see `run_simulated`:

    NUMBA_ENABLE_CUDASIM=1 NUMBA_DISABLE_JIT=1 pytest -p tests.kernels.cuda.simulator <module>
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import types as python_types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .simulated_lane import (
    ALL,
    LIBDEVICE,
    Atomic,
    Constant,
    Local,
    Primitives,
    clz,
    ffs,
    fma,
    numpy_type,
    poisoned,
    popc,
    selp,
    within,
)

ROOT = Path(__file__).resolve().parents[3]
WARP = 32
THREADS, BLOCKS = 8, 2
"""Of a launch over items, which takes any number."""


def run_simulated(*tests: str) -> None:
    """Run modules of tests in a process with this simulator, and fail with what it prints.

    tests: As pytest takes them, relative to the repository.
    """
    environment = dict(
        os.environ,
        NUMBA_ENABLE_CUDASIM="1",
        NUMBA_DISABLE_JIT="1",
        PYTHONPATH=os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
    )
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "tests.kernels.cuda.simulator"]
    done = subprocess.run(
        [*command, *tests], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]


def pytest_configure(config: Any) -> None:
    """pytest's hook, for `-p tests.kernels.cuda.simulator`."""
    install()


def install() -> None:
    """Put the simulator in the place of Numba's; before any kernel of CUDA is imported."""
    from numba import cuda

    from usdsplat.kernels.cuda.support import is_simulated

    assert is_simulated(), "NUMBA_ENABLE_CUDASIM=1 must be set before Numba is imported"
    assert "usdsplat.kernels.cuda.device" not in sys.modules, "too late: kernels were decorated"
    cuda.jit = _jit
    cuda.warpsize = WARP
    cuda.local, cuda.shared, cuda.const = Local, _Shared, Constant
    cuda.atomic = Atomic
    for function in (*_LANES, _grid, _gridsize, popc, clz, ffs, fma, selp):
        setattr(cuda, function.__name__.removeprefix("_"), function)
    cuda.brev = lambda x: int(f"{int(x) & ALL:032b}"[::-1], 2)
    for name in ("threadfence", "threadfence_block", "threadfence_system"):
        setattr(cuda, name, lambda: None)

    cuda.libdevice = sys.modules["numba.cuda.libdevice"] = LIBDEVICE
    place = "usdsplat.kernels.cuda.primitives"
    sys.modules[place] = python_types.ModuleType(place)
    sys.modules[place].Primitives = Primitives  # type: ignore[attr-defined]
    from usdsplat.kernels.cuda import loops

    loops.THREADS, loops.BLOCKS = THREADS, BLOCKS  # before others import the names
    from usdsplat.kernels.cuda import ties

    ties.MERGERS, ties.MERGING = THREADS, BLOCKS


# --- 1. launches ------------------------------------------------------------------------


class _Dim3:
    """Three numbers of a grid."""

    __slots__ = ("x", "y", "z")

    def __init__(self, x: int, y: int = 1, z: int = 1) -> None:
        self.x, self.y, self.z = x, y, z


def _dim3(value: Any, rest: int) -> _Dim3:
    numbers = tuple(value) if isinstance(value, tuple | list) else (value,)
    return _Dim3(*(int(n) for n in (*numbers, rest, rest)[:3]))


class _Lane:
    """A thread of CUDA: where it is, and what it waits for."""

    __slots__ = ("greenlet", "index", "number", "waits")

    def __init__(self, number: int, block: _Dim3, run: Callable[[Any], None]) -> None:
        from greenlet import greenlet

        self.number = number
        rest, x = divmod(number, block.x)
        z, y = divmod(rest, block.y)
        self.index = _Dim3(x, y, z)
        self.greenlet = greenlet(run)
        self.waits: _Wait | None = None


class _Wait:
    """What a lane waits with: those of `mask` (None: all of the block) at the same call."""

    __slots__ = ("answer", "kind", "mask", "value")

    def __init__(self, kind: Callable[..., Any], mask: int | None, value: Any) -> None:
        self.kind, self.mask, self.value = kind, mask, value
        self.answer: Any = None


class _Running:
    """The launch that runs now; one at a time."""

    lock = threading.Lock()
    lane: _Lane | None = None
    shared: dict[Any, Any]
    dynamic: Any


def _jit(signature: Any = None, *, device: bool = False, **options: Any) -> Any:
    """As `cuda.jit`; signatures and options of the compiler are of no use here."""
    if not isinstance(signature, python_types.FunctionType):
        return lambda function: _jit(function, device=device)
    return signature if device else _Kernel(signature)


class _Kernel:
    """A kernel that is launched as `kernel[blocks, threads, stream, shared](*args)`."""

    def __init__(self, function: Callable[..., None]) -> None:
        self.py_func, self.__name__ = function, function.__name__

    def __getitem__(self, shape: tuple[Any, ...]) -> Callable[..., None]:
        grid, block = _dim3(shape[0], 1), _dim3(shape[1], 1)
        size = int(shape[3]) if len(shape) > 3 else 0
        assert 0 < block.x * block.y * block.z <= 1024, "a block has 1 to 1024 threads"
        assert min(grid.x, grid.y, grid.z) > 0, "an empty grid cannot be launched"

        def launch(*args: Any) -> None:
            on_gpu = tuple(within(each) for each in args)
            with _Running.lock:
                for z in range(grid.z):
                    for y in range(grid.y):
                        for x in range(grid.x):
                            self._block(_Dim3(x, y, z), grid, block, size, on_gpu)

        return launch

    def _lane(self, args: tuple[Any, ...]) -> None:
        with np.errstate(all="ignore"):  # which greenlets do not inherit
            self.py_func(*args)

    def _block(
        self, at: _Dim3, grid: _Dim3, block: _Dim3, size: int, args: tuple[Any, ...]
    ) -> None:
        from numba import cuda

        cuda.blockIdx, cuda.gridDim, cuda.blockDim = at, grid, block
        _Running.shared, _Running.dynamic = {}, poisoned(size, np.dtype(np.uint8))
        count = block.x * block.y * block.z
        lanes = [_Lane(n, block, lambda _: self._lane(args)) for n in range(count)]
        alive = dict(enumerate(lanes))
        while alive:
            progress = False
            for lane in list(alive.values()):
                if lane.waits is not None and lane.waits.answer is None:
                    continue
                progress = True
                answer = lane.waits.answer[0] if lane.waits else None
                lane.waits = None
                cuda.threadIdx, cuda.laneid, _Running.lane = lane.index, lane.number % WARP, lane
                lane.greenlet.switch(answer)
                if lane.greenlet.dead:
                    del alive[lane.number]
            if not progress:
                where = {n: _said(lane.waits) for n, lane in alive.items()}
                raise RuntimeError(f"{self.__name__}: lanes wait for ever: {where}")
            _meet(alive, count)


def _said(wait: _Wait | None) -> str:
    assert wait is not None
    return wait.kind.__name__ + ("" if wait.mask is None else f" {wait.mask:#x}")


def _meet(alive: dict[int, _Lane], count: int) -> None:
    """Answer those who need wait no longer. Lanes that have returned are missed by nobody at a
    barrier of the block, and must not be in a mask."""
    for lane in alive.values():
        wait = lane.waits
        if wait is None or wait.answer is not None:
            continue
        if wait.mask is None:
            party = list(alive.values())
        else:
            first = lane.number // WARP * WARP
            numbers = [first + bit for bit in range(WARP) if wait.mask >> bit & 1]
            assert lane.number in numbers, f"{wait.kind.__name__}: a lane is not in its own mask"
            gone = [n for n in numbers if n < count and n not in alive]
            assert not gone, f"{wait.kind.__name__}: lanes {gone} of the mask have returned"
            party = [alive[n] for n in numbers if n < count]
        waits = [each.waits for each in party]
        if any(
            w is None or w.answer is not None or w.kind is not wait.kind or w.mask != wait.mask
            for w in waits
        ):
            continue
        values = {each.number % WARP if wait.mask is not None else each.number: w.value
                  for each, w in zip(party, waits, strict=True) if w}  # fmt: skip
        for each, w in zip(party, waits, strict=True):
            assert w is not None
            w.answer = (w.kind(each.number % WARP, values),)


def _wait(kind: Callable[..., Any], mask: Any, value: Any) -> Any:
    lane = _Running.lane
    assert lane is not None, "only a kernel can wait"
    lane.waits = _Wait(kind, None if mask is None else int(mask) & ALL, value)
    return lane.greenlet.parent.switch()


# --- 2. what lanes do together ----------------------------------------------------------


def _barrier(lane: int, values: dict[int, Any]) -> None:
    return None


def _count(lane: int, values: dict[int, Any]) -> int:
    return sum(1 for value in values.values() if value)


def _every(lane: int, values: dict[int, Any]) -> bool:
    return all(values.values())


def _any(lane: int, values: dict[int, Any]) -> bool:
    return any(values.values())


def _same(lane: int, values: dict[int, Any]) -> bool:
    return len({bool(value) for value in values.values()}) == 1


def _ballot(lane: int, values: dict[int, Any]) -> Any:
    return np.uint32(sum(1 << n for n, value in values.items() if value)).astype(np.int32)


def _match(lane: int, values: dict[int, Any]) -> Any:
    mine = values[lane]
    return np.uint32(sum(1 << n for n, value in values.items() if value == mine)).astype(np.int32)


def _from(lane: int, values: dict[int, Any]) -> Any:
    value, source = values[lane]
    return values[source][0] if source in values else value


def syncthreads() -> None:
    """As CUDA's, and so are those below."""
    _wait(_barrier, None, None)


def syncthreads_count(predicate: Any) -> int:
    return int(_wait(_count, None, predicate))


def syncthreads_and(predicate: Any) -> bool:
    return bool(_wait(_every, None, predicate))


def syncthreads_or(predicate: Any) -> bool:
    return bool(_wait(_any, None, predicate))


def syncwarp(mask: Any = ALL) -> None:
    _wait(_barrier, mask, None)


def ballot_sync(mask: Any, predicate: Any) -> Any:
    return _wait(_ballot, mask, predicate)


def any_sync(mask: Any, predicate: Any) -> bool:
    return bool(_wait(_any, mask, predicate))


def all_sync(mask: Any, predicate: Any) -> bool:
    return bool(_wait(_every, mask, predicate))


def eq_sync(mask: Any, predicate: Any) -> bool:
    return bool(_wait(_same, mask, predicate))


def match_any_sync(mask: Any, value: Any) -> Any:
    return _wait(_match, mask, value)


def shfl_sync(mask: Any, value: Any, source: Any) -> Any:
    return _wait(_from, mask, (value, int(source) % WARP))


def shfl_up_sync(mask: Any, value: Any, delta: Any) -> Any:
    return _wait(_from, mask, (value, _lane() - int(delta)))


def shfl_down_sync(mask: Any, value: Any, delta: Any) -> Any:
    return _wait(_from, mask, (value, _lane() + int(delta)))


def shfl_xor_sync(mask: Any, value: Any, lanes: Any) -> Any:
    return _wait(_from, mask, (value, _lane() ^ int(lanes)))


def lanemask_lt() -> Any:
    return np.uint32((1 << _lane()) - 1)


def _lane() -> int:
    assert _Running.lane is not None
    return _Running.lane.number % WARP


_LANES = (
    syncthreads, syncthreads_count, syncthreads_and, syncthreads_or, syncwarp, ballot_sync,
    any_sync, all_sync, eq_sync, match_any_sync, shfl_sync, shfl_up_sync, shfl_down_sync,
    shfl_xor_sync, lanemask_lt,
)  # fmt: skip


# --- 3. where a lane is ---------------------------------------------------------------------


def _grid(axes: int) -> Any:
    from numba import cuda

    at, block, thread = cuda.blockIdx, cuda.blockDim, cuda.threadIdx
    place = (
        at.x * block.x + thread.x, at.y * block.y + thread.y, at.z * block.z + thread.z,
    )  # fmt: skip
    return place[0] if axes == 1 else place[:axes]


def _gridsize(axes: int) -> Any:
    from numba import cuda

    grid, block = cuda.gridDim, cuda.blockDim
    size = (grid.x * block.x, grid.y * block.y, grid.z * block.z)
    return size[0] if axes == 1 else size[:axes]


class _Shared:
    """Arrays of a block."""

    @staticmethod
    def array(shape: Any, dtype: Any, alignment: int = 0) -> Any:
        """The one of the place that asks; of size 0, the block's dynamic memory."""
        kind = numpy_type(dtype)
        if shape == 0:
            whole = _Running.dynamic.size // kind.itemsize * kind.itemsize
            return _Running.dynamic[:whole].view(kind)
        frame = sys._getframe(1)
        asked = frame.f_code, frame.f_lasti
        if asked not in _Running.shared:
            _Running.shared[asked] = poisoned(shape, kind)
        return _Running.shared[asked]
