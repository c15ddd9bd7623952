"""Coefficients of one splat, read by constant addresses."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from usdsplat.kernels.coefficients import CHANNELS, coefficients


@numba.njit
def read(sh, row, k, c):
    return coefficients(sh, np.uint64(row))[k, c]


@pytest.mark.parametrize("count", [1, 4, 9, 16, 25])
def test_the_coefficients_of_a_row_are_those_of_the_array(count):
    """Oracle: NumPy's indexing."""
    sh = np.random.default_rng(2).normal(size=(5, count, CHANNELS)).astype(np.float32)
    sh.flags.writeable = False
    for row in range(5):
        for k in range(count):
            for c in range(CHANNELS):
                assert read(sh, row, k, c) == sh[row, k, c]
