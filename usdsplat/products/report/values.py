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

    def place(self, value: float) -> float:
        """Return the position of a value between the first edge, 0, and the last, 1."""
        ends = np.array([self.edges[0], value, self.edges[-1]])
        low, at, high = np.log(ends) if self.logarithmic else ends
        return float((at - low) / (high - low))

    def summary(self) -> str:
        """Return a sentence with the median and the number of values that are not counted."""
        beyond = f", {self.beyond} left out" if self.beyond else ""
        return f"median {self.median:.4g}{beyond}"

    def ticks(self) -> list[tuple[float, str]]:
        """Return a few ticks as (position from 0 to 1, label)."""
        low, high = float(self.edges[0]), float(self.edges[-1])
        if not self.logarithmic:
            step = round_down((high - low) / 2)
            numbers = range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
            return [(self.place(i * step), f"{i * step:.6g}") for i in numbers]
        powers = range(math.ceil(math.log10(low)), math.floor(math.log10(high)) + 1)
        step = max(1, len(powers) // 4)
        values = [10.0**power for power in powers][::step] or [low, high]
        return [(self.place(value), f"{value:.3g}") for value in values]


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
