"""Drivers: functions of the state that change what is drawn and nothing else.

They have no memory, so that frames can be made again with other drivers, without simulating.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from usdsplat.core.cloud import F32, SplatCloud
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import drivers as kernels
from usdsplat.sim.parameters import DriverParameters
from usdsplat.sim.state import State

_SOURCES = {
    "u": kernels.U,
    "v": kernels.V,
    "vMinusU": kernels.V_MINUS_U,
    "crowding": kernels.CROWDING,
    "age": kernels.AGE,
    "speed": kernels.SPEED,
    "distance": kernels.DISTANCE,
}
_EASES = {"linear": kernels.LINEAR, "smooth": kernels.SMOOTH, "smoother": kernels.SMOOTHER}
_OUTPUTS = {
    "scale": kernels.SCALE,
    "thickness": kernels.THICKNESS,
    "opacity": kernels.OPACITY,
    "displacement": kernels.DISPLACEMENT,
}


def changes(driver: DriverParameters) -> str:
    """Return the field of `SplatCloud` that a driver changes."""
    fields = {
        "scale": "scales",
        "thickness": "scales",
        "opacity": "opacities",
        "color": "sh",
        "displacement": "positions",
    }
    return fields[driver.output]


def drive(
    device: Device,
    state: State,
    drawn: SplatCloud,
    driver: DriverParameters,
    *,
    crowding: F32,
    normals: F32,
    now: float,
    factor: F32 | None = None,
) -> SplatCloud:
    """Return the splats of a frame with the effect of a driver.

    Args:
        device: Runs the kernels.
        state: Source of the driver; does not change.
        drawn: The same splats as drawn without the driver; not changed. Only the array that
            `changes` names is another one in the result.
        driver: Source, ramp and output.
        crowding: Number of neighbours relative to the target, shape (n,); may be empty for other
            sources.
        normals: Normals of the splats as drawn, shape (n, 3); may be empty unless the output is
            displacement.
        now: Time since the simulation's start [s].
        factor: Factor of the effect on each splat, shape (n,).
    """
    part = np.empty(len(state), np.float32)
    device.run(
        kernels.amounts,
        _SOURCES[driver.source],
        device.upload(state.uv),
        device.upload(crowding),
        device.upload(state.births),
        float(now),
        device.upload(state.velocities),
        device.upload(state.positions),
        device.upload(state.rest_positions),
        np.float32(driver.in_min),
        np.float32(driver.in_max),
        _EASES[driver.ease],
        part,
    )
    if factor is not None:
        part *= factor
    if driver.output == "color":
        color = np.array(driver.color, np.float32)
        fade = np.float32(driver.sh_fade)
        sh = device.copied(drawn.sh)
        device.run(kernels.tint, part, np.float32(driver.amount), color, fade, sh)
        return replace(drawn, sh=device.publish(sh))
    none = np.empty((0, 3), np.float32)
    changed = changes(driver)
    out = device.copied(getattr(drawn, changed))
    device.run(
        kernels.drive,
        _OUTPUTS[driver.output],
        part,
        np.float32(driver.amount),
        out if changed == "positions" else none,
        out if changed == "scales" else none,
        out if changed == "opacities" else none[:, 0].copy(),
        device.upload(normals),
    )
    return replace(drawn, **{changed: device.publish(out)})
