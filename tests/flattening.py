"""Flatten deep samples in plain loops: an oracle that shares nothing with the product."""

from __future__ import annotations

import numpy as np


def over(counts, color):
    """Samples over one another, in plain loops and float64."""
    image = np.zeros((counts.size, 4))
    at = 0
    for pixel, count in enumerate(counts.ravel()):
        for sample in color[at : at + count].astype(np.float64):
            image[pixel] += (1 - image[pixel, 3]) * sample
        at += count
    return image.reshape(*counts.shape, 4)
