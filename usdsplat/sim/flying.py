"""The look of splats that travel to a target: opaque grains.

On its way the surface of a capture is stretched and torn: its flat splats would be seen as shreds
and its faint ones as haze. In flight each is round instead, no larger than the distance of the
points that travel with it, and either opaque or not there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from usdsplat.core.cloud import F32, SplatCloud

TAKES_OFF, LANDS = 0.2, 0.85
"""Progress up to which splats become grains, and from which grains become splats again."""
LARGEST = 0.38
"""Largest standard deviation of a grain, in spacings."""
SEEN = (0.08, 0.35)
"""Opacities between which it is decided whether a splat is seen in flight."""
OPAQUE = 0.96


def in_flight(cloud: SplatCloud, part: F32, spacing: float, target: float) -> SplatCloud:
    """Return splats with the look of their flight; those that are not on their way are unchanged.

    Args:
        cloud: Splats of a frame.
        part: Their progress, 0 to 1, shape (n,).
        spacing, target: Distance of the points that carry them, at rest and on the target [unit].
    """
    rows = np.flatnonzero((part > 0) & (part < 1))
    if not len(rows):
        return cloud
    p = part[rows]
    grain = ramp(p, 0, TAKES_OFF) * ramp(1 - p, 0, 1 - LANDS)
    sizes = np.maximum(cloud.scales[rows], np.float32(1e-12))
    largest = sizes.max(axis=1)
    middle = np.maximum(sizes.sum(axis=1) - largest - sizes.min(axis=1), np.float32(1e-12))
    limit = np.float32(LARGEST) * (np.float32(spacing) * (1 - p) + np.float32(target) * p)
    round_ = np.minimum(np.sqrt(largest * middle), limit)
    scales, opacities = cloud.scales.copy(), cloud.opacities.copy()
    scales[rows] = sizes ** (1 - grain[:, None]) * (round_**grain)[:, None]
    low, high = SEEN
    whole = OPAQUE * ramp(opacities[rows], low, high)
    opacities[rows] += grain * (whole.astype(np.float32) - opacities[rows])
    return replace(cloud, scales=scales, opacities=opacities)


def ramp(values: F32, first: float, last: float) -> F32:
    """Return the smoothstep of values between two of them: 0 up to `first`, 1 from `last` on."""
    part = np.clip((values - first) / (last - first), 0, 1)
    return np.asarray(part * part * (3 - 2 * part), np.float32)
