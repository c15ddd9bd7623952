"""The tests of `test_launch` on the simulated GPU: loops over functions of one item."""

from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.test_launch import (  # noqa: F401  # pytest collects them here
    test_a_kernel_of_items_runs_over_the_rows_of_its_argument,
    test_blocks_have_scratch_of_their_own,
    test_lanes_of_a_team_share_an_item,
    test_reductions_return_what_all_items_come_to,
    test_tuples_among_the_arguments_arrive_as_they_are,
    test_two_axes_are_those_of_an_array_of_a_size_or_of_two_arrays,
    test_what_a_kernel_writes_comes_back_and_the_rest_is_not_copied,
    values,
)
from usdsplat.kernels.cuda.device import CudaDevice


@pytest.fixture
def device() -> CudaDevice:
    """The simulated GPU."""
    return CudaDevice()


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
