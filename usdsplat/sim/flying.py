"""The look of splats that travel to a target: even matter where their surface is torn.

On its way the surface of a capture is stretched. Where neighbours stay together, splats keep their
look. Where they are torn apart, flat splats would be seen as shreds, faint ones as haze, and single
light and dark ones as glitter. There each is round instead, large enough to close the gaps but no
larger than about the distance of the points that travel with it, either opaque or not there, and
has the mean colour of the capture around it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from usdsplat.core.cloud import F32, I64, SplatCloud

TAKES_OFF, LANDS = 0.2, 0.85
"""Progress up to which splats may become grains, and from which grains become splats again."""
WHOLE, TORN = 1.4, 2.6
"""Stretch up to which splats keep their look, and from which they are grains."""
LARGEST = 0.38
"""Largest standard deviation of a grain, in spacings of the points there."""
MOST_GROWTH = 1.6
"""Largest factor of the growth of grains, which follows the stretch."""
SEEN = (0.08, 0.35)
"""Opacities between which it is decided whether a grain is seen."""
OPAQUE = 0.96


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Flight:
    """The splats of one frame that have started and have not arrived yet, m of them."""

    rows: I64
    """Their rows, shape (m,)."""
    part: F32
    """Their progress, between 0 and 1, shape (m,)."""
    spacings: tuple[float, float]
    """Distance of neighbouring points of the map, at rest and on the target [unit]."""
    stretch: F32
    """Stretch of the surface around each splat, shape (m,): mean distance of the points there to
    their neighbours, divided by the distance that an even motion would give. 1: not stretched."""
    colors: F32
    """Mean colours of the capture around them, coefficients of degree 0, shape (m, 3)."""

    def seen(self, cloud: SplatCloud) -> SplatCloud:
        """Return the splats of the frame with the look of their flight."""
        grain = ramp(self.part, 0, TAKES_OFF) * ramp(1 - self.part, 0, 1 - LANDS)
        grain *= ramp(self.stretch, WHOLE, TORN)
        torn = np.flatnonzero(grain > 0)
        if not len(torn):
            return cloud
        rows, p, grain, stretch = self.rows[torn], self.part[torn], grain[torn], self.stretch[torn]
        sizes = np.maximum(cloud.scales[rows], np.float32(1e-12))
        largest = sizes.max(axis=1)
        middle = np.maximum(sizes.sum(axis=1) - largest - sizes.min(axis=1), np.float32(1e-12))
        grown = np.clip(stretch, 1, MOST_GROWTH)
        first, last = (np.float32(LARGEST * each) for each in self.spacings)
        round_ = grown * np.minimum(np.sqrt(largest * middle), first * (1 - p) + last * p)
        scales, opacities, sh = cloud.scales.copy(), cloud.opacities.copy(), cloud.sh.copy()
        scales[rows] = sizes ** (1 - grain[:, None]) * (round_**grain)[:, None]
        low, high = SEEN
        whole = OPAQUE * ramp(opacities[rows], low, high)
        opacities[rows] += grain * (whole.astype(np.float32) - opacities[rows])
        left = (1 - grain)[:, None, None]  # of what is not finite, nothing is left in a grain
        colors = np.where(left > 0, sh[rows] * left, 0).astype(np.float32)
        colors[:, 0] += grain[:, None] * self.colors[torn]
        sh[rows] = colors
        return replace(cloud, scales=scales, opacities=opacities, sh=sh)


def ramp(values: F32, first: float, last: float) -> F32:
    """Return the smoothstep of values between two of them: 0 up to `first`, 1 from `last` on."""
    part = np.clip((values - first) / (last - first), 0, 1)
    return np.asarray(part * part * (3 - 2 * part), np.float32)
