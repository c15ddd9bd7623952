"""Read rows of a flat picture in the order in which they are drawn, whatever the bands are."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.render.band import Band


class FlatRows:
    """Colour of a picture, row by row from the top.

    Args:
        bands: The bands of the picture; each is drawn when its first row is read.
    """

    def __init__(self, bands: Iterator[Band]) -> None:
        self._bands = bands
        self._left: F32 | None = None

    def take(self, count: int) -> F32:
        """Return the next `count` rows, shape (count, w, 4). They are valid until the next call."""
        parts: list[F32] = []
        while count > 0:
            rows = next(self._bands).arrays["color"] if self._left is None else self._left
            # The next band has the same memory.
            parts.append(rows[:count] if len(rows) >= count else rows.copy())
            self._left = rows[count:] if len(rows) > count else None
            count -= len(parts[-1])
        return parts[0] if len(parts) == 1 else np.concatenate(parts)
