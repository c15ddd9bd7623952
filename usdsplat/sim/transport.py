"""Deform splats: ellipsoids, opacity and harmonics under a deformation gradient.

The gradient F of each splat maps from the capture to now. Everything is computed from the capture,
never from the last frame, so that errors do not accumulate; only the signs of quaternions follow
the last frame, so that they can be interpolated.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim import harmonics
from usdsplat.kernels.sim import transport as kernels
from usdsplat.sim.parameters import AppearanceParameters

U8: TypeAlias = npt.NDArray[np.uint8]

POLICIES = {
    "full": kernels.FULL,
    "rigid": kernels.RIGID,
    "volume": kernels.VOLUME,
}
NOBODY = np.empty(0, np.float32)


def transport(
    device: Device,
    gradient: Any,
    rest_rotations: F32,
    rest_scales: F32,
    rotations: Any,
    scales: Any,
    appearance: AppearanceParameters,
    *,
    factor: F32 | None = None,
) -> Any:
    """Deform the ellipsoids of splats. `gradient`, `rotations` and `scales` are arrays of the host
    or of the device.

    A row whose gradient is exactly the identity, or not finite, gets its rest values bit for bit,
    except for the sign of the quaternion. A gradient that mirrors or flattens counts as the nearest
    rotation. Axes keep their order; they change smoothly unless two of them become equally long,
    where they are undefined.

    Args:
        gradient: F of each splat, shape (n, 3, 3).
        rest_rotations: Unit quaternions (w, x, y, z), shape (n, 4).
        rest_scales: [unit], shape (n, 3).
        rotations: Unit quaternions of the last frame, initially those at rest, shape (n, 4). They
            are replaced by those of this frame, each with the sign for which it is nearer to the
            last one.
        scales: Receives [unit], shape (n, 3).
        appearance: `covariance` selects how splats follow F: all of it; its rotation R of F = R
            U; or F / |F|^(1/3). Principal stretches are clamped to [1/s, s], s = `max_stretch`.
            `keep_opacity` selects whether areas are returned.
        factor: Factor of `max_stretch` for each splat, shape (n,); an infinite one has none.

    Returns:
        Ratio of the deformed to the rest area of each splat's face (the ellipse of its two longer
        axes at rest), shape (n,), an array of the device; None unless `appearance.keep_opacity`.

    Source:
        Xie et al. 2024, "PhysGaussian"; Hestenes 1958 for the axes.
    """
    n = gradient.shape[0]
    areas = device.resident(n, np.float32) if appearance.keep_opacity else NOBODY
    for each in (rest_rotations, rest_scales):
        device.keep(each)
    limits = np.array([appearance.max_stretch], np.float32)
    if factor is not None and math.isfinite(appearance.max_stretch):
        limits = limits * factor
    device.run(
        kernels.transport, gradient, rest_rotations, rest_scales,
        POLICIES[appearance.covariance], limits, rotations, scales, areas,
    )  # fmt: skip
    return areas if appearance.keep_opacity else None


def thin(device: Device, rest_opacities: F32, areas: Any, opacities: Any) -> None:
    """Compute opacities that keep a stretched surface equally opaque: 1 - (1 - a)^(1 / area). The
    last two are arrays of the host or of the device.

    Args:
        rest_opacities: [0..1], shape (n,).
        areas: Area ratios from `transport`, shape (n,).
        opacities: Receives [0..1], shape (n,).
    """
    device.run(kernels.thin, rest_opacities, areas, opacities)


def rotate_harmonics(
    device: Device, gradient: Any, rest_sh: F32, sh: F32, turned: U8, *, min_angle: float = 1.0
) -> tuple[F32, int]:
    """Rotate view-dependent colour with the splats, by the rotation R of F = R U.

    Args:
        gradient: F of each splat, shape (n, 3, 3), an array of the host or of the device.
        rest_sh: Coefficients at rest, shape (n, k, 3) with k = 1, 4, 9, 16 or 25.
        sh: Coefficients before, which may be `rest_sh` itself; not changed.
        turned: 1 for each row of `sh` that may differ from rest, replaced in place, shape (n,).
        min_angle: Splats that turn by less [deg] get their values at rest.

    Returns:
        The coefficients, `sh` itself if no splat is or was turned, and the number of splats that
        are turned.

    Source:
        Rotation by values in fixed directions, as `core.sh_rotation`.
    """
    if rest_sh.shape[1] == 1:
        return sh, 0
    cosine = np.float32(math.cos(math.radians(min_angle) / 2))
    turns = device.resident((gradient.shape[0], 4), np.float32)
    device.run(harmonics.turns, gradient, cosine, turns)
    count = int(device.run(harmonics.count_turned, turns))
    if count == 0 and not turned.any():
        return sh, 0
    device.keep(rest_sh)
    out = device.resident(sh.shape, np.float32)
    device.run(harmonics.rotate, turns, rest_sh, out, turned)
    return device.publish(out), count
