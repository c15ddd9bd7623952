"""Operate on sixteen float32 numbers at once, for loops that must not depend on LLVM's vectoriser.

A value of type `lanes` is one `<16 x float>`: one register with AVX-512, two with AVX2, four with
NEON. Operators work as on float32, lane by lane, and accept float32 on one side. Comparisons give a
mask, which `choose` and `bits` read. The surrounding function's compiler flags apply. Without
compilation (NUMBA_DISABLE_JIT), lanes are NumPy arrays of 16.
"""

from __future__ import annotations

import operator
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, cpu, types
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model

WIDTH = 16
"""Number of lanes: a row of a tile."""

_FLOATS = ir.VectorType(ir.FloatType(), WIDTH)
_FLAGS = ir.VectorType(ir.IntType(1), WIDTH)
_ALIGNMENT = 4
"""Alignment of loads and stores, that of a float32 [byte]."""


class _Lanes(types.Type):
    def __init__(self) -> None:
        super().__init__(name="lanes")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Return whether a type can be converted: a float32 becomes 16 equal lanes."""
        return Conversion.safe if other == types.float32 else None


class _Mask(types.Type):
    def __init__(self) -> None:
        super().__init__(name="mask")


lanes, mask = _Lanes(), _Mask()


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, frontend: Any) -> None:
        super().__init__(manager, frontend, _FLOATS)


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, frontend: Any) -> None:
        super().__init__(manager, frontend, _FLAGS)


# --- operators -------------------------------------------------------------------------


def _spread(builder: Any, number: Any) -> Any:
    """Return 16 lanes with the same number."""
    nothing = ir.Constant(_FLOATS, ir.Undefined)
    one = builder.insert_element(nothing, number, ir.IntType(32)(0))
    everywhere = ir.Constant(ir.VectorType(ir.IntType(32), 16), None)
    return builder.shuffle_vector(one, nothing, everywhere)


@lower_cast(types.float32, _Lanes)
def _cast(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    return _spread(builder, value)


def _binary(function: Any, result: Any, emit: Any) -> None:
    """Make `function` work on two lanes, or lanes and a float32."""

    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            both = (lanes, types.float32)
            if len(args) == 2 and lanes in args and all(each in both for each in args):
                return signature(result, lanes, lanes)
            return None

    @lower_builtin(function, lanes, lanes)
    def _lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, *args)


def _compare(function: Any, sign: str) -> None:
    _binary(function, mask, lambda builder, a, b: builder.fcmp_ordered(sign, a, b))


_binary(operator.add, lanes, lambda builder, a, b: builder.fadd(a, b))
_binary(operator.sub, lanes, lambda builder, a, b: builder.fsub(a, b))
_binary(operator.mul, lanes, lambda builder, a, b: builder.fmul(a, b))
_binary(operator.truediv, lanes, lambda builder, a, b: builder.fdiv(a, b))
_compare(operator.lt, "<")
_compare(operator.le, "<=")
_compare(operator.gt, ">")
_compare(operator.ge, ">=")
_compare(operator.eq, "==")


@infer_global(operator.and_)
class _And(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(mask, mask, mask) if tuple(args) == (mask, mask) else None


@lower_builtin(operator.and_, mask, mask)
def _and(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.and_(*args)


@infer_global(operator.neg)
class _Neg(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(lanes, lanes) if tuple(args) == (lanes,) else None


@lower_builtin(operator.neg, lanes)
def _neg(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0])


# --- functions -------------------------------------------------------------------------


def _of_llvm(name: str, count: int) -> Any:
    """Return an emitter of a call of LLVM's own function of `count` lanes."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_FLOATS, [_FLOATS] * count)
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v16f32")
        return builder.call(function, args)

    return emit


def _first(context: Any, builder: Any, source_type: Any, source: Any) -> Any:
    """Return the first address of an array, or the address of a place."""
    if isinstance(source_type, types.CPointer):
        return source
    return context.make_array(source_type)(context, builder, source).data


def _place(context: Any, builder: Any, source_type: Any, source: Any, at: Any) -> Any:
    """Return the address of 16 numbers in an array."""
    first = _first(context, builder, source_type, source)
    return builder.bitcast(builder.gep(first, [at]), _FLOATS.as_pointer())


@intrinsic
def place(typing: Any, array: Any, at: Any) -> Any:
    """Return the place of number `at` of a flat float32 array, for functions that are not inlined:
    an array is seven arguments and a reference count."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.gep(_first(context, builder, sig.args[0], args[0]), [args[1]])

    return types.CPointer(types.float32)(array, types.uintp), emit


@intrinsic
def number(typing: Any, source: Any, at: Any) -> Any:
    """Return the float32 that is `at` numbers after a place."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(builder.gep(args[0], [args[1]]))

    return types.float32(source, types.uintp), emit


@intrinsic
def apart(typing: Any) -> Any:
    """Prevent the calling function from being inlined, so that it has all registers to itself."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), emit


@intrinsic
def load(typing: Any, array: Any, at: Any) -> Any:
    """Return array[at : at + 16] of a flat float32 array, at >= 0."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_place(context, builder, sig.args[0], *args), align=_ALIGNMENT)

    return lanes(array, types.uintp), emit


@intrinsic
def store(typing: Any, array: Any, at: Any, numbers: Any) -> Any:
    """Set array[at : at + 16] to numbers. The array is flat and float32, at >= 0."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = _place(context, builder, sig.args[0], *args[:2])
        builder.store(args[2], place, align=_ALIGNMENT)
        return context.get_dummy_value()

    return types.void(array, types.uintp, lanes), emit


@intrinsic
def store_mixed(typing: Any, array: Any, at: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Set array[at : at + 64] to a0 b0 c0 d0 a1 b1 c1 d1 ..: four planes become pixels."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        def order(numbers: Any) -> Any:
            return ir.Constant(ir.VectorType(ir.IntType(32), len(numbers)), numbers)

        pairs = order([i + WIDTH * half for i in range(WIDTH) for half in range(2)])
        quads = order(
            [2 * i + k + 2 * WIDTH * h for i in range(WIDTH) for h in (0, 1) for k in (0, 1)]
        )
        low = builder.shuffle_vector(args[2], args[3], pairs)
        high = builder.shuffle_vector(args[4], args[5], pairs)
        mixed = builder.shuffle_vector(low, high, quads)
        where = _place(context, builder, sig.args[0], *args[:2])
        builder.store(mixed, builder.bitcast(where, mixed.type.as_pointer()), align=_ALIGNMENT)
        return context.get_dummy_value()

    return types.void(array, types.uintp, lanes, lanes, lanes, lanes), emit


@intrinsic
def fetch(typing: Any, array: Any, at: Any) -> Any:
    """Prefetch the memory of number `at` of an array, in flat order, on a CPU."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if not isinstance(context, cpu.CPUContext):  # a GPU's assembler knows no such instruction
            return context.get_dummy_value()
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        first = builder.gep(_first(context, builder, sig.args[0], args[0]), [args[1]])
        builder.call(function, [builder.bitcast(first, byte), number(0), number(3), number(1)])
        return context.get_dummy_value()

    return types.void(array, types.uintp), emit


@intrinsic
def spread(typing: Any, number: Any) -> Any:
    """Return 16 lanes with the same float32."""
    return lanes(types.float32), lambda context, builder, sig, args: _spread(builder, args[0])


@intrinsic
def ramp(typing: Any) -> Any:
    """Return lanes 0, 1, 2 .. 15."""
    numbers = ir.Constant(_FLOATS, [float(i) for i in range(WIDTH)])
    return lanes(), lambda context, builder, sig, args: numbers


@intrinsic
def choose(typing: Any, condition: Any, yes: Any, no: Any) -> Any:
    """Return `yes` where the mask is set, else `no`. Both are lanes or float32."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(*args)

    return lanes(mask, lanes, lanes), emit


@intrinsic
def lower(typing: Any, a: Any, b: Any) -> Any:
    """Return the lower of two; b where either is NaN."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", *args), *args)

    return lanes(lanes, lanes), emit


@intrinsic
def higher(typing: Any, a: Any, b: Any) -> Any:
    """Return the higher of two; b where either is NaN."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", *args), *args)

    return lanes(lanes, lanes), emit


@intrinsic
def fused(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a b + c, rounded once if the machine can."""
    return lanes(lanes, lanes, lanes), _of_llvm("fmuladd", 3)


@intrinsic
def root(typing: Any, a: Any) -> Any:
    """Return the square root."""
    return lanes(lanes), _of_llvm("sqrt", 1)


@intrinsic
def floor(typing: Any, a: Any) -> Any:
    """Return the largest integer that is not greater."""
    return lanes(lanes), _of_llvm("floor", 1)


@intrinsic
def size(typing: Any, a: Any) -> Any:
    """Return the absolute value."""
    return lanes(lanes), _of_llvm("fabs", 1)


@intrinsic
def bits(typing: Any, condition: Any) -> Any:
    """Return a mask as u64 whose bit k is lane k."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], ir.IntType(WIDTH)), ir.IntType(64))

    return types.uint64(mask), emit


@intrinsic
def lowest_bit(typing: Any, number: Any) -> Any:
    """Return the index of the lowest set bit of a u64, which is not 0."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.IntType(1)(1))

    return types.uint64(types.uint64), emit


@intrinsic
def count_bits(typing: Any, number: Any) -> Any:
    """Return the number of set bits of a u64, i64."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.ctpop(args[0])

    return types.int64(types.uint64), emit


config: Any = numba.config
if config.DISABLE_JIT:

    def load(array: Any, at: Any) -> Any:
        return array[int(at) : int(at) + WIDTH].copy()

    def store(array: Any, at: Any, numbers: Any) -> None:
        array[int(at) : int(at) + WIDTH] = numbers

    def place(array: Any, at: Any) -> Any:
        return array[int(at) :]

    def number(source: Any, at: Any) -> Any:
        return source[int(at)]

    def apart() -> None:
        pass

    def store_mixed(array: Any, at: Any, a: Any, b: Any, c: Any, d: Any) -> None:
        array[int(at) : int(at) + 4 * WIDTH] = np.stack([a, b, c, d], axis=1).ravel()

    def fetch(array: Any, at: Any) -> None:
        pass

    def spread(number: Any) -> Any:
        return np.full(WIDTH, number, np.float32)

    def ramp() -> Any:
        return np.arange(WIDTH, dtype=np.float32)

    def choose(condition: Any, yes: Any, no: Any) -> Any:
        return np.where(condition, yes, no)

    def lower(a: Any, b: Any) -> Any:
        return np.where(a < b, a, b)

    def higher(a: Any, b: Any) -> Any:
        return np.where(a > b, a, b)

    vars().update(root=np.sqrt, floor=np.floor, size=np.abs)

    def fused(a: Any, b: Any, c: Any) -> Any:
        return a * b + c

    def bits(condition: Any) -> Any:
        return np.uint64(np.packbits(condition, bitorder="little").view(np.uint16)[0])

    def lowest_bit(number: Any) -> Any:
        return np.uint64((int(number) & -int(number)).bit_length() - 1)

    def count_bits(number: Any) -> int:
        return int(number).bit_count()
