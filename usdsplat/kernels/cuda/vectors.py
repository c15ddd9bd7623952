"""Load and store four floats at once: one access of 16 bytes instead of Numba's four of 4.

Records are read in scattered order, so each access is a separate memory transaction.
"""

from __future__ import annotations

from typing import Any

from usdsplat.kernels.cuda.support import is_simulated


def _load(array: Any, index: Any) -> Any:
    return array[index], array[index + 1], array[index + 2], array[index + 3]


def _store(array: Any, index: Any, a: Any, b: Any, c: Any, d: Any) -> None:
    array[index], array[index + 1], array[index + 2], array[index + 3] = a, b, c, d


if is_simulated():
    load4, store4 = _load, _store
else:
    from llvmlite import ir
    from numba import types
    from numba.cuda.extending import intrinsic

    _FOUR = ir.VectorType(ir.FloatType(), 4)

    def _place(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
        """Return the address of four floats."""
        data = context.make_array(kind)(context, builder, array).data
        return builder.bitcast(builder.gep(data, [index]), _FOUR.as_pointer())

    @intrinsic
    def load4(typingctx: Any, array: Any, index: Any) -> Any:
        """Return (array[index], ... array[index + 3]) of a flat float32 array of the device.

        index: uint64, a multiple of 4; the array begins on 16 bytes.
        """
        out = types.UniTuple(types.float32, 4)

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            at = _place(context, builder, signature.args[0], *args)
            four = builder.load(at, align=16)
            each = [builder.extract_element(four, ir.IntType(32)(i)) for i in range(4)]
            return context.make_tuple(builder, signature.return_type, each)

        return out(array, types.uint64), generate

    @intrinsic
    def store4(typingctx: Any, array: Any, index: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
        """Write array[index] to array[index + 3] of a flat float32 array of the device.

        index: uint64, a multiple of 4; the array begins on 16 bytes.
        """

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            at = _place(context, builder, signature.args[0], *args[:2])
            four = ir.Constant(_FOUR, ir.Undefined)
            for i, value in enumerate(args[2:]):
                four = builder.insert_element(four, value, ir.IntType(32)(i))
            builder.store(four, at, align=16)
            return context.get_dummy_value()

        floats = (types.float32,) * 4
        return types.void(array, types.uint64, *floats), generate
