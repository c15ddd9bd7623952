"""Tests of fused pictures on the simulator, with few splats and pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import cuda

from tests.kernels.cuda import frames, pools
from usdsplat.core.errors import BackendError
from usdsplat.kernels.cuda import ties
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.frame import picture, pool


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Launches of a size that a simulator can take."""
    monkeypatch.setattr(picture, "WAVES", 2)
    monkeypatch.setattr(picture, "THREADS", 32)
    monkeypatch.setattr(picture, "LEAST", 64)
    monkeypatch.setattr(picture, "ROOM", 8)


def test_a_picture_is_that_of_float64() -> None:
    """Oracle: the reference in float64."""
    frames.check_floats(CudaDevice(), 30, 1)


def test_all_ways_to_blend_agree() -> None:
    """Oracle: the reference in float64."""
    frames.check_variants(CudaDevice(), 20)


def test_packed_splats_are_read_as_they_are() -> None:
    """Oracle: `schema.packing`, which unpacks them on the host."""
    frames.check_packed(CudaDevice(), 20, 1)


def test_instances_and_fields_are_one_order() -> None:
    """Oracle: the reference in float64."""
    frames.check_instances_and_fields(CudaDevice(), 12)


def test_room_grows_and_launches_are_recorded_again() -> None:
    """Oracle: the first picture, bit for bit, and one of nothing."""
    frames.check_room_grows(CudaDevice(), 20)


def test_boxes_leave_nothing_out() -> None:
    """Oracle: the picture of all splats, bit for bit."""
    frames.check_boxes_leave_nothing_out(CudaDevice(), 60)


def test_ties_of_depth_are_settled_by_rows() -> None:
    """Oracle: the picture of the same splats in the order of their rows, bit for bit."""
    frames.check_ties_are_settled(CudaDevice(), 20)


def test_nodes_are_on_the_gpu_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the arrays of the host."""
    monkeypatch.setattr(pool, "SENT", 2)
    monkeypatch.setattr(pool, "THREADS", 32)
    pools.check_content(CudaDevice(), (300, 5, 700, 1), 1)


def test_the_least_recently_used_nodes_make_room(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the order of use, by hand."""
    pools.check_room(CudaDevice(), monkeypatch)


def test_nodes_are_drawn_as_fields_are() -> None:
    """Oracle: the picture of each node as a field, bit for bit."""
    pools.check_picture(CudaDevice(), 24)


def test_long_runs_of_one_depth_are_merged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the picture of the same splats in the order of their rows, bit for bit."""
    monkeypatch.setattr(ties, "TIES", 4)
    frames.check_ties_are_settled(CudaDevice(), 20, flat=True)


def test_a_full_gpu_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the wording of errors; what else goes wrong stays what it is."""
    device = CudaDevice()

    def refuses(*_: Any, **__: Any) -> None:
        raise RuntimeError("[2] Call to cuMemAlloc results in CUDA_ERROR_OUT_OF_MEMORY")

    monkeypatch.setattr(cuda, "device_array", refuses)
    with pytest.raises(BackendError, match="device cuda: found too little memory on the GPU"):
        frames.check_floats(device, 30, 1)

    def fails(*_: Any, **__: Any) -> None:
        raise RuntimeError("Call to cuMemAlloc results in CUDA_ERROR_ILLEGAL_ADDRESS\nand more")

    monkeypatch.setattr(cuda, "device_array", fails)
    said = r"found RuntimeError \(Call to .*_ADDRESS\), expected a GPU that works, or --device cpu$"
    with pytest.raises(BackendError, match=said):
        device.resident(1, np.float32)
    monkeypatch.setattr(cuda, "device_array", lambda *_, **__: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        device.resident(1, np.float32)
