"""Estimate how long pictures take on the CPU, before any is rendered.

The costs were measured with `benchmarks.frame` and `benchmarks.passes` (two threads, medians). They
are accurate within a factor of two, which is enough to decide whether starting a GPU is worth it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from usdsplat.images.cryptomatte import LAYERS
from usdsplat.kernels.device import usual_threads
from usdsplat.render.settings import RenderSettings

PER_SPLAT = 70e-9
"""Time to project, shade and sort one splat in one sample [s of one thread]."""
PER_PIXEL = 65e-9
"""Time to blend colour in one pixel of one sample [s of one thread]."""
PASSES = {"color": 1.0, **dict.fromkeys(LAYERS, 11.0)}
"""AOV -> cost in units of PER_PIXEL."""
OTHER = 0.7
"""Cost of an AOV that PASSES does not list, in units of PER_PIXEL."""
BY_RAY = 20.0
"""Factor on the cost of a pixel if splats are sorted for each pixel (rayHitDistance)."""
DEEP = 6.0
"""Cost of a deep picture, in units of PER_PIXEL."""
SHARE = 0.7
"""Parallel efficiency: speedup divided by the number of threads [0..1]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Work:
    """Pictures that share their settings, as input of the time estimate."""

    pixels: int
    """Pixels of all pictures together."""
    pictures: int
    """Number of pictures."""
    settings: RenderSettings
    aovs: Collection[str] = ("color",)
    deep: bool = False

    def seconds(self, splats: int, threads: int | None = None) -> float:
        """Return the estimated time on the CPU [s].

        Args:
            splats: Number of splats in the scene.
            threads: Number of threads; None for `usual_threads`.
        """
        passes = sum(PASSES.get(name, OTHER) for name in self.aovs)
        if self.deep:
            passes = PASSES["color"] + DEEP * (1 if len(self.aovs) == 1 else 2)  # again for ids
        if self.settings.sorting == "rayHitDistance":
            passes *= BY_RAY
        once = PER_SPLAT * splats * self.pictures + PER_PIXEL * passes * self.pixels
        count = threads or usual_threads()
        return once * self.settings.samples / (1 if count == 1 else SHARE * count)
