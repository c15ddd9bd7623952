"""Operations of a single simulated lane: bits, local memory, atomics; and sorting and summing."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np

ALL = 0xFFFFFFFF


def within(value: Any) -> Any:
    """A kernel's argument: NumPy's arrays, structured ones with their fields as attributes."""
    if isinstance(value, tuple):
        return tuple(within(each) for each in value)
    value = getattr(value, "_ary", value)
    if isinstance(value, np.ndarray) and value.dtype.names:
        return value.view(np.recarray)
    return value


def popc(x: Any) -> int:
    return (int(x) & (2**64 - 1 if np.asarray(x).itemsize == 8 else ALL)).bit_count()


def clz(x: Any) -> int:
    bits = 8 * np.asarray(x).itemsize
    return bits - (int(x) & (2**bits - 1)).bit_length()


def ffs(x: Any) -> int:
    return (int(x) & -int(x)).bit_length()


def selp(which: Any, a: Any, b: Any) -> Any:
    return a if which else b


def fma(a: Any, b: Any, c: Any) -> Any:
    """a b + c; of float32 rounded once, but for what float64 rounds before."""
    result = np.result_type(a, b, c).type
    return result(np.float64(a) * np.float64(b) + np.float64(c))


def poisoned(shape: Any, dtype: Any) -> Any:
    out: np.ndarray[Any, Any] = np.empty(shape, dtype)
    out.reshape(-1).view(np.uint8)[...] = 0xA5
    return out


def numpy_type(dtype: Any) -> Any:
    if isinstance(dtype, type | np.dtype):
        return np.dtype(dtype)
    from numba.np.numpy_support import as_dtype

    return as_dtype(dtype)


def _bits_as(source: str, target: str) -> Callable[[Any], Any]:
    return lambda x: np.asarray(x, source).view(target)[()]


def _rounded(kind: type, combine: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    return lambda a, b: combine(kind(a), kind(b))


LIBDEVICE = ModuleType("numba.cuda.libdevice")
"""Those functions of NVIDIA's libdevice that kernels call."""
LIBDEVICE.__dict__.update(
    int_as_float=_bits_as("i4", "f4"),
    float_as_int=_bits_as("f4", "i4"),
    fadd_rn=_rounded(np.float32, lambda a, b: a + b),
    fmul_rn=_rounded(np.float32, lambda a, b: a * b),
    dadd_rn=_rounded(np.float64, lambda a, b: a + b),
    dmul_rn=_rounded(np.float64, lambda a, b: a * b),
)


class Local:
    """Arrays of a lane."""

    @staticmethod
    def array(shape: Any, dtype: Any) -> Any:
        """A new one."""
        return poisoned(shape, numpy_type(dtype))


class Constant:
    """Arrays that never change."""

    @staticmethod
    def array_like(array: Any) -> Any:
        """It is as it is."""
        return array


def _atomic(result: Callable[[Any, Any], Any]) -> Callable[[Any, Any, Any], Any]:
    def change(array: Any, index: Any, value: Any) -> Any:
        old = array[index]
        array[index] = result(old, value)
        return old

    return change


class Atomic:
    """Lanes run one after the other, so everything is atomic."""

    add = staticmethod(_atomic(lambda old, value: old + old.dtype.type(value)))
    sub = staticmethod(_atomic(lambda old, value: old - old.dtype.type(value)))
    max = staticmethod(_atomic(max))
    min = staticmethod(_atomic(min))
    and_ = staticmethod(_atomic(lambda old, value: old & old.dtype.type(value)))
    or_ = staticmethod(_atomic(lambda old, value: old | old.dtype.type(value)))
    xor = staticmethod(_atomic(lambda old, value: old ^ old.dtype.type(value)))
    exch = staticmethod(_atomic(lambda old, value: value))

    @staticmethod
    def cas(array: Any, index: Any, expected: Any, value: Any) -> Any:
        """Compare and swap."""
        old = array[index]
        if old == expected:
            array[index] = value
        return old


class Primitives:
    """As `usdsplat.kernels.cuda.primitives.Primitives`, by NumPy."""

    def __init__(self, stream: Any) -> None:
        pass

    def sort_pairs(
        self,
        keys: Any,
        values: Any,
        sorted_keys: Any,
        sorted_values: Any,
        count: int,
        *,
        begin_bit: int = 0,
        end_bit: int | None = None,
    ) -> None:
        """Sort by the bits of float32 or of unsigned keys, stably."""
        k, v = within(keys)[:count].copy(), within(values)[:count].copy()
        bits = k.view(f"u{k.itemsize}").astype(np.uint64)
        if k.dtype.kind == "f":
            bits = np.where(bits >> 31, ~bits & ALL, bits | 0x80000000)
        end = 8 * k.itemsize if end_bit is None else end_bit
        part = (bits >> np.uint64(begin_bit)) & np.uint64((1 << (end - begin_bit)) - 1)
        order = np.argsort(part, kind="stable")
        within(sorted_keys)[:count], within(sorted_values)[:count] = k[order], v[order]

    def running_sum(self, values: Any, out: Any, count: int) -> None:
        """out[k] = values[0] + ... + values[k - 1], for k < count."""
        v = within(values)[:count].astype(within(out).dtype)
        within(out)[:count] = np.cumsum(v) - v
