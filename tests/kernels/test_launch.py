"""Tests of loops over functions of one item, on each device."""

from __future__ import annotations

import numpy as np
import pytest

from tests.devices import all_cores
from tests.kernels import launchable
from usdsplat.kernels.device import CpuDevice, Device
from usdsplat.kernels.launch import GRAIN, ROUND, chunk_of, kernel

F = np.float32
N = 2 * ROUND + 70
"""Items: more than one block of any form, and not a multiple."""


def values(count: int = N) -> np.ndarray:
    """Whole numbers, some negative."""
    return np.random.default_rng(1).integers(-5, 9, count).astype(F)


def test_a_kernel_of_items_runs_over_the_rows_of_its_argument(device: Device) -> None:
    """Oracle: NumPy; an early return ends one item alone."""
    out = np.zeros(N, F)
    device.run(launchable.doubled, values(), F(2), out)
    np.testing.assert_array_equal(out, np.maximum(2 * values(), 0))


def test_two_axes_are_those_of_an_array_of_a_size_or_of_two_arrays(device: Device) -> None:
    """Oracle: NumPy."""
    out = np.empty((5, 7), np.int64)
    device.run(launchable.numbered, out)
    np.testing.assert_array_equal(out, np.arange(35).reshape(5, 7))
    flat = np.empty(12, np.int64)
    device.run(launchable.sized, (3, 4), flat)
    np.testing.assert_array_equal(flat, [0, 1, 2, 3, 10, 11, 12, 13, 20, 21, 22, 23])
    rows, columns, product = np.arange(3.0), np.arange(5.0), np.empty((3, 5))
    device.run(launchable.table, rows, columns, product)
    np.testing.assert_array_equal(product, np.outer(rows, columns))


def test_tuples_among_the_arguments_arrive_as_they_are(device: Device) -> None:
    """Oracle: closed form; arrays in tuples come back too."""
    first, second, last = (np.empty(N, F) for _ in range(3))
    device.run(launchable.nested, values(), (first, second), (F(2), F(3), F(4)), last)
    np.testing.assert_array_equal(first, 2 * values() + 3)
    np.testing.assert_array_equal(second, 4)
    np.testing.assert_array_equal(last, 2 * values() + 7)


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("summed", values() + 1),
        ("mirrored", values() ** 2),
        ("weighed", 3 * values() + 1),
    ],
)
def test_blocks_have_scratch_of_their_own(device: Device, name: str, wanted: np.ndarray) -> None:
    """Oracle: NumPy."""
    out = np.empty(N, F)
    device.run(getattr(launchable, name), values(), out)
    np.testing.assert_array_equal(out, wanted)


def test_lanes_of_a_team_share_an_item(device: Device) -> None:
    """Oracle: NumPy."""
    counts, width = np.array([3, 0, 200, 7], np.int32), 200
    out = np.zeros(4 * width, np.int32)
    device.run(launchable.filled, counts, width, out)
    wanted = np.arange(1, 5)[:, None] * (np.arange(width) < counts[:, None])
    np.testing.assert_array_equal(out.reshape(4, width), wanted)


@pytest.mark.parametrize("count", [0, 1, ROUND, N])
def test_reductions_return_what_all_items_come_to(device: Device, count: int) -> None:
    """Oracle: NumPy; sums of whole numbers are exact."""
    given, out = values(count), np.empty(count, F)
    assert device.run(launchable.total, given) == given.sum(dtype=np.float64)
    assert device.run(launchable.most, given, out) == np.abs(given).max(initial=0)
    np.testing.assert_array_equal(out, given**2)
    assert device.run(launchable.above, given, F(7.5)) is bool((given > 7.5).any())
    assert device.run(launchable.above, given, F(8.5)) is False


def test_what_a_kernel_writes_comes_back_and_the_rest_is_not_copied(device: Device) -> None:
    """Oracle: closed form, with a part of an array, a tuple and one that is not contiguous."""
    given = np.arange(1, 5, dtype=F)
    rows, whole, out = np.zeros((4, 3), F), np.zeros((4, 2), F), np.zeros(8, F)
    device.run(launchable.by_steps, given, rows, (whole[:, 0], given), out[4:])
    np.testing.assert_array_equal(rows[:, 1], given)
    np.testing.assert_array_equal(whole, [[1, 0], [2, 0], [3, 0], [4, 0]])
    np.testing.assert_array_equal(out, [0, 0, 0, 0, 1, 2, 3, 4])


def test_the_number_of_threads_does_not_change_a_sum() -> None:
    """Oracle: the same bits; terms that no order adds up exactly."""
    given = np.random.default_rng(2).normal(size=N).astype(F)
    one = CpuDevice(threads=1).run(launchable.total, given)
    assert all_cores().run(launchable.total, given) == one


def test_a_thread_takes_no_less_than_the_grain() -> None:
    """Oracle: the contract."""
    assert chunk_of(launchable.doubled, 100, 16) == GRAIN
    assert chunk_of(launchable.doubled, 10**7, 2) > GRAIN
    assert chunk_of(launchable.summed, 10**7, 2) == 1


def test_names_that_are_no_arguments_are_an_error() -> None:
    """Oracle: the error."""

    def function(i, values):
        values[i] = 0

    with pytest.raises(TypeError, match="function: no argument other"):
        kernel(over="values", writes=("other",))(function)
    with pytest.raises(TypeError, match="function: no argument i"):
        kernel(over="i", writes=())(function)
