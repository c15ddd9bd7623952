"""Four numbers at once, each operation against NumPy's."""

from __future__ import annotations

import numba
import numpy as np

from usdsplat.kernels import quads

NUMBERS = np.array([1.5, -0.0, np.inf, np.nan, 3.0, -2.0, 1e-40, 7.0], np.float32)


@numba.njit
def _copy(source, out):
    quads.copy_quad(out, np.uint64(1), source, np.uint64(2))


@numba.njit
def _scale(factor, source, out):
    quads.scale_quad(out, np.uint64(2), factor, source, np.uint64(4))


def test_four_numbers_are_copied_and_no_others():
    """Oracle: slices of NumPy, compared bit by bit."""
    out, expected = np.full(6, 9, np.float32), np.full(6, 9, np.float32)
    _copy(NUMBERS, out)
    expected[1:5] = NUMBERS[2:6]
    np.testing.assert_array_equal(out.view(np.uint32), expected.view(np.uint32))


def test_four_numbers_are_scaled_and_no_others():
    """Oracle: NumPy's product in float32, a denormal among the numbers."""
    out, expected = np.full(7, 9, np.float32), np.full(7, 9, np.float32)
    _scale(np.float32(1 / 3), NUMBERS, out)
    expected[2:6] = np.float32(1 / 3) * NUMBERS[4:]
    np.testing.assert_array_equal(out.view(np.uint32), expected.view(np.uint32))
