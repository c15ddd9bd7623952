"""About how long pictures take on a CPU, said before any is drawn.

The costs were measured (`benchmarks.frame`, `benchmarks.passes`; two threads, medians) and are good
to a factor of two: enough to know whether a GPU is worth its start.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from dataclasses import dataclass

from usdsplat.delegate.render_settings import RenderSettings

PER_SPLAT = 70e-9
"""[s] Of one thread, for a splat of a sample: projecting, shading, sorting."""
PER_PIXEL = 65e-9
"""[s] Of one thread, for a pixel of a sample in which colour is blended."""
PASSES = {"color": 1.0, "cryptoObject": 11.0}
"""How often a pixel is blended for an AOV, about; OTHER for those that are not here."""
OTHER = 0.7
BY_RAY, DEEP = 20.0, 6.0
"""How much longer contributions take that each pixel sorts for itself, and that are kept."""
SHARE = 0.7
"""Fraction of each thread's time that is useful when several threads work [0..1]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Work:
    """Some pictures of one kind."""

    pixels: int
    """Pixels of all pictures together."""
    pictures: int
    settings: RenderSettings
    aovs: Collection[str] = ("color",)
    deep: bool = False

    def seconds(self, splats: int, threads: int | None = None) -> float:
        """Return about how long they take on the CPU [s].

        Args:
            splats: That the scene draws.
            threads: How many there are; None for all of this machine.
        """
        passes = sum(PASSES.get(name, OTHER) for name in self.aovs)
        if self.deep:
            passes += DEEP
        if self.settings.sorting == "rayHitDistance":
            passes *= BY_RAY
        once = PER_SPLAT * splats * self.pictures + PER_PIXEL * passes * self.pixels
        count = threads or os.cpu_count() or 1
        return once * self.settings.samples / (1 if count == 1 else SHARE * count)
