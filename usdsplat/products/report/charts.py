"""Collect statistics of splats, and count them in histograms."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.sh import dc_to_rgb
from usdsplat.products.report.values import Histogram
from usdsplat.products.summary import anisotropies, mean_scales

BARS = 60
_INNER = (0.1, 99.9)
"""Percentiles of the first and the last edge. Values outside are counted in the first and the last
bar."""
_LUMA = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Numbers:
    """Statistics of all clouds, one value per splat, each in its own unit."""

    scales: F64
    """Geometric means of the standard deviations [scene unit]."""
    opacities: F64
    anisotropies: F64
    """Ratios of the longest to the shortest standard deviation."""
    brightness: F64
    """Brightness of the degree-0 colour."""

    @classmethod
    def of(cls, clouds: Iterable[SplatCloud]) -> Numbers:
        """Collect the statistics of clouds."""
        rows = [
            (
                mean_scales(cloud),
                cloud.opacities.astype(np.float64),
                anisotropies(cloud),
                dc_to_rgb(cloud.sh[:, 0]).astype(np.float64) @ _LUMA,
            )
            for cloud in clouds
        ]
        joined = [np.concatenate([np.empty(0), *columns]) for columns in zip(*rows, strict=True)]
        columns = joined or [np.empty(0)] * 4
        names = ("scales", "opacities", "anisotropies", "brightness")
        return cls(**dict(zip(names, columns, strict=True)))

    def histograms(self) -> tuple[Histogram, ...]:
        """Return the histograms that have at least one value."""
        found = (
            histogram("scale, mean of three deviations", self.scales, logarithmic=True),
            histogram("opacity", self.opacities, limits=(0.0, 1.0)),
            histogram("anisotropy, longest over shortest", self.anisotropies, logarithmic=True),
            histogram("brightness of the degree-0 colour", self.brightness),
        )
        return tuple(each for each in found if each is not None)


def histogram(
    title: str,
    values: F64,
    *,
    logarithmic: bool = False,
    limits: tuple[float, float] | None = None,
) -> Histogram | None:
    """Count values in `BARS` bars.

    Args:
        title: Title of the histogram.
        values: The values, shape (n,).
        logarithmic: Whether bars are evenly spaced on a logarithmic axis. Only positive
            values count then.
        limits: First and last edge; None for the percentiles `_INNER`.

    Returns:
        The histogram; None if no value counts.
    """
    counted = values[np.isfinite(values) & ((values > 0) | (not logarithmic))]
    if not len(counted):
        return None
    low, high = np.percentile(counted, _INNER) if limits is None else limits
    if logarithmic:
        low, high = (low, high) if high > 1.01 * low else (0.5 * low, 2 * high)
        edges = np.geomspace(low, high, BARS + 1)
    else:
        low, high = (low, high) if high > low else (low - 0.5, high + 0.5)
        edges = np.linspace(low, high, BARS + 1)
    counts, _ = np.histogram(np.clip(counted, edges[0], edges[-1]), edges)
    return Histogram(
        title=title,
        edges=edges,
        counts=counts.astype(np.int64),
        logarithmic=logarithmic,
        median=float(np.median(counted)),
        beyond=len(values) - len(counted),
    )
