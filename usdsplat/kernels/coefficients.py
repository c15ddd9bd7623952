"""Read the coefficients of one splat with addresses that are known up to a constant.

The number of coefficients of an array is known only when a kernel runs. Each index would be a
multiplication, and there are too many of them for the registers of a CPU.
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

CHANNELS = 3


@intrinsic
def coefficients(typing: Any, sh: Any, row: Any) -> Any:
    """Return sh[row] of a contiguous array with shape (n, k, CHANNELS), row >= 0."""
    kind = types.Array(sh.dtype, 2, "C", readonly=True)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        all_rows = context.make_array(sig.args[0])(context, builder, args[0])
        word = context.get_value_type(types.intp)
        size = context.get_abi_sizeof(context.get_data_type(sh.dtype))
        stride = cgutils.unpack_tuple(builder, all_rows.shape, 3)[1]
        first = builder.mul(args[1], builder.mul(stride, word(CHANNELS)))
        found = make_array(kind)(context, builder)
        populate_array(
            found,
            data=builder.gep(all_rows.data, [first]),
            shape=cgutils.pack_array(builder, [stride, word(CHANNELS)]),
            strides=cgutils.pack_array(builder, [word(CHANNELS * size), word(size)]),
            itemsize=word(size),
            meminfo=ir.Constant(all_rows.meminfo.type, None),
            parent=ir.Constant(found.parent.type, None),
        )
        return found._getvalue()

    return kind(sh, types.uintp), emit


config: Any = numba.config
if config.DISABLE_JIT:

    def coefficients(sh: Any, row: Any) -> Any:
        return sh[int(row)]
