"""Tests of the simulated GPU: lanes wait for each other as in CUDA."""

from __future__ import annotations

import numpy as np
import pytest
from numba import cuda

from usdsplat.kernels.cuda.device import CudaDevice

FULL = 0xFFFFFFFF


@cuda.jit
def _warp_sums(values, out):
    i = cuda.grid(1)
    total = values[i]
    for step in (16, 8, 4, 2, 1):
        total += cuda.shfl_down_sync(FULL, total, step)
    if cuda.laneid == 0:
        out[i // 32] = total


def test_shuffles_sum_a_warp() -> None:
    """Oracle: NumPy's sum of each 32."""
    values = np.arange(128, dtype=np.int64) ** 2
    out = np.zeros(4, np.int64)
    _warp_sums[2, 64](values, out)
    np.testing.assert_array_equal(out, values.reshape(4, 32).sum(1))


@cuda.jit
def _places(flags, out, total):
    i = cuda.grid(1)
    votes = np.uint32(cuda.ballot_sync(FULL, flags[i]))
    before = np.uint32(votes & cuda.lanemask_lt())
    out[i] = cuda.popc(before)
    total[i] = cuda.syncthreads_count(np.int32(flags[i]))


def test_votes_count_the_lanes_before() -> None:
    """Oracle: a running sum; lane 31 sets the sign bit, which ballots return as int32."""
    flags = np.random.default_rng(1).random(64) < 0.5
    flags[31] = True
    out, total = np.zeros(64, np.int32), np.zeros(64, np.int32)
    _places[1, 64](flags, out, total)
    sums = flags.reshape(2, 32).cumsum(1) - flags.reshape(2, 32)
    np.testing.assert_array_equal(out, sums.ravel())
    assert (total == flags.sum()).all()


@cuda.jit
def _reverse(values):
    shared = cuda.shared.array(64, np.float32)
    i = cuda.threadIdx.x
    shared[i] = values[i]
    cuda.syncthreads()
    values[i] = shared[63 - i]


def test_a_barrier_parts_writes_from_reads() -> None:
    """Oracle: NumPy's reversal."""
    values = np.arange(64, dtype=np.float32)
    _reverse[1, 64](values)
    np.testing.assert_array_equal(values, np.arange(64)[::-1])


@cuda.jit
def _apart(values):
    if cuda.laneid < 16:
        cuda.syncthreads()
    else:
        cuda.syncwarp(FULL)


def test_lanes_that_would_wait_for_ever_are_an_error() -> None:
    """Oracle: half of a warp waits for the other half elsewhere."""
    with pytest.raises(RuntimeError, match="wait for ever"):
        _apart[1, 32](np.zeros(1))


def test_sorting_is_stable_and_takes_some_bits() -> None:
    """Oracle: the definition, by Python's sort."""
    device = CudaDevice()
    keys = np.random.default_rng(2).integers(0, 2**16, 50).astype(np.uint32)
    buffers = [device.resident(60, kind) for kind in (np.uint32, np.int32)]
    given = device.keep(keys), device.keep(np.arange(50, dtype=np.int32))
    device.primitives.sort_pairs(*given, *buffers, 50, begin_bit=8, end_bit=12)
    expected = sorted(range(50), key=lambda n: keys[n] >> 8 & 15)
    np.testing.assert_array_equal(device.fetch(buffers[1])[:50], expected)
