"""Normals, confidence and occlusion of the splats of a field: authored, or computed on the CPU.

They are computed by the CPU for pictures of each device, which are therefore the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, I32
from usdsplat.core.progress import phase
from usdsplat.core.sh import dc_to_rgb
from usdsplat.kernels.devices import open_device
from usdsplat.kernels.points.surface_normals import surface_normals
from usdsplat.render.specs import FieldSpec, SurfaceSpec

PER_SPLAT, WORKING, GRIDS = 20, 700, 96 << 20
"""Bytes per splat of the result, those while it is computed, and those of grids."""


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceValues:
    """Normals and facts of n splats, see `kernels.feature.features`."""

    normals: F32
    """Unit vectors in local space, shape (n, 3); 0 where there is none."""
    facts: F32
    """Confidence and occlusion, [0..1], shape (n, 2)."""

    def take(self, rows: I32) -> SurfaceValues:
        """Return those of some rows."""
        return SurfaceValues(self.normals[rows], self.facts[rows])


NO_SURFACE = SurfaceValues(np.empty((0, 3), np.float32), np.empty((0, 2), np.float32))
"""The thinnest axes of splats stand for their normals."""


def surface_values(spec: FieldSpec) -> SurfaceValues:
    """Return the authored normals of a field, or compute them."""
    if spec.surface is not None:
        return _authored(spec.surface)
    cloud = spec.cloud
    with phase("normals", work=len(cloud)):
        found = surface_normals(
            open_device("cpu"), cloud.positions, cloud.rotations, cloud.scales, cloud.opacities,
            dc_to_rgb(cloud.sh[:, 0]),
        )  # fmt: skip
    return SurfaceValues(found.normals, np.stack([found.confidence, found.occlusion], axis=1))


def _authored(spec: SurfaceSpec) -> SurfaceValues:
    """Return authored normals, with confidence 1 and occlusion 0 where these are not authored."""
    facts = np.zeros((len(spec.normals), 2), np.float32)
    facts[:, 0] = 1 if spec.confidence is None else np.clip(np.nan_to_num(spec.confidence), 0, 1)
    if spec.occlusion is not None:
        facts[:, 1] = np.clip(np.nan_to_num(spec.occlusion), 0, 1)
    return SurfaceValues(spec.normals, facts)


def working_bytes(counts: Sequence[int]) -> int:
    """Estimate the memory for fields with so many splats, which are computed one after the
    other."""
    return PER_SPLAT * sum(counts) + WORKING * max(counts) + GRIDS if counts else 0
