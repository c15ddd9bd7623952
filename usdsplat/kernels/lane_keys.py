"""Sort keys of sixteen pixels at once. A row is 16 int64 keys, each a depth and a place.

A key has the bits of a float64 with the value of a float32 depth. The lowest 29 bits of its
fraction are free, and hold the place: the index of the splat in its tile's list. Keys of a pixel
are therefore distinct, and keys of equal depth are in the order of their places. Depths are finite;
FAR means none.

Without compilation (NUMBA_DISABLE_JIT), rows are NumPy slices. For the rest see `lanes`.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from .jit import scalar
from .lanes import WIDTH, lanes, mask

_INT, _LONG = ir.IntType(32), ir.IntType(64)
_INTS, _LONGS = ir.VectorType(_INT, WIDTH), ir.VectorType(_LONG, WIDTH)
_FLOATS = ir.VectorType(ir.FloatType(), WIDTH)
_DOUBLES = ir.VectorType(ir.DoubleType(), WIDTH)
FAR = np.float32(3e38)
"""Depth behind everything."""
PLACE = (1 << 29) - 1
"""Bits of the place. For negative depths they are inverted, so that keys sort by place, too."""
LINE = 64
"""Size of a cache line [byte]."""
_ALIGNMENT = 8
"""Alignment of loads and stores, that of an int64 [byte]."""


def _all(number: int, kind: Any = _LONGS) -> Any:
    return ir.Constant(kind, [number] * WIDTH)


def _row(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
    """Return the address of 16 keys of an array."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), _LONGS.as_pointer())


def _spread(builder: Any, number: Any) -> Any:
    """Return 16 times the same int64."""
    nothing = ir.Constant(_LONGS, ir.Undefined)
    one = builder.insert_element(nothing, number, _INT(0))
    return builder.shuffle_vector(one, nothing, ir.Constant(_INTS, None))


def _flipped(builder: Any, key: Any) -> Any:
    """Return keys with the places of negative depths inverted."""
    sign = builder.ashr(key, _all(63))
    return builder.xor(key, builder.and_(sign, _all(PLACE)))


@intrinsic
def store_keys(typing: Any, keys: Any, at: Any, depths: Any, place: Any) -> Any:
    """Write keys[at : at + 16] of 16 depths and the same place, which is not negative."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        depth = builder.bitcast(builder.fpext(args[2], _DOUBLES), _LONGS)
        key = _flipped(builder, builder.or_(depth, _spread(builder, args[3])))
        builder.store(key, _row(context, builder, sig.args[0], *args[:2]), align=_ALIGNMENT)
        return context.get_dummy_value()

    return types.void(keys, types.uintp, lanes, types.int64), emit


@intrinsic
def order_rows(typing: Any, keys: Any, first: Any, second: Any) -> Any:
    """Write the lower of each two keys of the rows at `first` and `second` to the first row, and
    the higher to the second."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        one = _row(context, builder, sig.args[0], args[0], args[1])
        two = _row(context, builder, sig.args[0], args[0], args[2])
        a, b = (
            builder.bitcast(builder.load(each, align=_ALIGNMENT), _DOUBLES) for each in (one, two)
        )
        is_lower = builder.fcmp_ordered("<", a, b)
        for first, second, row in ((a, b, one), (b, a, two)):
            chosen = builder.bitcast(builder.select(is_lower, first, second), _LONGS)
            builder.store(chosen, row, align=_ALIGNMENT)
        return context.get_dummy_value()

    return types.void(keys, types.uintp, types.uintp), emit


@intrinsic
def depths_of(typing: Any, keys: Any, at: Any) -> Any:
    """Return the depths of keys[at : at + 16]."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        key = builder.load(_row(context, builder, sig.args[0], *args), align=_ALIGNMENT)
        depth = builder.bitcast(builder.and_(key, _all(~PLACE)), _DOUBLES)
        return builder.fptrunc(depth, _FLOATS)

    return lanes(keys, types.uintp), emit


@intrinsic
def look_up(typing: Any, keys: Any, at: Any, table: Any, stride: Any, first: Any, step: Any) -> Any:
    """Return table[place * stride + first + lane * step] for the places of keys[at : at + 16]."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        key = builder.load(_row(context, builder, sig.args[0], *args[:2]), align=_ALIGNMENT)
        place = builder.and_(_flipped(builder, key), _all(PLACE))
        lane = ir.Constant(_LONGS, list(range(WIDTH)))
        at = builder.mul(place, _spread(builder, args[3]))
        at = builder.add(at, _spread(builder, args[4]))
        at = builder.add(at, builder.mul(lane, _spread(builder, args[5])))
        data = context.make_array(sig.args[2])(context, builder, args[2]).data
        start = _spread(builder, builder.ptrtoint(data, _LONG))
        address = builder.add(start, builder.shl(at, _all(2)))
        pointers = ir.VectorType(ir.FloatType().as_pointer(), WIDTH)
        flags = ir.VectorType(ir.IntType(1), WIDTH)
        kind = ir.FunctionType(_FLOATS, [pointers, _INT, flags, _FLOATS])
        function = cgutils.get_or_insert_function(
            builder.module, kind, "llvm.masked.gather.v16f32.v16p0"
        )
        everywhere = ir.Constant(flags, [1] * WIDTH)
        nothing = ir.Constant(_FLOATS, [0.0] * WIDTH)
        places = builder.inttoptr(address, pointers)
        return builder.call(function, [places, _INT(4), everywhere, nothing])

    return lanes(keys, types.uintp, table, types.int64, types.int64, types.int64), emit


@intrinsic
def any_of(typing: Any, condition: Any) -> Any:
    """Return whether a mask is set anywhere."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        number = builder.bitcast(args[0], ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", number, ir.IntType(WIDTH)(0))

    return types.boolean(mask), emit


config: Any = numba.config
if config.DISABLE_JIT:

    def _turned(key: Any) -> Any:
        return key ^ ((key >> 63) & PLACE)

    def store_keys(keys: Any, at: Any, depths: Any, place: Any) -> None:
        key = depths.astype(np.float64).view(np.int64) | int(place)
        keys[int(at) : int(at) + WIDTH] = _turned(key)

    def order_rows(keys: Any, first: Any, second: Any) -> None:
        one, two = (slice(int(at), int(at) + WIDTH) for at in (first, second))
        floats = keys.view(np.float64)
        a, b = floats[one].copy(), floats[two].copy()
        floats[one], floats[two] = np.minimum(a, b), np.maximum(a, b)

    def depths_of(keys: Any, at: Any) -> Any:
        depth = keys[int(at) : int(at) + WIDTH] & ~PLACE
        return depth.view(np.float64).astype(np.float32)

    def look_up(keys: Any, at: Any, table: Any, stride: Any, first: Any, step: Any) -> Any:
        place = _turned(keys[int(at) : int(at) + WIDTH]) & PLACE
        return table[place * int(stride) + int(first) + np.arange(WIDTH) * int(step)]

    def any_of(condition: Any) -> bool:
        return bool(np.any(condition))


@scalar
def aligned(array, count):
    """Return a view of `count` numbers that begins at a cache line, of an array that is LINE bytes
    longer.

    Loading a row of keys that crosses two cache lines takes twice as long, and storing takes
    longer, too.
    """
    first = (-array.ctypes.data % LINE) // array.itemsize
    return array[first : first + count]


@scalar
def place_of(key):
    """Return the place of one key."""
    return (key ^ (key >> 63)) & np.int64(PLACE)


@scalar
def sort_rows(keys, count):
    """Sort each of 16 columns of the first `count` rows of keys.

    The sequence of comparisons does not depend on the keys, so that 16 columns are sorted at a
    time.

    Source: Knuth, TAOCP vol. 3, 5.2.2, algorithm M (Batcher's merge exchange).
    """
    width = np.int64(1)
    while width < count:
        width *= 2
    p = width // 2
    while p > 0:
        q, r, d = width // 2, np.int64(0), p
        while True:
            if p == 1:  # half of all comparisons are in blocks of one or two rows
                for i in range(r, count - d, 2):
                    order_rows(keys, np.uint64(i * WIDTH), np.uint64((i + d) * WIDTH))
            elif p == 2:
                for i in range(r, count - d, 4):
                    order_rows(keys, np.uint64(i * WIDTH), np.uint64((i + d) * WIDTH))
                    j = i + 1 if i + 1 < count - d else i
                    order_rows(keys, np.uint64(j * WIDTH), np.uint64((j + d) * WIDTH))
            else:
                for block in range(r, count - d, 2 * p):
                    for i in range(block, min(block + p, count - d)):
                        order_rows(keys, np.uint64(i * WIDTH), np.uint64((i + d) * WIDTH))
            if q == p:
                break
            d, q, r = q - p, q // 2, p
        p //= 2
