"""Sorting and summing on the GPU, by CUB through `cuda.compute`.

Source: NVIDIA's CUB; its radix sort is stable.
"""

from __future__ import annotations

from typing import Any

import cuda.compute as compute
import numpy as np
from numba import cuda

from usdsplat.kernels.compiling import compiled


class _Ordered:
    """A stream as `cuda.compute` knows one."""

    def __init__(self, stream: Any) -> None:
        handle = stream.handle
        self.handle = int(getattr(handle, "value", None) or handle or 0)

    def __cuda_stream__(self) -> tuple[int, int]:
        return 0, self.handle


class Primitives:
    """What one device sorts and sums with. Scratch memory is kept, and grows.

    What was outgrown is kept too: recorded launches go on using it.

    Arrays are of the device, and may be longer than `count`.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = _Ordered(stream)
        self._built: dict[tuple[Any, ...], Any] = {}
        self._zero = np.zeros(1, np.int32)
        self._scratch = [cuda.device_array(1 << 20, np.uint8)]

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
        """Sort `count` pairs by some bits of their keys, stably, into other arrays.

        Keys are unsigned, or float32 in their own order.
        """
        name = ("sort", keys.dtype, values.dtype)
        if name not in self._built:
            with compiled("sort_pairs"):
                self._built[name] = compute.make_radix_sort(
                    d_in_keys=keys,
                    d_out_keys=sorted_keys,
                    d_in_values=values,
                    d_out_values=sorted_values,
                    order=compute.SortOrder.ASCENDING,
                )
        bits = {"begin_bit": begin_bit, "end_bit": end_bit or 8 * keys.dtype.itemsize}
        self._call(
            self._built[name],
            d_in_keys=keys,
            d_out_keys=sorted_keys,
            d_in_values=values,
            d_out_values=sorted_values,
            num_items=count,
            **bits,
        )

    def running_sum(self, values: Any, out: Any, count: int) -> None:
        """out[k] = values[0] + ... + values[k - 1], for k < count; whole numbers."""
        name = ("sum", values.dtype, out.dtype)
        if name not in self._built:
            with compiled("running_sum"):
                self._built[name] = compute.make_exclusive_scan(
                    d_in=values, d_out=out, op=compute.OpKind.PLUS, init_value=self._start(out)
                )
        self._call(
            self._built[name],
            d_in=values,
            d_out=out,
            op=compute.OpKind.PLUS,
            init_value=self._start(out),
            num_items=count,
        )

    # --- private ---------------------------------------------------------------------------

    def _start(self, out: Any) -> Any:
        return self._zero.astype(out.dtype)

    def _call(self, algorithm: Any, **arguments: Any) -> None:
        arguments["stream"] = self._stream
        needed = algorithm(temp_storage=None, **arguments)
        if needed > self._scratch[-1].size:
            self._scratch.append(cuda.device_array(needed + needed // 2, np.uint8))
        algorithm(temp_storage=self._scratch[-1], **arguments)

    @property
    def bytes(self) -> int:
        """What the scratch takes of the device's memory."""
        return sum(int(each.size) for each in self._scratch)
