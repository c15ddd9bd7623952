"""Operate on four float32 numbers at once: the channels of one sample.

LLVM does not combine the four stores of a sample into one by itself. Without compilation
(NUMBA_DISABLE_JIT), the functions operate on NumPy slices of four. See `lanes`.
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

WIDTH = 4

_FLOATS = ir.VectorType(ir.FloatType(), WIDTH)
_INT = ir.IntType(32)
_ALIGNMENT = 4
"""Alignment of loads and stores, that of a float32 [byte]."""


def _place(context: Any, builder: Any, array_type: Any, array: Any, at: Any) -> Any:
    """Return the address of four numbers in an array."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), _FLOATS.as_pointer())


@intrinsic
def copy_quad(typing: Any, out: Any, at: Any, source: Any, first: Any) -> Any:
    """Set out[at : at + 4] to source[first : first + 4]. The arrays are flat and float32."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = _place(context, builder, sig.args[2], args[2], args[3])
        quad = builder.load(place, align=_ALIGNMENT)
        builder.store(quad, _place(context, builder, sig.args[0], *args[:2]), align=_ALIGNMENT)
        return context.get_dummy_value()

    return types.void(out, types.uintp, source, types.uintp), emit


@intrinsic
def scale_quad(typing: Any, out: Any, at: Any, factor: Any, source: Any, first: Any) -> Any:
    """Set out[at : at + 4] to factor * source[first : first + 4]. The arrays are flat and
    float32."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        nothing = ir.Constant(_FLOATS, ir.Undefined)
        one = builder.insert_element(nothing, args[2], _INT(0))
        everywhere = ir.Constant(ir.VectorType(_INT, WIDTH), None)
        factor = builder.shuffle_vector(one, nothing, everywhere)
        place = _place(context, builder, sig.args[3], args[3], args[4])
        quad = builder.fmul(factor, builder.load(place, align=_ALIGNMENT))
        builder.store(quad, _place(context, builder, sig.args[0], *args[:2]), align=_ALIGNMENT)
        return context.get_dummy_value()

    return types.void(out, types.uintp, types.float32, source, types.uintp), emit


config: Any = numba.config
if config.DISABLE_JIT:

    def copy_quad(out: Any, at: Any, source: Any, first: Any) -> None:
        out[int(at) : int(at) + WIDTH] = source[int(first) : int(first) + WIDTH]

    def scale_quad(out: Any, at: Any, factor: Any, source: Any, first: Any) -> None:
        out[int(at) : int(at) + WIDTH] = factor * source[int(first) : int(first) + WIDTH]
