"""Loops that became CUDA kernels do what they did, and arrays travel as they should."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.kernels.cuda import derivable
from usdsplat.kernels.cuda.device import CudaDevice, form_of
from usdsplat.kernels.device import CpuDevice

F = np.float32


def values() -> Any:
    """Whole numbers, some negative."""
    return np.random.default_rng(1).integers(-5, 9, 30).astype(F)


@pytest.mark.parametrize("kernel", ["doubled", "sums", "greatest", "reversed_rows", "table"])
def test_a_derived_loop_gives_what_it_gave(kernel: str) -> None:
    """Oracle: the loop on the CPU; sums of whole numbers are exact."""
    loop = getattr(derivable, kernel)
    assert form_of(loop) is not None
    given = {
        "doubled": [values(), np.zeros(30, F)],
        "sums": [values(), np.zeros(8)],
        "greatest": [values(), np.zeros(8)],
        "reversed_rows": [values().reshape(10, 3), np.zeros((10, 3), F)],
        "table": [np.zeros((5, 7), np.int64)],
    }[kernel]
    found, wanted = ([each.copy() for each in given] for _ in range(2))
    CudaDevice().run(loop, *found)
    CpuDevice().run(loop, *wanted)
    assert wanted[-1].any()
    np.testing.assert_array_equal(found[-1], wanted[-1])


def test_what_is_counted_is_returned() -> None:
    """Oracle: NumPy's count, from the host's array and from the GPU's."""
    device = CudaDevice()
    wanted = int((values() < 0).sum())
    assert device.run(derivable.negatives, values()) == wanted
    assert device.run(derivable.negatives, device.move(values())) == wanted


def test_a_kernel_without_a_form_runs_on_copies() -> None:
    """Oracle: the values plus one, in an array of the GPU's."""
    device = CudaDevice()
    out = device.resident(30, F)
    device.run(derivable.in_turns, values(), out)
    np.testing.assert_array_equal(device.fetch(out), values() + 1)


def test_arrays_come_back_where_a_kernel_may_have_written() -> None:
    """Oracle: closed form, with a part of an array, a tuple and one that is not contiguous."""
    device = CudaDevice()
    rows, whole, out = np.zeros((4, 3), F), np.zeros((4, 2), F), np.zeros(8, F)
    given = np.arange(1, 5, dtype=F)
    device.run(derivable.by_others, given, rows, (whole[:, 0], given), out[4:])
    np.testing.assert_array_equal(rows[:, 1], given)
    np.testing.assert_array_equal(whole, [[1, 0], [2, 0], [3, 0], [4, 0]])
    np.testing.assert_array_equal(out, [0, 0, 0, 0, 1, 2, 3, 4])


def test_what_is_kept_is_copied_once_and_forgotten_with_its_array() -> None:
    """Oracle: identity."""
    device = CudaDevice()
    array = values()
    assert device.keep(array) is device.keep(array)
    again = array.copy()
    assert device.keep(again) is not device.keep(array)
    del again
    assert len(device._kept) == 1


def test_what_is_published_need_not_go_back() -> None:
    """Oracle: identity, and the values."""
    device = CudaDevice()
    there = device.move(values())
    here = device.publish(there)
    np.testing.assert_array_equal(here, values())
    assert device.keep(here) is there
