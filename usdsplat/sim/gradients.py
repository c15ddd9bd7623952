"""Measure the gradient of a deformation from neighbours, where no formula gives it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, I32
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import mls
from usdsplat.sim.transport import U8

EVERYONE = np.empty(0, np.uint8)
POINTS = np.empty(0, np.float32)
NO_NORMALS = np.empty((0, 3), np.float32)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LocalGradients:
    """Rest positions and neighbours of splats; immutable, made by `of`."""

    rest: F32
    """Rest positions [unit], shape (n, 3)."""
    neighbours: I32
    """Neighbours, shape (n, k)."""
    weights: F32
    """Weight of each neighbour's displacement [1/unit], shape (n, k, 3)."""
    sheets: F32
    """Normals at rest and their weights, shape (n, 2, 3)."""

    @classmethod
    def of(
        cls, device: Device, rest: F32, neighbours: I32, normals: F32 | None = None
    ) -> LocalGradients:
        """Prepare for `measure`.

        Args:
            rest: Rest positions [unit], shape (n, 3); kept, so they must not change.
            neighbours: Neighbours of each splat, -1 for none, shape (n, k); 12 are enough.
            normals: Normals of the sheet that splats are in, of any sign, length 1, or 0 outside of
                sheets, shape (n, 3). Without them a sheet is only detected where it is flat to 1%
                of its neighbourhood.
        """
        n, k = neighbours.shape
        weights, sheets = np.empty((n, k, 3), np.float32), np.empty((n, 2, 3), np.float32)
        given = NO_NORMALS if normals is None else normals
        device.run(mls.prepare, rest, neighbours, given, weights, sheets)
        return cls(rest=rest, neighbours=neighbours, weights=weights, sheets=sheets)

    def measure(
        self,
        device: Device,
        positions: F32,
        out: F32,
        *,
        sizes: F32 | None = None,
        rows: U8 | None = None,
    ) -> None:
        """Measure the gradient of the deformation from rest to now, by moving least squares.

        It is exact for linear deformations where neighbours span space. On sheets the normal
        rotates with the sheet and the thickness stays. With neighbours on a line, or none, the
        directions that cannot be measured keep the identity. A splat whose neighbours all moved
        with it gets the identity bit for bit.

        Where neighbours move apart in a way that is far from linear, F is reduced towards the
        identity: the stretch if the displacements that F does not explain exceed a tenth of the
        rest distances, the rotation if they exceed three tenths.

        Args:
            positions: Positions now [unit], shape (n, 3).
            out: Receives F, shape (n, 3, 3).
            sizes: Extent of the splats [unit], shape (n,): those that extend beyond all neighbours
                are deformed in part only. None for points.
            rows: 1 for the splats to measure, shape (n,); other rows of `out` do not change. None
                measures all.

        Source:
            Müller et al. 2004, "Point based animation of elastic, plastic and melting objects".
        """
        moved = positions - self.rest
        chosen = EVERYONE if rows is None else rows
        device.run(
            mls.gradients, self.rest, moved, self.neighbours, self.weights, self.sheets,
            POINTS if sizes is None else sizes, chosen, out,
        )  # fmt: skip
