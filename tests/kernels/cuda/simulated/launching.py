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
from usdsplat.kernels.cuda import device as cuda_device
from usdsplat.kernels.cuda import transfers
from usdsplat.kernels.cuda.device import CudaDevice
from usdsplat.kernels.cuda.transfers import PinnedPool
from usdsplat.kernels.launch import kernel


@kernel(over="out", writes=("out",))
def doubled(i, values, out):
    out[i] = values[i] + values[i]


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


def test_kernels_read_what_is_kept_and_writing_drops_it() -> None:
    """Oracle: the values that kernels read and write, and identity."""
    device = CudaDevice()
    here = values()
    kept = device.keep(here)
    kept.copy_to_device(here + 1)  # so that it can be told from the host's
    out = np.empty_like(here)
    device.run(doubled, here, out)
    np.testing.assert_array_equal(out, 2 * (here + 1))
    np.testing.assert_array_equal(device.fetch(device.copied(here)), here + 1)
    device.run(doubled, out, here)  # changes `here`
    again = device.keep(here)
    assert again is not kept
    np.testing.assert_array_equal(device.fetch(again), 2 * out)


def test_what_is_published_is_held_up_to_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: which copies are there, by the order of their use. A window keeps all frames."""
    monkeypatch.setattr(cuda_device, "PUBLISHED", 3 * values().nbytes)
    device = CudaDevice()
    there = [device.move(values()) for _ in range(3)]
    frames = [device.publish(each) for each in there]
    assert device.keep(frames[0]) is there[0]  # used last
    frames += [device.publish(device.move(values())) for _ in range(2)]
    held = [device._kept_copy(each) is not None for each in frames]
    assert held == [True, False, False, True, True]
    frames.clear()
    assert not device._kept and not device._published


def test_a_copy_changes_alone() -> None:
    """Oracle: the values."""
    device = CudaDevice()
    for source in (values(), device.move(values())):
        copy = device.copied(source)
        device.run(doubled, values(), copy)
        np.testing.assert_array_equal(device.fetch(copy), 2 * values())
        np.testing.assert_array_equal(device.fetch(source), values())


def test_pinned_memory_is_lent_up_to_its_limit_and_used_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Oracle: the memory that arrays share with pinned buffers, and the limit."""
    size = transfers.STEP
    monkeypatch.setattr(transfers, "LENT", 2 * size)
    made: list[np.ndarray] = []
    empty = transfers.cuda.pinned_array
    monkeypatch.setattr(
        transfers.cuda, "pinned_array", lambda *of: made.append(empty(*of)) or made[-1]
    )
    pool = PinnedPool()
    held = [pool.take((size // 16, 4), np.float32) for _ in range(3)]
    pinned = [any(np.shares_memory(each, buffer) for buffer in made) for each in held]
    assert pinned == [True, True, False] and all(each.nbytes == size for each in held)
    assert not any(np.shares_memory(held[k], held[k - 1]) for k in range(3))
    part = held.pop(0)[5:7]
    assert not any(np.shares_memory(pool.take((size,), np.uint8), buffer) for buffer in made)
    assert part.shape == (2, 4)
    del part
    assert np.shares_memory(pool.take((size,), np.uint8), made[0]) and len(made) == 2
