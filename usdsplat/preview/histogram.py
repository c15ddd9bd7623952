"""Histogram of the displayed picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.preview.document import Document

BINS = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class Histogram:
    """Counts of the code values 0 to 255 of the last picture."""

    red: tuple[int, ...]
    green: tuple[int, ...]
    blue: tuple[int, ...]
    pixels: int
    """Number of counted pixels."""


def histogram(document: Document) -> Histogram | None:
    """Return the histogram of the displayed image with background; None before the first
    picture."""
    if document.shown is None:
        return None
    image = document.shown.picture.image
    red, green, blue = (
        tuple(np.bincount(image[..., channel].ravel(), minlength=BINS).tolist())
        for channel in range(3)
    )
    return Histogram(red=red, green=green, blue=blue, pixels=image.shape[0] * image.shape[1])
