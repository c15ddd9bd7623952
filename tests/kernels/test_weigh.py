"""Tests of the weights of prims and their ranks, in the order of centres."""

from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.test_stages import NOTHING_BEHIND, alphas, lists_of, some_records
from usdsplat.kernels import cryptomatte, surface, triangles, weigh
from usdsplat.kernels.device import Device


@pytest.mark.parametrize("prims", [1, 3, 11])
@pytest.mark.parametrize(
    ("window", "ranks"),
    [((0, 0, 100, 70), weigh.RANKS), ((-21, -5, 43, 38), weigh.RANKS), ((0, 0, 50, 35), 16)],
)
def test_weights_are_sums_of_contributions(device: Device, window, ranks, prims: int) -> None:
    """Also of more prims than are kept. Oracle: the rules of compositing in float64 NumPy, over
    all splats and pixels."""
    records = some_records(300, 100)
    labels = np.random.default_rng(prims).integers(0, prims, len(records)).astype(np.int32)
    grid, starts, lists = lists_of(device, records, window)
    x0, y0, x1, y1 = window
    shape = y1 - y0, x1 - x0, ranks
    ids, weights = np.zeros(shape, np.int32), np.zeros(shape, np.float32)
    device.run(
        weigh.weigh, records, labels, prims, starts, lists, grid, *NOTHING_BEHIND, False, ids,
        weights,
    )  # fmt: skip
    sums = np.zeros((prims, *shape[:2]))
    left, ended = np.ones(shape[:2]), np.zeros(shape[:2], bool)
    for alpha, label in zip(
        alphas(records, np.arange(x0, x1), np.arange(y0, y1)), labels, strict=True
    ):
        ended |= left * (1 - alpha) < 1e-4
        alpha = np.where(ended, 0.0, alpha)
        sums[label] += left * alpha
        left = left * (1 - alpha)
    heaviest = -np.sort(-sums, axis=0)[:ranks]
    found = np.moveaxis(weights, 2, 0)
    close = np.abs(found[: len(heaviest)] - heaviest) < 1e-4
    assert close.mean() > 0.99  # the rest are contributions on the other side of 1/255
    assert np.abs(found[: len(heaviest)] - heaviest).max() < 0.02
    assert not found[len(heaviest) :].any()
    assert np.array_equal(ids >= 0, weights > 0)
    named = np.take_along_axis(np.moveaxis(sums, 0, 2), np.maximum(ids, 0), axis=2)
    assert np.abs(np.where(ids >= 0, named, 0) - weights).max() < 0.02


@pytest.mark.parametrize("written", [2, weigh.RANKS])
@pytest.mark.parametrize("surfaces", [False, True])
def test_ranks_of_one_sample_are_those_of_an_average_of_one(
    device: Device, surfaces: bool, written: int
) -> None:
    """To the bit, with ties, and with surfaces of a prim that splats are of, too. Oracle: the
    kernels that average any number of samples."""
    rng = np.random.default_rng(3)
    shape, prims = (37, 53), 9
    ids = np.argsort(rng.random((*shape, prims)), axis=2)[..., : weigh.RANKS].astype(np.int32)
    weights = -np.sort(-rng.integers(0, 5, ids.shape) / 8, axis=2).astype(np.float32)
    ids[weights == 0] = -1
    shown, left = np.empty((0, 0), np.int32), np.empty((0, 0), np.float32)
    if surfaces:
        shown = rng.integers(-1, prims, shape).astype(np.int32)
        left = np.where(shown >= 0, rng.integers(1, 5, shape) / 8, 0).astype(np.float32)
    numbers, hashes = np.arange(prims, dtype=np.int32), rng.random(prims).astype(np.float32)
    out = np.full((*shape, 2 * written), np.nan, np.float32)
    device.run(cryptomatte.rank, ids, weights, shown, left, hashes, out)
    slots = (*shape, cryptomatte.SLOTS_PER_PRIM * weigh.RANKS)
    all_ids, all_weights = np.zeros(slots, np.int32), np.zeros(slots, np.float32)
    device.run(cryptomatte.begin, all_ids, all_weights)
    device.run(cryptomatte.gather, ids, weights, numbers, all_ids, all_weights)
    if surfaces:
        of_surfaces = shown[..., None].copy(), left[..., None].copy()
        device.run(cryptomatte.gather, *of_surfaces, numbers, all_ids, all_weights)
    expected = np.empty_like(out)
    device.run(cryptomatte.finish, all_ids, all_weights, np.float32(1), hashes, expected)
    np.testing.assert_array_equal(out, expected)


def test_splats_and_surfaces_are_grouped_by_tables(device: Device) -> None:
    """Oracle: NumPy's indexing; -1 where no surface is seen."""
    rng = np.random.default_rng(7)
    shape, groups = (19, 33), rng.integers(0, 4, 9).astype(np.int32)
    labels = rng.integers(0, 9, 500).astype(np.int32)
    grouped = np.zeros_like(labels)
    device.run(cryptomatte.regroup, labels, groups, grouped)
    np.testing.assert_array_equal(grouped, groups[labels])
    ids = rng.integers(0, 9, (3, *shape)).astype(np.int32)
    left = np.where(rng.random(shape) < 0.5, rng.random(shape), 0).astype(np.float32)
    out = np.zeros(shape, np.int32)
    device.run(surface.shown, left, ids, groups, out)
    np.testing.assert_array_equal(out, np.where(left > 0, groups[ids[0]], -1))


def test_materials_of_surfaces_are_grouped_by_triangle(device: Device) -> None:
    """Of meshes with one material and with one for each triangle. Oracle: NumPy's indexing."""
    rng = np.random.default_rng(8)
    shape, groups = (19, 33), rng.permutation(6).astype(np.int32)
    looks = np.zeros(3, triangles.APPEARANCE)
    looks["material"], looks["material_of"] = (0, 1, 4), (-1, 2, -1)
    material_of = rng.integers(0, 3, 12).astype(np.int32)
    left = np.where(rng.random(shape) < 0.8, 1, 0).astype(np.float32)
    hit = np.stack([rng.integers(0, 3, shape), rng.integers(0, 10, shape)]).astype(np.int32)
    hit[:, left == 0] = -1
    out = np.zeros(shape, np.int32)
    device.run(surface.shown_material, left, hit, looks, material_of, groups, out)
    number = np.select([hit[0] == 0, hit[0] == 1], [0, 1 + material_of[2 + hit[1]]], 4)
    np.testing.assert_array_equal(out, np.where(left > 0, groups[number], -1))
