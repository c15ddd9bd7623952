"""Hold the content of a page, independent of its file format."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Histogram:
    """Histogram of one value per splat."""

    title: str
    edges: F64
    """Edges of the bars in the unit of the values, ascending, shape (bars + 1,)."""
    counts: npt.NDArray[np.int64]
    """Number of splats in each bar, shape (bars,)."""
    logarithmic: bool
    """Whether the bars are evenly spaced on a logarithmic axis."""
    median: float
    """Median of the counted values."""
    beyond: int
    """Number of values that are not counted: those that are not finite or, on a logarithmic axis,
    not positive."""

    def summary(self) -> str:
        """Return a sentence with the median and the number of values that are not counted."""
        beyond = f", {self.beyond} left out" if self.beyond else ""
        return f"median {self.median:.4g}{beyond}"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Picture:
    """Orthographic picture from one side."""

    title: str
    """Side, and directions of the axes."""
    pixels: npt.NDArray[np.uint8]
    """sRGB, shape (height, width, 3)."""
    bar: float
    """Length of the scale bar as a fraction of the width; all pictures have the same scale."""
    bar_text: str
    """Length of the scale bar in scene units."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Report:
    """Content of a page."""

    title: str
    pictures: tuple[Picture, ...]
    """Pictures; empty if nothing is visible."""
    histograms: tuple[Histogram, ...]
    lines: tuple[str, ...]
    """Text of `info` with its indentation."""


def round_down(most: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is at most a positive number."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(power * factor for factor in (1, 2, 5) if power * factor <= most)
