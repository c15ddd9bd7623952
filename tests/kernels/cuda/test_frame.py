"""Tests of fused pictures on a GPU."""

from __future__ import annotations

import pytest

from tests.kernels.cuda import frames, pools
from usdsplat.kernels.cuda.support import obstacle
from usdsplat.kernels.device import Device
from usdsplat.kernels.devices import open_device

pytestmark = pytest.mark.skipif(obstacle() is not None, reason="needs an NVIDIA GPU")


@pytest.fixture(scope="module")
def device() -> Device:
    return open_device("cuda")


@pytest.mark.parametrize("degree", range(5))
def test_a_picture_is_that_of_float64(device, degree) -> None:
    """Oracle: the reference in float64."""
    frames.check_floats(device, 2000, degree)


def test_all_ways_to_blend_agree(device) -> None:
    """Oracle: the reference in float64."""
    frames.check_variants(device, 2000)


@pytest.mark.parametrize("degree", range(5))
def test_packed_splats_are_read_as_they_are(device, degree) -> None:
    """Oracle: `schema.packing`, which unpacks them on the host."""
    frames.check_packed(device, 2000, degree)


def test_instances_and_fields_are_one_order(device) -> None:
    """Oracle: the reference in float64."""
    frames.check_instances_and_fields(device, 1000)


def test_room_grows_and_launches_are_recorded_again(device) -> None:
    """Oracle: the first picture, bit for bit, and one of nothing."""
    frames.check_room_grows(device, 300_000)


def test_boxes_leave_nothing_out(device) -> None:
    """Oracle: the picture of all splats, bit for bit."""
    frames.check_boxes_leave_nothing_out(device, 50_000)


def test_ties_of_depth_are_settled_by_rows(device) -> None:
    """Oracle: the picture of the same splats in the order of their rows, bit for bit."""
    frames.check_ties_are_settled(device, 900)
    frames.check_ties_are_settled(device, 5000, flat=True)


def test_nodes_are_on_the_gpu_as_they_are(device) -> None:
    """Oracle: the arrays of the host."""
    pools.check_content(device, (300, 5, 70_000, 256, 1_100_000, 1), 2)


def test_the_least_recently_used_nodes_make_room(device, monkeypatch) -> None:
    """Oracle: the order of use, by hand."""
    pools.check_room(device, monkeypatch)


def test_nodes_are_drawn_as_fields_are(device) -> None:
    """Oracle: the picture of each node as a field, bit for bit."""
    pools.check_picture(device, 3000)


def test_a_closed_device_has_freed_what_it_had() -> None:
    """Oracle: Numba's own list of what it has yet to free."""
    from numba import cuda

    device = open_device("cuda")
    frames.check_floats(device, 2000, 0)
    device.close()
    assert len(cuda.current_context().deallocations) == 0
