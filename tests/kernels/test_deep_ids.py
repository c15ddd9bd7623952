"""Tests of ranks that are found in the colours of deep samples."""

from __future__ import annotations

import numpy as np

from tests.kernels.test_stages import some_records
from usdsplat.kernels import deep_ids
from usdsplat.kernels.device import Device
from usdsplat.kernels.project import BLUE, RED


def test_records_keep_all_but_their_colour(device: Device) -> None:
    """Oracle: the digits of each index in base 2048."""
    records = some_records(5000, 100)
    out = np.empty_like(records)
    device.run(deep_ids.number, records, out)
    others = [c for c in range(records.shape[1]) if not RED <= c <= BLUE]
    np.testing.assert_array_equal(out[:, others], records[:, others])
    digits = out[:, RED : BLUE + 1].astype(np.int64)
    np.testing.assert_array_equal(digits @ [1, 2048, 2048**2], np.arange(5000))


def test_every_rank_is_read_back(device: Device) -> None:
    """Of any opacity above 0, of the largest ranks and of colours that are rounded twice. Oracle:
    the ranks."""
    rng = np.random.default_rng(0)
    n = 200_000
    ranks = np.append(rng.integers(0, 2**31 - 1, n - 3), [0, 2047, 2**31 - 2])
    alpha = np.exp(rng.uniform(np.log(1e-30), 0, n)).astype(np.float32)
    alpha[:1000] = 1
    digits = np.stack([ranks >> 11 * k & 2047 for k in range(3)], axis=1).astype(np.float32)
    color = np.column_stack([alpha[:, None] * digits, alpha]).astype(np.float32)
    signs = rng.choice([-1, 1], (n - 1000, 3)).astype(np.float32)
    color[1000:, :3] = np.nextafter(color[1000:, :3], np.float32(np.inf) * signs)
    color[1000:, :3][digits[1000:] == 0] = 0
    found = np.empty((n, 1), np.int32)
    device.run(deep_ids.read_ranks, color, 2**31 - 1, found)
    np.testing.assert_array_equal(found[:, 0], ranks)


def test_samples_without_opacity_have_a_valid_rank(device: Device) -> None:
    """Oracle: 0, and the last rank where digits exceed it."""
    color = np.float32([[0, 0, 0, 0], [1800, 0, 0, 1]])
    found = np.empty((2, 1), np.int32)
    device.run(deep_ids.read_ranks, color, 12, found)
    assert found[:, 0].tolist() == [0, 11]
