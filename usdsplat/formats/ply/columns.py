"""Gather named columns of a PLY block into a float32 array."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from usdsplat.core.errors import FormatError
from usdsplat.formats.ply.table import Block

_FLOAT32 = np.dtype(np.float32)

SH_COLUMNS = {0: 0, 9: 1, 24: 2, 45: 3, 72: 4}
"""Number of `f_rest_` properties -> degree of the harmonics."""


class Columns:
    """Copier of the properties `names`, in that order, from blocks of one dtype.

    Files usually store float32 only. Then one indexed copy gathers the columns of a row, which also
    undoes the channel-major order of the harmonics.
    """

    def __init__(self, dtype: np.dtype[np.void], names: Sequence[str]) -> None:
        stored = [dtype[name] for name in dtype.names or ()]
        position = {name: index for index, name in enumerate(dtype.names or ())}
        self._names = names
        self._alike = all(kind == _FLOAT32 for kind in stored)
        self._indices = np.array([position[name] for name in names], np.intp)

    def into(self, out: npt.NDArray[np.float32], block: Block) -> None:
        """Fill `out`, shape (n, number of names) or (n,) for one name, with n rows of `block`."""
        table = out.reshape(len(block), -1)
        if self._alike:
            rows = block.view(np.float32).reshape(len(block), -1)
            # The default mode would fill a copy first, to keep `out` unchanged on an error.
            np.take(rows, self._indices, axis=1, out=table, mode="clip")
            return
        with np.errstate(over="ignore", invalid="ignore"):  # `settle` reports infinities and NaN
            for column, name in enumerate(self._names):
                table[:, column] = block[name]


def harmonics(source: str, types: dict[str, str]) -> tuple[int, tuple[str, ...]]:
    """Return the degree, and the `f_rest_` properties by coefficient, then by channel.

    The file orders them by channel first: number = channel * coefficients + coefficient.

    Raises:
        FormatError: If their number matches no degree, or one is missing.
    """
    count = sum(name.startswith("f_rest_") for name in types)
    missing = [f"f_rest_{i}" for i in range(count) if f"f_rest_{i}" not in types]
    if count not in SH_COLUMNS or missing:
        found = f"{count} f_rest_ properties" + (f" without {missing[0]}" if missing else "")
        raise FormatError(source, found, "0, 9, 24, 45 or 72, numbered from 0")
    per_channel = count // 3
    names = (f"f_rest_{c * per_channel + k}" for k in range(per_channel) for c in range(3))
    return SH_COLUMNS[count], tuple(names)
