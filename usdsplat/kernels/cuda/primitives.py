"""Sort and compute prefix sums on the GPU, with CUB."""

from __future__ import annotations

from typing import Any

import cuda.compute as compute
import numpy as np
from numba import cuda

from usdsplat.kernels.cuda import cub
from usdsplat.kernels.cuda.support import SORT, SUM


class _Ordered:
    """Stream in the interface of `cuda.compute`."""

    def __init__(self, stream: Any) -> None:
        handle = stream.handle
        self.handle = int(getattr(handle, "value", None) or handle or 0)

    def __cuda_stream__(self) -> tuple[int, int]:
        return 0, self.handle


class Primitives:
    """Sort and prefix sum of one device. Scratch memory is kept, and grows.

    Outgrown memory is kept too, because recorded launches continue to use it.

    Arrays are on the device, and may be longer than `count`.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = _Ordered(stream)
        self._built: dict[tuple[str, str], Any] = {}
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

        Types of keys and values must be listed in `support.CUB`.
        """
        bits = {"begin_bit": begin_bit, "end_bit": end_bit or 8 * keys.dtype.itemsize}
        self._call(
            self._algorithm(SORT, keys, values),
            d_in_keys=keys,
            d_out_keys=sorted_keys,
            d_in_values=values,
            d_out_values=sorted_values,
            num_items=count,
            **bits,
        )

    def running_sum(self, values: Any, out: Any, count: int) -> None:
        """Set out[k] to values[0] + ... + values[k - 1], for k < count; integers."""
        self._call(
            self._algorithm(SUM, values, out),
            d_in=values,
            d_out=out,
            op=compute.OpKind.PLUS,
            init_value=np.zeros(1, out.dtype),
            num_items=count,
        )

    # --- private ---------------------------------------------------------------------------

    def _algorithm(self, name: str, *arrays: Any) -> Any:
        types = " ".join(np.dtype(each.dtype).str[1:] for each in arrays)
        if (name, types) not in self._built:
            self._built[name, types] = cub.load(name, types)
        return self._built[name, types]

    def _call(self, algorithm: Any, **arguments: Any) -> None:
        arguments["stream"] = self._stream
        needed = algorithm(temp_storage=None, **arguments)
        if needed > self._scratch[-1].size:
            self._scratch.append(cuda.device_array(needed + needed // 2, np.uint8))
        algorithm(temp_storage=self._scratch[-1], **arguments)

    @property
    def bytes(self) -> int:
        """Size of the scratch memory [byte]."""
        return sum(int(each.size) for each in self._scratch)
