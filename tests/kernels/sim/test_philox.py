"""Tests of counter-based random numbers."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from usdsplat.kernels.sim.philox import philox, uniforms


@njit
def words(counter, key):
    """Philox from Python."""
    return philox(counter[0], counter[1], counter[2], counter[3], key[0], key[1])


@njit
def draw(count, out):
    """One number for each of `count` splats."""
    for i in range(count):
        out[i] = uniforms(7, 1, i, 3, 0)[0]


@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    [
        ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        (
            (0xFFFFFFFF,) * 4,
            (0xFFFFFFFF,) * 2,
            (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD),
        ),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_known_answers(counter, key, expected) -> None:
    """Oracle: the known-answer vectors that the paper's authors publish with Random123."""
    assert words(np.uint32(counter), np.uint32(key)) == expected


def test_they_are_spread_evenly() -> None:
    """Oracle: statistics of a uniform distribution; neighbours in identity are not correlated."""
    drawn = np.empty(100_000, np.float32)
    draw(len(drawn), drawn)
    assert 0 <= drawn.min() < drawn.max() < 1
    assert abs(drawn.mean() - 0.5) < 4 * np.sqrt(1 / 12 / len(drawn))
    assert abs(np.corrcoef(drawn[1:], drawn[:-1])[0, 1]) < 0.02
