"""Tests of reading rows of a flat picture."""

from __future__ import annotations

import numpy as np

from usdsplat.products.flat_rows import FlatRows
from usdsplat.render.band import Band


def test_rows_are_in_order_whatever_the_bands_are():
    """And no band is drawn before its first row is read. All bands have the same memory, as those
    of a renderer have. Oracle: the whole picture."""
    image = np.arange(30 * 5 * 4, dtype=np.float32).reshape(30, 5, 4)
    memory = np.empty((15, 5, 4), np.float32)
    begun = []

    def bands():
        for y0, y1 in ((0, 8), (8, 9), (9, 24), (24, 30)):
            begun.append(y0)
            memory[: y1 - y0] = image[y0:y1]
            yield Band(y0, y1, {"color": memory[: y1 - y0]})

    rows = FlatRows(bands())
    y = 0
    for count, last in ((3, 0), (8, 9), (2, 9), (15, 24), (2, 24)):
        np.testing.assert_array_equal(rows.take(count), image[y : y + count])
        assert begun[-1] == last
        y += count
