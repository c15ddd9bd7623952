"""Tests of operations on sixteen numbers. Oracle: NumPy."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from usdsplat.kernels import lanes
from usdsplat.kernels.batch import LOOK, load_batch
from usdsplat.kernels.blend import rows_touched
from usdsplat.kernels.jit import scalar
from usdsplat.kernels.project import HALF_HEIGHT, LOG_OPACITY, RECORD, A, B, C, U, V

rng = np.random.default_rng(5)


@pytest.fixture(autouse=True)
def same_numbers():
    """The same for each test, whichever came before."""
    global rng
    rng = np.random.default_rng(5)


NUMBERS = np.concatenate(
    [rng.normal(0, 3, 13), [0.0, -0.0, np.inf], rng.normal(0, 3, 15), [np.nan]]
).astype(np.float32)
"""Two values of 16 lanes."""


@numba.njit
def arithmetic(x, out):
    a, b = lanes.load(x, np.uint64(0)), lanes.load(x, np.uint64(16))
    two = np.float32(2)
    lanes.store(out, np.uint64(0), a + b * two)
    lanes.store(out, np.uint64(16), two / a - b)
    lanes.store(out, np.uint64(32), lanes.lower(a, b))
    lanes.store(out, np.uint64(48), lanes.higher(a, np.float32(0.5)))
    lanes.store(out, np.uint64(64), lanes.choose((a > b) & (b >= -two), a, lanes.ramp()))
    lanes.store(out, np.uint64(80), lanes.floor(-a))
    lanes.store(out, np.uint64(96), lanes.root(lanes.size(a)))


def test_operations_are_numpys():
    """Oracle: NumPy in float32, infinities, zeros of both signs and NaN among the numbers."""
    out = np.empty(7 * 16, np.float32)
    a, b, two = NUMBERS[:16], NUMBERS[16:], np.float32(2)
    with np.errstate(all="ignore"):
        arithmetic(NUMBERS, out)
        expected = np.concatenate([
            a + b * two, two / a - b, np.where(a < b, a, b), np.where(a > 0.5, a, np.float32(0.5)),
            np.where((a > b) & (b >= -2), a, np.arange(16)), np.floor(-a), np.sqrt(np.abs(a)),
        ]).astype(np.float32)  # fmt: skip
    np.testing.assert_array_equal(out, expected)


@numba.njit
def flags(x, limit):
    set_bits = lanes.bits(lanes.load(x, np.uint64(16)) > limit)
    return set_bits, lanes.count_bits(set_bits), lanes.lowest_bit(set_bits)


def test_bits_are_those_of_the_lanes():
    """Oracle: a comparison by NumPy, counted by Python; NaN is not above anything."""
    above = [bool(x > 0.25) for x in NUMBERS[16:]]
    expected = sum(1 << i for i, each in enumerate(above) if each)
    assert flags(NUMBERS, np.float32(0.25)) == (expected, sum(above), above.index(True))


@numba.njit
def mixed(x, out):
    a = lanes.load(x, np.uint64(1))
    lanes.store_mixed(out, np.uint64(3), a, a + np.float32(100), lanes.ramp(), lanes.spread(x[0]))


def test_planes_become_pixels():
    """Oracle: np.stack."""
    x, out = np.arange(17, dtype=np.float32), np.zeros(70, np.float32)
    mixed(x, out)
    planes = [x[1:], x[1:] + 100, np.arange(16), np.zeros(16)]
    np.testing.assert_array_equal(out[3:67], np.stack(planes, 1).ravel())
    assert not out[:3].any() and not out[67:].any()


@numba.njit
def spread_over(first, by, count):
    lanes.apart()
    return lanes.number(first, np.uint64(count)) + by


@numba.njit
def far(x):
    return spread_over(lanes.place(x, np.uint64(2)), np.float32(0.5), 3)


def test_a_place_is_read_from_there_on():
    """Oracle: x[2 + 3] + 0.5."""
    assert far(np.arange(9, dtype=np.float32)) == 5.5


@scalar
def _alone(records, i, left, top):
    s = records[i]
    shrink = np.float32(0.125)
    return rows_touched(
        s[A] * shrink, s[B] * shrink, s[C] * shrink, s[LOG_OPACITY] * shrink, s[HALF_HEIGHT],
        s[U] - left, s[V] - top,
    )  # fmt: skip


@numba.njit
def spans_both_ways(records, lists, left, top, out):
    batch, rows = np.ones(7 * LOOK, np.float32), np.empty(2 * LOOK, np.float32)
    load_batch(records, lists, 0, LOOK, left, top, batch, rows)
    for i in range(LOOK):
        out[i, 0], out[i, 1] = rows[i], rows[LOOK + i]
        out[i, 2], out[i, 3] = _alone(records, lists[i], left, top)


@pytest.mark.parametrize("top", [0.0, 16.0, 32.0])
def test_a_batch_finds_the_rows_that_each_splat_alone_does(top):
    """Oracle: `rows_touched`, one splat after the other, in float32."""
    records = np.zeros((LOOK, RECORD), np.float32)
    angle, sizes = rng.uniform(0, np.pi, LOOK), 10 ** rng.uniform(-0.2, 2, (LOOK, 2))
    turn = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], 1)
    turn = turn.reshape(-1, 2, 2)
    covariances = turn @ (sizes[:, :, None] ** 2 * np.eye(2)) @ turn.transpose(0, 2, 1)
    inverse, opacity = np.linalg.inv(covariances), rng.uniform(0.01, 1, LOOK)
    records[:, U], records[:, V] = rng.uniform(-20, 60, (2, LOOK))
    records[:, A], records[:, B] = -0.5 * inverse[:, 0, 0], -inverse[:, 0, 1]
    records[:, C], records[:, LOG_OPACITY] = -0.5 * inverse[:, 1, 1], np.log(opacity)
    records[:, HALF_HEIGHT] = np.sqrt(2 * np.log(255 * opacity) * covariances[:, 1, 1])
    out = np.zeros((LOOK, 4), np.float32)
    spans_both_ways(
        records, np.arange(LOOK, dtype=np.int32)[::-1].copy(), np.float32(16), np.float32(top), out
    )
    assert (out[:, 0] < out[:, 1]).any()
    empty = out[:, 2] >= out[:, 3]
    np.testing.assert_array_equal(out[~empty, :2], out[~empty, 2:])
    assert (out[empty, 0] >= out[empty, 1]).all()
