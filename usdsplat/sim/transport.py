"""Deform splats: ellipsoids, opacity and harmonics under a deformation gradient.

The gradient F of each splat maps from the capture to now. Everything is computed from the capture,
never from the last frame, so that errors do not accumulate; only the signs of quaternions follow
the last frame, so that they can be interpolated.
"""

from __future__ import annotations

import math
from typing import TypeAlias

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
    gradient: F32,
    rest_rotations: F32,
    rest_scales: F32,
    rotations: F32,
    scales: F32,
    appearance: AppearanceParameters,
    *,
    factor: F32 | None = None,
) -> F32 | None:
    """Deform the ellipsoids of splats.

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
        axes at rest), shape (n,); None unless `appearance.keep_opacity`.

    Source:
        Xie et al. 2024, "PhysGaussian"; Hestenes 1958 for the axes.
    """
    areas = np.empty(len(gradient), np.float32) if appearance.keep_opacity else NOBODY
    limits = np.array([appearance.max_stretch], np.float32)
    if factor is not None and math.isfinite(appearance.max_stretch):
        limits = limits * factor
    device.run(
        kernels.transport, gradient, rest_rotations, rest_scales,
        POLICIES[appearance.covariance], limits, rotations, scales, areas,
    )  # fmt: skip
    return areas if appearance.keep_opacity else None


def thin(device: Device, rest_opacities: F32, areas: F32, opacities: F32) -> None:
    """Compute opacities that keep a stretched surface equally opaque: 1 - (1 - a)^(1 / area).

    Args:
        rest_opacities: [0..1], shape (n,).
        areas: Area ratios from `transport`, shape (n,).
        opacities: Receives [0..1], shape (n,).
    """
    device.run(kernels.thin, rest_opacities, areas, opacities)


def rotate_harmonics(
    device: Device, gradient: F32, rest_sh: F32, sh: F32, turned: U8, *, min_angle: float = 1.0
) -> tuple[F32, int]:
    """Rotate view-dependent colour with the splats, by the rotation R of F = R U.

    Args:
        gradient: F of each splat, shape (n, 3, 3).
        rest_sh: Coefficients at rest, shape (n, k, 3) with k = 1, 4, 9, 16 or 25.
        sh: Coefficients to replace. If it is `rest_sh` itself, a copy is made once a splat turns.
        turned: 1 for each row of `sh` that may differ from rest, updated in place, shape (n,).
            Other rows are only read if they turn now.
        min_angle: Splats that turn by less [deg] get their values at rest.

    Returns:
        The coefficients, and the number of splats that are turned.

    Source:
        Rotation by values in fixed directions, as `core.sh_rotation`.
    """
    if rest_sh.shape[1] == 1:
        return sh, 0
    cosine = np.float32(math.cos(math.radians(min_angle) / 2))
    turns = np.empty((len(gradient), 4), np.float32)
    device.run(harmonics.turns, gradient, cosine, turns)
    count = int(np.count_nonzero(turns[:, 0] < 1))
    if count == 0 and not turned.any():
        return sh, 0
    if sh is rest_sh:
        sh = rest_sh.copy()
    device.run(harmonics.rotate, turns, rest_sh, sh, turned)
    return sh, count
