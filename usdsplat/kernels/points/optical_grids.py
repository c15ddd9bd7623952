"""Grids of the optical density of splats, for rays that need not be exact."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.kernels.device import Device
from usdsplat.kernels.normals import density as kernels

CELLS = 128
"""Number of cells of a grid along each axis."""
LEAST, MOST = 5, 12
"""Smallest and largest number of grids. Distant parts of rays use coarse ones."""
OUTSIDE = 0.005
"""Fraction of the splats that may lie outside all grids."""
FEW = 100_000
"""About how many splats are sampled to find the bounds of most of them."""
OPAQUE = 0.999
"""Opacity above which splats do not differ."""
TERMS = 2048
"""Number of values in the table of optical masses."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OpticalGrids:
    """Optical density of a cloud on nested grids."""

    positions: F32
    """Positions of the splats [finest cell], from the centre of the grids, shape (n, 3)."""
    density: F32
    """See `normals.density.deposit`."""
    cell: float
    """Edge of the finest cells [unit]."""
    extent: float
    """Half the width of the box around the centre that contains most splats [finest cell]."""
    middle: F64
    """Mean of the positions in this box [unit], shape (3,)."""

    @classmethod
    def of(
        cls,
        device: Device,
        positions: F32,
        rotations: F32,
        scales: F32,
        opacities: F32,
        *,
        cell: float,
    ) -> OpticalGrids:
        """Distribute the optical depth of splats over grids.

        Args:
            device: Runs the kernels.
            positions: [unit], shape (n, 3), n > 0. Splats that are not finite count nowhere.
            rotations: Unit quaternions, shape (n, 4), finite.
            scales: [unit], shape (n, 3), finite.
            opacities: [0..1], shape (n,), finite.
            cell: Edge of the finest cells [unit], > 0.
        """
        sound = np.isfinite(positions).all(axis=1)
        few = positions[sound][:: max(1, len(positions) // FEW)].astype(np.float64)
        centre = np.median(few, axis=0) if len(few) else np.zeros(3)
        local = ((positions - centre) / cell).astype(np.float32)
        farthest = np.abs((few - centre) / cell).max(axis=1) if len(few) else np.zeros(1)
        extent = max(1.0, float(np.quantile(farthest, 1 - OUTSIDE)))
        levels = 1 + math.ceil(math.log2(max(1.0, extent / (CELLS / 2 - 2))))
        levels = min(max(levels + 1, LEAST), MOST)
        sized = np.minimum(scales / np.float32(cell), np.float32(2.0**MOST * CELLS))
        masses = (_mass(opacities) * _area(sized)).astype(np.float32)
        density = np.empty((levels, CELLS, CELLS, CELLS), np.float32)
        device.run(kernels.deposit, local, rotations, sized, masses, density)
        return cls(
            positions=local,
            density=density,
            cell=cell,
            extent=extent,
            middle=few[farthest <= extent].mean(axis=0) if len(few) else centre,
        )


def _area(scales: F32) -> F64:
    """Return 2 pi times the product of the two larger standard deviations."""
    sized = np.sort(scales.astype(np.float64), axis=1)
    area: F64 = 2 * np.pi * sized[:, 1] * sized[:, 2]
    return area


def _mass(opacities: F32) -> F64:
    """Return the optical depth of splats, integrated over their area, per `_area`.

    The optical depth of a Gaussian of opacity o at q standard deviations is -ln(1 - o exp(-q^2/2)),
    whose integral over its area is the dilogarithm of o.
    """
    o = np.linspace(0, OPAQUE, TERMS)
    rate = np.ones(TERMS)
    rate[1:] = -np.log1p(-o[1:]) / o[1:]
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(o)
    return np.interp(opacities, o, np.concatenate([[0.0], np.cumsum(steps)]))
