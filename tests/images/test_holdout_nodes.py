"""Tests of the transmittance of deep samples as nodes."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

from usdsplat.images.holdout_nodes import nodes_of
from usdsplat.kernels import reference_rays
from usdsplat.kernels.walk import held_through


def samples(seed, pixels=60, most=7):
    """Random samples that overlap, some without extent and some opaque: offsets, front, back,
    alpha."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, most + 1, pixels)
    n = int(counts.sum())
    front = rng.uniform(1, 9, n).astype(np.float32)
    extent = rng.choice([0, 1e-3, 0.5, 4], n).astype(np.float32)
    alpha = rng.uniform(0, 1, n).astype(np.float32)
    alpha[rng.random(n) < 0.1] = 1
    return np.concatenate([[0], np.cumsum(counts)]), front, front + extent, alpha


def held(nodes, pixel, depths):
    """What the nodes let through in front of each depth."""
    return np.array([held_through(*nodes, pixel, np.float32(each)) for each in depths])


def psnr(found, expected):
    """For a peak of 1 [dB]."""
    return -10 * np.log10(np.mean(np.square(np.subtract(found, expected))) + 1e-30)


@pytest.mark.parametrize("seed", range(3))
def test_samples_that_overlap_multiply(seed):
    """Oracle: the reference's product over samples in float64."""
    offsets, front, back, alpha = samples(seed)
    nodes = nodes_of(offsets, front, back, alpha)
    assert np.diff(nodes[0]).tolist() == (2 * np.diff(offsets)).tolist()
    found, expected = [], []
    for pixel in range(len(offsets) - 1):
        part = slice(offsets[pixel], offsets[pixel + 1])
        ends = np.concatenate([front[part], back[part]])
        depths = np.concatenate([ends, np.linspace(0, 14, 57)]).astype(np.float32)
        found.append(held(nodes, pixel, depths))
        pixel_of = [each[part].astype(np.float64) for each in (front, back, alpha)]
        expected.append(reference_rays.held_through(*pixel_of, depths.astype(np.float64)))
    found, expected = np.concatenate(found), np.concatenate(expected)
    assert np.abs(found - expected).max() < 2e-3  # a depth is a thousandth of the thinnest extent
    assert psnr(found, expected) > 80


@pytest.mark.parametrize("seed", range(3))
def test_samples_that_begin_or_end_at_the_same_depths_multiply(seed):
    """Ends are whole numbers, so that most coincide with those of other samples; some extents are
    negative, some samples opaque or almost so. Oracle: the reference's product in float64."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 9, 200)
    n = int(counts.sum())
    front = rng.integers(1, 9, n).astype(np.float32)
    back = front + rng.integers(-1, 4, n).astype(np.float32)
    alpha = rng.choice([0, 1e-7, 0.1, 0.5, 0.9999, 1], n).astype(np.float32)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    nodes = nodes_of(offsets, front, back, alpha)
    depths = np.arange(0, 14, 0.25)
    for pixel in range(len(counts)):
        part = slice(offsets[pixel], offsets[pixel + 1])
        sample = [each[part].astype(np.float64) for each in (front, back, alpha)]
        expected = reference_rays.held_through(*sample, depths)
        np.testing.assert_allclose(held(nodes, pixel, depths), expected, atol=2e-6)


@pytest.mark.parametrize("seed", range(3))
def test_openexr_splits_and_merges_to_the_same(seed):
    """Oracle: OpenImageIO's DeepData: split at the depth, sorted, overlaps merged; what is in front
    of the depth, composited."""
    offsets, front, back, alpha = samples(seed, pixels=20)
    nodes = nodes_of(offsets, front, back, alpha)
    names = ("A", "Z", "ZBack")
    found, expected = [], []
    for pixel in range(len(offsets) - 1):
        for depth in np.linspace(0.5, 13.5, 27).astype(np.float32):
            data = oiio.DeepData()
            data.init(1, 3, "float", names)
            part = range(offsets[pixel], offsets[pixel + 1])
            data.set_samples(0, len(part))
            for sample, i in enumerate(part):
                for channel, values in enumerate((alpha, front, back)):
                    data.set_deep_value(0, channel, sample, float(values[i]))
            data.split(0, float(depth))
            data.sort(0)
            data.merge_overlaps(0)
            passed = 1.0
            for sample in range(data.samples(0)):
                a, near = (data.deep_value(0, channel, sample) for channel in (0, 1))
                passed *= 1 - a if near < depth else 1
            expected.append(passed)
            found.extend(held(nodes, pixel, [depth]))
    assert psnr(found, expected) > 60


def test_a_pixel_does_not_depend_on_others():
    """Oracle: each pixel alone, bit for bit."""
    offsets, front, back, alpha = samples(5)
    starts, depths, through = nodes_of(offsets, front, back, alpha)
    for pixel in range(len(offsets) - 1):
        part = slice(offsets[pixel], offsets[pixel + 1])
        count = np.array([0, part.stop - part.start])
        _, depth, passed = nodes_of(count, front[part], back[part], alpha[part])
        alone = slice(starts[pixel], starts[pixel + 1])
        np.testing.assert_array_equal(depth, depths[alone])
        np.testing.assert_array_equal(passed, through[alone])


def test_samples_without_a_finite_depth_or_opacity_have_no_effect():
    """Oracle: the rule; opacities are kept within 0..1, a ZBack that is not behind Z is none, and
    an opaque sample hides everything behind its front."""
    nan, inf = np.nan, np.inf
    front = np.float32([2, 1, nan, -inf, inf, 4, 5, 6, 7])
    back = np.float32([2, 1, 3, 3, inf, 4, nan, 3, 9])
    alpha = np.float32([0.5, nan, 1, 1, 1, -1, 0.5, 0.5, 7])
    nodes = nodes_of(np.array([0, 9]), front, back, alpha)
    assert nodes[1].tolist() == [2, 2, 5, 5, 6, 6, 7, 7]
    assert nodes[2].tolist() == [1, 0.5, 0.5, 0.25, 0.25, 0.125, 0.125, 0]
    assert held(nodes, 0, [2, 2.1, 5, 5.1, 6.1, 7, 7.1]).tolist() == [
        1, 0.5, 0.5, 0.25, 0.125, 0.125, 0,
    ]  # fmt: skip


def test_what_remains_behind_a_thin_sample_is_exact():
    """A sample of almost no extent within a long one. Oracle: the reference."""
    front, back = np.float32([1, 1.5, 8]), np.float32([9, np.nextafter(np.float32(1.5), 2), 8])
    alpha = np.float32([0.3, 0.999, 0.5])
    nodes = nodes_of(np.array([0, 3]), front, back, alpha)
    depths = np.linspace(0.5, 10, 77)
    expected = reference_rays.held_through(
        front.astype(np.float64), back.astype(np.float64), alpha.astype(np.float64), depths
    )
    np.testing.assert_allclose(held(nodes, 0, depths), expected, rtol=1e-5)
