"""What a page shows, before anybody has decided how it looks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Histogram:
    """How often a number of the splats has which value."""

    title: str
    edges: F64
    """Of the bars, in the number's unit, rising, one more than bars."""
    counts: npt.NDArray[np.int64]
    """Splats in each bar."""
    logarithmic: bool
    """Whether the bars are evenly spaced in the logarithm."""
    median: float
    """Of the values that have a place."""
    beyond: int
    """Splats without a place: not finite, or 0 where that has no logarithm."""

    def summary(self) -> str:
        """The median, and how many splats have no place in the bars."""
        beyond = f", {self.beyond} left out" if self.beyond else ""
        return f"median {self.median:.4g}{beyond}"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Picture:
    """A side of it, without perspective."""

    title: str
    """Which side, and where the axes go."""
    pixels: npt.NDArray[np.uint8]
    """sRGB, shape (height, width, 3)."""
    bar: float
    """Length of a bar for scale, as a part of the width; all pictures have one scale."""
    bar_text: str
    """What it stands for."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Report:
    """All of a page."""

    title: str
    pictures: tuple[Picture, ...]
    """None where there is nothing to see."""
    histograms: tuple[Histogram, ...]
    lines: tuple[str, ...]
    """What `info` says, indented as it prints it."""


def round_down(most: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is no more than a positive number."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(power * factor for factor in (1, 2, 5) if power * factor <= most)
