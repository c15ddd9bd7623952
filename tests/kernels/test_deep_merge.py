"""Tests of merging the deep samples of several pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from usdsplat.kernels.device import CpuDevice
from usdsplat.render.deep_merging import DeepAccumulator, TooManyEntries
from usdsplat.render.deep_samples import DeepSamples

PIXELS = (3, 5)


def deep_picture(seed: int, *, depths: int = 0, ids: int = 0, opaque: bool = False) -> DeepSamples:
    """Random samples, near to far; depths are of so many values, or all different."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 12, PIXELS).astype(np.uint32)
    counts[0, 0] = 0
    pixel = np.repeat(np.arange(counts.size), counts.ravel())
    n = len(pixel)
    depth = rng.uniform(1, 9, n).astype(np.float32)
    if depths:
        depth = np.float32(1 + rng.integers(0, depths, n))
    depth = depth[np.lexsort((depth, pixel))]
    alpha = rng.uniform(0, 1, n) ** 2
    if opaque:
        alpha[rng.random(n) < 0.2] = 1
    color = np.column_stack([alpha[:, None] * rng.uniform(0, 2, (n, 3)), alpha]).astype(np.float32)
    found = rng.integers(0, ids, (n, 1)).astype(np.int32) if ids else np.empty((n, 0), np.int32)
    left = np.ones(PIXELS, np.float32)
    names, paths = (("primId",), tuple(f"/{k}" for k in range(ids))) if ids else ((), ())
    return DeepSamples(counts, depth, depth, color, left, found, names, paths)


def merged(pictures: list[DeepSamples], error: float = 0.0) -> DeepSamples:
    device = CpuDevice(threads=2)
    accumulator = DeepAccumulator(device, len(pictures), 10**6)
    for each in pictures:
        accumulator.add(each)
    return accumulator.finish(error)


def in_front(samples: DeepSamples, pixel: int, depth: float, far: bool = False) -> np.ndarray:
    """RGBA of the samples of a pixel up to a depth, by the over operator in float64."""
    ends = np.cumsum(samples.counts.ravel().astype(int))
    first = int(ends[pixel]) - int(samples.counts.ravel()[pixel])
    image = np.zeros(4)
    for j in range(first, int(ends[pixel])):
        if (samples.depth_back if far else samples.depth)[j] <= depth:
            image += (1 - image[3]) * samples.color[j].astype(np.float64)
    return image


@pytest.mark.parametrize("count", [1, 2, 3, 8, 13])
@pytest.mark.parametrize("depths", [0, 6])
@pytest.mark.parametrize("opaque", [False, True])
def test_samples_in_front_of_any_depth_are_the_average(count, depths, opaque) -> None:
    """Colour and opacity, of numbers of pictures that are powers of two and not. Oracle: the over
    operator in float64, on each picture alone."""
    pictures = [deep_picture(seed, depths=depths, opaque=opaque) for seed in range(count)]
    found = merged(pictures)
    for pixel in range(found.counts.size):
        for depth in (*np.linspace(0.5, 9.5, 12), np.inf):
            expected = np.mean([in_front(each, pixel, depth) for each in pictures], axis=0)
            np.testing.assert_allclose(in_front(found, pixel, depth), expected, atol=2e-6)
    assert (found.color[:, 3] <= 1).all() and found.counts[0, 0] == 0


def test_equal_depths_are_one_sample() -> None:
    """Oracle: the number of different depths of a pixel, in pictures whose own depths differ."""
    pictures = [deep_picture(0), deep_picture(0), deep_picture(0)]
    found = merged(pictures)
    np.testing.assert_array_equal(found.counts, pictures[0].counts)
    np.testing.assert_array_equal(found.depth, pictures[0].depth)
    np.testing.assert_allclose(found.color, pictures[0].color, atol=2e-5)


@pytest.mark.parametrize("ids", [0, 3])
@pytest.mark.parametrize("error", [0.003, 0.03, 0.1])
def test_merging_changes_the_opacity_in_front_by_the_error_at_most(error, ids) -> None:
    """Whether a merged sample is all at its near or at its far end. Oracle: the samples that are
    not merged."""
    pictures = [deep_picture(seed, ids=ids) for seed in range(16)]
    exact, found = merged(pictures), merged(pictures, error)
    assert len(found.depth) < len(exact.depth)
    ends, first = np.cumsum(exact.counts.ravel().astype(int)), 0
    worst = 0.0
    for pixel, end in enumerate(ends):
        for depth in exact.depth[first:end]:
            expected = in_front(exact, pixel, depth)[3]
            for far in (False, True):
                worst = max(worst, abs(in_front(found, pixel, depth, far)[3] - expected))
        first = end
    assert 0.2 * error < worst <= error * 1.001
    for pixel in range(len(ends)):
        np.testing.assert_allclose(
            in_front(found, pixel, np.inf), in_front(exact, pixel, np.inf), atol=2e-6
        )
    assert (found.depth_back >= found.depth).all()


@pytest.mark.parametrize("error", [0.0, 0.1])
def test_samples_never_mix_ids(error) -> None:
    """Of pictures that number their prims differently. Oracle: the weight of each path in each
    pixel, summed in float64 over the pictures."""
    pictures = [deep_picture(seed, depths=4, ids=3) for seed in range(8)]
    pictures[3] = DeepSamples(
        **{name: getattr(pictures[3], name) for name in DeepSamples.__slots__ if name != "prims"},
        prims=("/2", "/new", "/0"),
    )
    found = merged(pictures, error)

    def weights(samples: DeepSamples) -> dict[tuple[int, str], float]:
        sums: dict[tuple[int, str], float] = {}
        j = 0
        for pixel, count in enumerate(samples.counts.ravel()):
            through = 1.0
            for _ in range(count):
                own = float(samples.color[j, 3])
                key = pixel, samples.prims[samples.ids[j, 0]]
                sums[key] = sums.get(key, 0.0) + through * own
                through *= 1 - own
                j += 1
        return sums

    expected: dict[tuple[int, str], float] = {}
    for each in pictures:
        for key, weight in weights(each).items():
            expected[key] = expected.get(key, 0.0) + weight / len(pictures)
    sums = weights(found)
    assert {path for _, path in sums} == {"/0", "/1", "/2", "/new"}
    assert sums.keys() == {key for key, weight in expected.items() if weight > 0}
    for key, weight in sums.items():
        assert weight == pytest.approx(expected[key], abs=2e-6)


def test_more_than_may_be_held_is_an_error() -> None:
    """Oracle: the number of samples; those of equal depth count once when they are joined, which is
    after the second and the fourth picture."""
    picture = deep_picture(1)
    n = len(picture.depth)
    DeepAccumulator(CpuDevice(), 4, n).add(picture)
    with pytest.raises(TooManyEntries):
        DeepAccumulator(CpuDevice(), 4, n - 1).add(picture)
    same = DeepAccumulator(CpuDevice(), 4, 2 * n)
    for held in (n, n, 2 * n, 2 * n):
        same.add(picture)
        assert same.held == held
    assert len(same.finish(0.0).depth) == n


def test_joining_n_pictures_takes_n_log_n(monkeypatch) -> None:
    """Oracle: of pictures without common depths, each sample is copied once for each level of a
    binary tree; the samples are those of all pictures."""
    joined = DeepAccumulator._joined
    copied = []

    def counting(self, first, last):
        found = joined(self, first, last)
        copied.append(len(found.depth))
        return found

    monkeypatch.setattr(DeepAccumulator, "_joined", counting)
    picture = deep_picture(1)
    n, count = len(picture.depth), 64
    accumulator = DeepAccumulator(CpuDevice(), count, count * n)
    for i in range(count):
        accumulator.add(replace(picture, depth=picture.depth + np.float32(1e-3 * (i + 1))))
    total = len(accumulator.finish(0.0).depth)
    assert total == count * n == accumulator.held
    assert sum(copied) == count * n * 6
