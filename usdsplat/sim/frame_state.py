"""Splats of a frame, computed from rest and particle state; errors do not accumulate."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.kernels.device import Device
from usdsplat.sim.drivers import drive
from usdsplat.sim.masks import Masks
from usdsplat.sim.specs import Driver, Moment
from usdsplat.sim.state import Frame, State
from usdsplat.sim.strain import Strain
from usdsplat.sim.transport import rotate_harmonics, thin, transport

TURNED = "drawn:turned"
"""In `State.memory`: which rows of `sh` differ from rest, uint8, shape (n,)."""


class Fades(NamedTuple):
    """Factors of opacities and sizes, each of shape (n,); None where all are 1."""

    opacity: F32 | None
    size: F32 | None


class FrameEvaluator:
    """Computes the frames of one field.

    Args:
        device: Runs the kernels.
        strain: Estimates the deformation around pushed splats; None if none are pushed.
        masks: The masks of the field.
    """

    def __init__(self, device: Device, strain: Strain | None, masks: Masks) -> None:
        self._device, self._strain, self._masks = device, strain, masks

    def frame(
        self,
        state: State,
        moment: Moment,
        wanted: F32,
        gradient: Any,
        *,
        normals: F32,
        crowding: F32,
        fades: Fades,
        seconds: float,
    ) -> Frame:
        """Return the splats of a frame; nothing changes its arrays afterwards.

        Args:
            state: Its rotations, scales, opacities and harmonics are updated.
            moment: Values of the stage at the time.
            wanted: Target positions [unit], shape (n, 3); they count with strain only.
            gradient: Gradient of the deformation from rest, shape (n, 3, 3), None without any: with
                strain, to the target positions, an array of the host; else to where splats are,
                of the host or of the device.
            normals: Normals at rest, shape (n, 3).
            crowding: Number of neighbours relative to the target, shape (n,); empty if no driver
                needs it.
            fades: Factors of opacities and sizes.
            seconds: Time since the simulation's start [s].
        """
        if self._strain is not None:
            gradient = self._strain.add(state, wanted, gradient, normals)
        areas = None if gradient is None else self._deform(state, moment, gradient)
        drawn = SplatCloud(
            positions=state.positions,
            rotations=state.rotations,
            scales=state.scales if fades.size is None else state.scales * fades.size[:, None],
            opacities=self._opacities(state, areas, fades.opacity),
            sh=state.sh,
            ids=state.ids,
            velocities=state.velocities,
        )
        facing = normals
        if gradient is not None and any(
            each.parameters.output == "displacement" for each in moment.drivers
        ):
            facing = turned(normals, self._device.fetch(gradient))
        for driver in moment.drivers:
            amount = f"driver:{driver.name}:amount"
            part = self._masks.factor(state, moment, amount, driver.parameters)
            drawn = self._drive(state, drawn, driver, facing, crowding, part, seconds)
        state.opacities = drawn.opacities
        return Frame(time=moment.time, cloud=drawn, uv=state.uv, births=state.births)

    def _deform(self, state: State, moment: Moment, gradient: Any) -> Any:
        """Replace rotations, scales and harmonics of the state, and return areas."""
        appearance, device = moment.parameters.appearance, self._device
        rotations = device.copied(state.rotations)
        scales = device.resident(state.scales.shape, np.float32)
        gradient = gradient if not isinstance(gradient, np.ndarray) else device.move(gradient)
        areas = transport(
            device,
            gradient,
            state.rest_rotations,
            state.rest_scales,
            rotations,
            scales,
            appearance,
            factor=self._masks.factor(state, moment, "appearance:maxStretch"),
        )
        state.rotations, state.scales = map(device.publish, (rotations, scales))
        if TURNED not in state.memory:
            state.memory[TURNED] = np.zeros(len(state), np.uint8)
        state.sh, _ = rotate_harmonics(
            device,
            gradient,
            state.rest_sh,
            state.sh,
            state.memory[TURNED],
            min_angle=appearance.sh_min_angle,
        )
        return areas

    def _opacities(self, state: State, areas: Any, factor: F32 | None) -> F32:
        if areas is None:
            opacities = state.rest_opacities.copy()
        else:
            thinned = self._device.resident(len(state), np.float32)
            self._device.keep(state.rest_opacities)
            thin(self._device, state.rest_opacities, areas, thinned)
            opacities = self._device.publish(thinned)
        if factor is not None:
            opacities = np.clip(opacities * factor, 0, 1)
        return opacities

    def _drive(
        self,
        state: State,
        drawn: SplatCloud,
        driver: Driver,
        normals: F32,
        crowding: F32,
        factor: F32 | None,
        seconds: float,
    ) -> SplatCloud:
        """Return the splats of a frame with the effect of one driver."""
        return drive(
            self._device,
            state,
            drawn,
            driver.parameters,
            crowding=crowding,
            normals=normals,
            now=seconds,
            factor=factor,
        )


def turned(normals: F32, gradient: F32 | None) -> F32:
    """Transform rest normals by the inverse transpose of the gradient, unit, shape (n, 3)."""
    if gradient is None:
        return normals
    a, b, c = gradient[:, :, 0], gradient[:, :, 1], gradient[:, :, 2]
    cofactors = (np.cross(b, c), np.cross(c, a), np.cross(a, b))
    found = sum(n[:, None] * each for n, each in zip(normals.T, cofactors, strict=True))
    length = np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(length > 0, found / np.where(length > 0, length, 1), normals).astype(np.float32)
