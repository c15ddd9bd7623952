"""Tests of deep samples that flatten to the beauty."""

from __future__ import annotations

import numpy as np
import pytest

from tests.flattening import over
from usdsplat.products.deep_color import scaled_to
from usdsplat.render.deep_samples import DeepSamples


def random_samples(seed):
    """Samples of 12 x 9 pixels, some without any, and a beauty that differs from their flattened
    colour."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 12, (12, 9)).astype(np.uint32)
    n = int(counts.sum())
    alpha = rng.uniform(0, 0.999, (n, 1)).astype(np.float32)
    color = np.concatenate([rng.uniform(0, 2, (n, 3)).astype(np.float32) * alpha, alpha], axis=1)
    depth = np.sort(rng.uniform(1, 9, n)).astype(np.float32)
    samples = DeepSamples(counts, depth, depth, color, np.ones(counts.shape, np.float32))
    beauty = over(counts, color) * rng.uniform(0.3, 1.7, (12, 9, 1))
    return samples, beauty.astype(np.float32)


@pytest.mark.parametrize(("dtype", "least"), [(np.float32, 120), (np.float16, 65)])
def test_samples_flatten_to_the_beauty(dtype, least):
    """Oracle: the over operator in float64, of the values as the file has them."""
    samples, beauty = random_samples(1)
    found = scaled_to(samples, beauty, dtype)
    flat = over(found.counts, found.color.astype(np.float64))
    error = (flat - beauty)[..., :3]
    assert -10 * np.log10(np.mean(error**2)) > least
    np.testing.assert_array_equal(found.color[:, 3], samples.color[:, 3].astype(dtype))
    np.testing.assert_array_equal(found.color.astype(dtype), found.color)
    assert found.depth is samples.depth


def test_a_pixel_keeps_the_ratios_of_its_samples():
    """Oracle: one factor for each channel of a pixel, that of the beauty and the flat colour."""
    samples, beauty = random_samples(2)
    found = scaled_to(samples, beauty, np.float32)
    flat = over(samples.counts, samples.color)
    factor = np.divide(beauty, flat, out=np.ones_like(flat), where=flat > 0)[..., :3]
    each = np.repeat(factor.reshape(-1, 3), samples.counts.ravel(), axis=0)
    np.testing.assert_allclose(found.color[:, :3], each * samples.color[:, :3], rtol=1e-4)


@pytest.mark.parametrize("dark", [0.0, 1e-9, 1e-3])
def test_light_that_is_not_in_the_samples_is_spread_by_opacity(dark):
    """Black or dark samples under a bright beauty. Oracle: the over operator; the two samples of
    the pixel have the same colour before premultiplication."""
    alpha = np.float32([[0.5], [0.9]])
    color = np.concatenate([np.repeat(alpha, 3, axis=1) * np.float32(dark), alpha], axis=1)
    depth, one = np.float32([1, 2]), np.ones((1, 1), np.float32)
    samples = DeepSamples(np.uint32([[2]]), depth, depth, color, one)
    beauty = np.float32([[[0.3, 0.0, -0.1, 0.95]]])
    found = scaled_to(samples, beauty, np.float32)
    np.testing.assert_allclose(
        over(found.counts, found.color)[0, 0, :3], beauty[0, 0, :3], atol=1e-6
    )
    straight = found.color[:, :3] / alpha
    np.testing.assert_allclose(straight[0], straight[1], rtol=1e-5, atol=1e-7)


def test_pixels_without_samples_or_coverage_stay_as_they_are():
    """Oracle: the samples; a beauty that is not 0 there changes nothing and is not divided by 0."""
    color = np.zeros((1, 4), np.float32)
    depth, left = np.ones(1, np.float32), np.ones((1, 2), np.float32)
    samples = DeepSamples(np.uint32([[0, 1]]), depth, depth, color, left)
    found = scaled_to(samples, np.ones((1, 2, 4), np.float32), np.float16)
    np.testing.assert_array_equal(found.color, color)
