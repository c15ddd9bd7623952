"""Tests of the Z-order curve."""

from __future__ import annotations

import numpy as np
import pytest

from usdsplat.core import morton


def _interleaved(cells: np.ndarray, bits: int = 20) -> int:
    """Bits of x, y and z taken in turn, written as the definition says."""
    return sum(
        (int(cells[axis]) >> bit & 1) << (3 * bit + axis)
        for bit in range(bits)
        for axis in range(3)
    )


@pytest.mark.parametrize("shift", [0.0, 0.41])
def test_codes_interleave_the_bits_of_cells(shift):
    """Oracle: the definition, bit by bit in Python."""
    points = np.random.default_rng(0).uniform(-3, 5, (50, 3)).astype(np.float32)
    exact = points.astype(np.float64)
    extent = (exact.max(axis=0) - exact.min(axis=0)).max()
    unit = (exact - exact.min(axis=0)) / extent * 0.5 + 0.5 * shift
    cells = np.floor(unit * (2**20 - 1)).astype(np.int64)
    found = morton.codes(points, shift=shift)
    assert found.tolist() == [_interleaved(row) for row in cells]


def test_the_corners_of_a_cube_come_octant_by_octant():
    """Oracle: x is the lowest bit, then y, then z."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float32)
    shuffled = np.random.default_rng(1).permutation(8)
    assert shuffled[morton.order(corners[shuffled])].tolist() == list(range(8))


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.ones((5, 3))])
def test_points_without_extent_keep_their_order(points):
    """Oracle: one cell, a stable sort."""
    assert morton.order(points.astype(np.float32)).tolist() == list(range(len(points)))


def test_keys_interleave_21_bits_of_a_given_cube():
    """Oracle: the definition, bit by bit in Python; points outside count as on its surface."""
    points = np.random.default_rng(2).uniform(-3, 5, (50, 3)).astype(np.float32)
    low, edge = np.array([-2.5, -3.0, -2.0]), 7.0
    unit = (points.astype(np.float64) - low) / edge
    cells = np.clip(np.floor(unit * 2**21), 0, 2**21 - 1).astype(np.int64)
    found = morton.keys(points, low, edge)
    assert found.tolist() == [_interleaved(row, 21) for row in cells]
    assert found.max() < 2**63
