"""Composite deep samples to a flat picture."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.render.deep_samples import DeepSamples


def flattened(samples: DeepSamples) -> F32:
    """Return the samples of each pixel composited near over far, shape (h, w, 4)."""
    counts = samples.counts.ravel().astype(np.int64)
    starts = np.cumsum(counts) - counts
    image = np.zeros((len(counts), 4), np.float32)
    through = np.ones(len(counts), np.float32)
    rest = np.flatnonzero(counts)
    k = 0
    while len(rest):
        color = samples.color[starts[rest] + k]
        image[rest] += through[rest, None] * color
        through[rest] *= 1 - color[:, 3]
        k += 1
        rest = rest[counts[rest] > k]
    return image.reshape(*samples.counts.shape, 4)
