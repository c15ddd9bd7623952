"""Maps of an even set of points onto a surface that keep neighbours and cover it evenly.

A plan of optimal transport between both sheets, aligned along each axis, covers the target evenly
but tears neighbours apart. Rounds of smoothing the images over neighbours and transporting them
again, over small distances, heal most of it. This is done for few points first, which all points
then interpolate.

Source: the alternation is that of Solomon et al. 2016, "Entropic metric alignment for
correspondence problems", with smoothing in place of distances between all pairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import transport_map as kernels
from usdsplat.sim.sheets import Goal, Sheet, relaxed
from usdsplat.sim.sinkhorn import transport

COARSE = 1500
"""Number of points that rounds start with."""
ROUNDS, FINE_ROUNDS = 5, 2
"""Rounds of smoothing and transport with few points, and with all."""
PASSES, FINE_PASSES = 10, 6
"""Passes of smoothing in a round."""
TOLERANCES = (8.0, 4.0)
"""Distance of images at which a neighbour counts as torn off, in the first round and in the last,
in spacings."""
FINE_TOLERANCE = 6.0
SHARPNESS = 0.7
"""Distance over which a plan spreads, in spacings."""
FACING = 0.04
"""Weight of normals that differ by 1 against places, relative to the target's size: more tears
neighbours apart, less mixes both sides of what is thin."""
FACING_AGAIN = 0.03
"""The same in later rounds."""
SWEEPS = 20
"""Relaxation sweeps of the images."""
EDGE = 2.0
"""Percentile at the ends of the boxes that are aligned."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TransportMap:
    """Images of the points of a sheet."""

    source: Sheet
    images: F32
    """[unit], shape (c, 3)."""
    ups: F32
    """Unit normals of the target there, shape (c, 3)."""
    spacing: float
    """Median spacing of the images [unit]."""

    def gradients(
        self, device: Device, band: tuple[float, float], across: float, *, mirrors: bool
    ) -> F32:
        """Return the gradient of the map at each point, shape (c, 3, 3).

        Args:
            device: Runs the kernels.
            band: Least and largest singular value along the surface, relative to the ratio of the
                spacings.
            across: Factor along normals, relative to that ratio.
            mirrors: Whether gradients may mirror; otherwise they are the nearest that do not.
        """
        maps = np.empty((len(self.source), 3, 3), np.float32)
        source = self.source
        how = tuple(np.float32(each) for each in (source.spacing, self.spacing, *band, across))
        device.run(
            kernels.fit, source.near, source.weights, source.positions, source.normals,
            self.images, self.ups, how, mirrors, maps,
        )  # fmt: skip
        return maps


def match(device: Device, source: Sheet, goal: Goal) -> TransportMap:
    """Map a sheet onto a surface.

    Args:
        device: Runs the kernels.
        source: Points to map.
        goal: Surface, with a sheet of points on it.
    """
    target = goal.sheet
    few, some = source.thinned(device, COARSE), target.thinned(device, COARSE)
    coarse, small = source.selected(device, few), target.selected(device, some)
    size = float(np.linalg.norm(np.ptp(target.positions, axis=0))) or 1.0
    places, normals = _aligned(coarse, small)
    _, best = _transported(device, places, normals, small, FACING * size)
    images, ups = small.positions[best], small.normals[best]
    for number in range(ROUNDS):
        part = number / (ROUNDS - 1)
        tolerance = TOLERANCES[0] * (TOLERANCES[1] / TOLERANCES[0]) ** part
        images, ups = _smoothed(device, coarse, goal, images, PASSES, tolerance * small.spacing)
        images, _ = _transported(device, images, ups, small, FACING_AGAIN * size)
        images, ups = goal.onto(images)
    if len(few) < len(source) or len(some) < len(target):
        images, ups = _refined(device, source, coarse, images, goal, small.spacing, size)
    images = relaxed(device, images, _apart(goal, len(images)), SWEEPS, goal)
    images, ups = goal.onto(images)
    return TransportMap(
        source=source,
        images=images,
        ups=ups,
        spacing=Sheet.of(device, images, ups).spacing,
    )


def _refined(
    device: Device, source: Sheet, coarse: Sheet, images: F32, goal: Goal, apart: float, size: float
) -> tuple[F32, F32]:
    """Return images and normals of all points, from those of few that are `apart`."""
    target = goal.sheet
    binding = coarse.bind(device, source.positions)
    fine, support = np.empty_like(source.positions), np.empty(len(source), np.int32)
    device.run(
        kernels.spread, binding.near, binding.weights, images,
        np.float32(TOLERANCES[1] * apart), fine, support,
    )  # fmt: skip
    images, ups = goal.onto(fine)
    tolerance = FINE_TOLERANCE * target.spacing
    for _ in range(FINE_ROUNDS):
        images, ups = _smoothed(device, source, goal, images, FINE_PASSES, tolerance)
        images, _ = _transported(device, images, ups, target, FACING_AGAIN * size)
        images, ups = goal.onto(images)
    return _smoothed(device, source, goal, images, FINE_PASSES // 2, tolerance)


def _smoothed(
    device: Device, sheet: Sheet, goal: Goal, images: F32, passes: int, tolerance: float
) -> tuple[F32, F32]:
    """Smooth images over the neighbours of their points, on the target."""
    ups = np.zeros_like(images)
    for _ in range(passes):
        mean = np.empty_like(images)
        device.run(kernels.smooth, sheet.near, sheet.weights, images, np.float32(tolerance), mean)
        images, ups = goal.onto(mean)
    return images, ups


def _transported(
    device: Device, places: F32, normals: F32, target: Sheet, facing: float
) -> tuple[F32, np.ndarray]:
    """Return the images of points on a target, and the point of the target that each sends most
    to."""
    weight = np.float32(facing)
    plan = transport(
        device,
        np.concatenate([places, weight * normals], axis=1),
        np.concatenate([target.positions, weight * target.normals], axis=1),
        (SHARPNESS * target.spacing) ** 2,
    )
    return plan.images(target.positions)


def _aligned(source: Sheet, target: Sheet) -> tuple[F32, F32]:
    """Return places and normals of a sheet, scaled along each axis to the box of another."""
    low, high = _box(source.positions)
    other_low, other_high = _box(target.positions)
    extent = high - low
    flat = extent <= 1e-6 * max(float(extent.max()), 1e-30)
    scale = np.where(flat, 1.0, (other_high - other_low) / np.where(flat, 1.0, extent))
    scale = np.where(scale > 0, scale, 1.0)
    places = (source.positions - (low + high) / 2) * scale + (other_low + other_high) / 2
    normals = source.normals / scale
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return places.astype(np.float32), normals.astype(np.float32)


def _box(points: F32) -> tuple[F64, F64]:
    low, high = np.percentile(points.astype(np.float64), (EDGE, 100 - EDGE), axis=0)
    return low, high


def _apart(goal: Goal, count: int) -> float:
    """Return the even spacing of points on a target [unit], from that of its sheet."""
    target = goal.sheet
    return target.spacing * float(np.sqrt(len(target) / count))
