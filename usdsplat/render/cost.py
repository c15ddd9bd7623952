"""Estimate how long pictures take on the CPU, before any is drawn.

The costs were measured by `benchmarks.frame` and `benchmarks.passes` (two threads, medians). They
are right within a factor of two, which is enough to decide whether starting a GPU is worth it.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from dataclasses import dataclass

from usdsplat.render.settings import RenderSettings

PER_SPLAT = 70e-9
"""Projecting, shading and sorting one splat in one sample [s of one thread]."""
PER_PIXEL = 65e-9
"""Blending colour in one pixel of one sample [s of one thread]."""
PASSES = {"color": 1.0, "cryptoObject": 11.0}
"""AOV -> its cost, in units of PER_PIXEL."""
OTHER = 0.7
"""Cost of an AOV that PASSES does not list, in units of PER_PIXEL."""
BY_RAY = 20.0
"""Factor on the cost of a pixel when each pixel sorts its own splats (rayHitDistance)."""
DEEP = 6.0
"""Cost of a deep picture, in units of PER_PIXEL."""
SHARE = 0.7
"""Parallel efficiency: speedup divided by the number of threads [0..1]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Work:
    """Pictures that share their settings."""

    pixels: int
    """Of all pictures together."""
    pictures: int
    """How many."""
    settings: RenderSettings
    aovs: Collection[str] = ("color",)
    deep: bool = False

    def seconds(self, splats: int, threads: int | None = None) -> float:
        """Return the estimated time on the CPU [s].

        Args:
            splats: Number of splats in the scene.
            threads: Number of threads; None for all cores.
        """
        passes = sum(PASSES.get(name, OTHER) for name in self.aovs)
        if self.deep:
            passes += DEEP
        if self.settings.sorting == "rayHitDistance":
            passes *= BY_RAY
        once = PER_SPLAT * splats * self.pictures + PER_PIXEL * passes * self.pixels
        count = threads or os.cpu_count() or 1
        return once * self.settings.samples / (1 if count == 1 else SHARE * count)
