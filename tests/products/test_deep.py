"""Tests of compositing deep samples, and of their difference from the flat picture."""

from __future__ import annotations

import numpy as np
import pytest

from tests.flattening import over
from usdsplat.products.deep import DeepReport
from usdsplat.products.flattening import flattened
from usdsplat.render.deep_samples import DeepSamples


def test_samples_flatten_near_over_far():
    """Oracle: loops in float64; pixels without a sample are 0."""
    rng = np.random.default_rng(0)
    counts = rng.integers(0, 9, (5, 7)).astype(np.uint32)
    n = int(counts.sum())
    alpha = rng.uniform(0, 1, (n, 1)).astype(np.float32)
    color = np.concatenate([rng.uniform(0, 2, (n, 3)).astype(np.float32) * alpha, alpha], axis=1)
    depth = np.zeros(n, np.float32)
    samples = DeepSamples(counts, depth, depth, color, np.ones(counts.shape, np.float32))
    np.testing.assert_allclose(flattened(samples), over(counts, color), atol=1e-6)


def test_decibels_are_of_a_peak_of_one():
    """Oracle: 0.1 everywhere is 20 dB."""
    report = DeepReport(pixels=12)
    report.add(np.full((3, 4, 3), -0.1, np.float32))
    assert report.decibels == pytest.approx(20, abs=1e-4)
    assert report.worst == pytest.approx(0.1)
