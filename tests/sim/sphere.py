"""Carriers on the unit sphere, and a front over them."""

from __future__ import annotations

import numpy as np

from tests.sim.recipes import ball
from usdsplat.kernels.device import Device
from usdsplat.sim.carriers import Carriers

SPACING = 0.05
"""Distance of carriers, in radii of the sphere."""


def sphere(device: Device) -> Carriers:
    """Return carriers on the unit sphere."""
    return Carriers.of(device, ball(3000), distance=SPACING, seed=1)


def front_from_above(carriers: Carriers) -> np.ndarray:
    """Return the times of a front from the highest point, which takes two seconds to the lowest
    [s], shape (c,)."""
    return np.float32(np.arccos(np.clip(carriers.positions[:, 1], -1, 1)) * 2 / np.pi)
