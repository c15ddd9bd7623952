"""The gradient of a deformation, measured where no formula gives it."""

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
    """Splats at rest and their neighbours there; `of` makes one, and another when rest moves."""

    rest: F32
    """[unit], shape (n, 3)."""
    neighbours: I32
    """Shape (n, k)."""
    weights: F32
    """How much each neighbour's displacement counts [1/unit], shape (n, k, 3)."""
    sheets: F32
    """Normals at rest and how much they count, shape (n, 2, 3)."""

    @classmethod
    def of(
        cls, device: Device, rest: F32, neighbours: I32, normals: F32 | None = None
    ) -> LocalGradients:
        """Prepare for `measure`.

        Args:
            rest: Positions at rest [unit], shape (n, 3); kept, so they must not change.
            neighbours: Of each splat, -1 for none, shape (n, k); 12 serve well.
            normals: Across the sheet that splats are in, of any sign, length 1, or 0 for splats
                that are in none, shape (n, 3). Without, a sheet is only seen where it is flat to
                1% of its neighbourhood.
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
        """Gradients of the deformation from rest to now, by moving least squares.

        Exact for what is linear, where neighbours span space. On sheets the normal turns with the
        sheet and the thickness stays; along a line, and alone, a splat keeps what is not known as
        it was. A splat none of whose neighbours moved against it gets the identity to the bit.

        Where neighbours went apart in a way that is nothing like linear, there is less and less of
        the stretch in F, from a tenth of the distances at rest on, and then of the rotation.

        Args:
            positions: Where splats are now [unit], shape (n, 3).
            out: Receives F, shape (n, 3, 3).
            sizes: How far splats reach [unit], shape (n,): those that reach beyond all neighbours
                are deformed only in part. None for points.
            rows: 1 for the splats to measure, shape (n,); the rest of `out` is left alone. None
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
