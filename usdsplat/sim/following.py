"""Splats that follow the motion of their carriers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import following as kernels
from usdsplat.sim.carriers import Binding
from usdsplat.sim.gradients import LocalGradients

NO_GRADIENT = np.zeros((0, 3, 3), np.float32)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Motion:
    """Motion of c carriers from a pose."""

    poses: F32
    """Positions without the motion [unit], shape (c, 3)."""
    displacements: F32
    """[unit], shape (c, 3)."""
    maps: F32
    """Gradient of the motion around each carrier, shape (c, 3, 3)."""
    spacing: float
    """Distance of neighbouring carriers [unit]."""


def motion_of(
    device: Device,
    gradients: LocalGradients,
    positions: F32,
    spacing: float,
    band: tuple[float, float],
) -> Motion:
    """Return the motion of carriers from the pose of `gradients`.

    Args:
        device: Runs the kernels.
        gradients: Pose and neighbours of the carriers.
        positions: Positions now [unit], shape (c, 3).
        spacing: Distance of neighbouring carriers [unit].
        band: Least and largest singular value of the maps.
    """
    maps = np.empty((len(positions), 3, 3), np.float32)
    gradients.measure(device, positions, maps)
    device.run(kernels.limit, np.float32(band[0]), np.float32(band[1]), maps)
    return Motion(
        poses=gradients.rest,
        displacements=positions - gradients.rest,
        maps=maps,
        spacing=spacing,
    )


def follow(
    device: Device, binding: Binding, motion: Motion, positions: Any, gradient: Any = None
) -> None:
    """Move splats with their carriers; those without carriers stay.

    Args:
        device: Runs the kernels.
        binding: Carriers of each splat.
        motion: How these move.
        positions: Positions without the motion [unit], shape (n, 3); an array of the host or of the
            device, changed in place.
        gradient: Gradient of the deformation so far, shape (n, 3, 3), likewise multiplied in place;
            None computes none.
    """
    for each in (binding.near, binding.weights):
        device.keep(each)
    device.run(
        kernels.follow, binding.near, binding.weights, motion.poses, motion.displacements,
        motion.maps, np.float32(motion.spacing), positions,
        NO_GRADIENT if gradient is None else gradient,
    )  # fmt: skip
