"""Turn the light of receivers into gains: factors on the linear colours of splats."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels import receivers, total
from usdsplat.kernels.device import Device
from usdsplat.render.lights.light_maps import by_pixel


def summed(device: Device, parts: Sequence[Any]) -> Any:
    """Return the sum of the light of several lights; that of one is returned as it is."""
    if len(parts) == 1:
        return parts[0]
    sums = device.resident(parts[0].shape, np.float32)
    device.run(total.clear, by_pixel(sums))
    for each in parts:
        device.run(total.add, by_pixel(sums), by_pixel(each))
    return sums


def shadow_gains(device: Device, sums: Any, ambient: F32, rows: Any) -> Any:
    """Return the ratios of light with to that without shadows.

    Args:
        sums: Light of receivers, shape (n, SUMS) f32.
        ambient: Light that no light explains, see `part_of_mean`.
        rows: See `receivers.ratios`.
    """
    gains = device.resident((sums.shape[0], 3), np.float32)
    device.run(receivers.ratios, sums, ambient, np.float32(0), rows, gains)
    return gains


def relit_gains(
    device: Device, sums: Any, captured: Any, ambient: F32, captured_ambient: F32, rows: Any
) -> Any:
    """Return the ratios of light to that in which the splats were photographed.

    Args:
        sums, ambient, rows: See `shadow_gains`.
        captured, captured_ambient: As `sums` and `ambient`, in the light of the photographs.
    """
    gains = device.resident((sums.shape[0], 3), np.float32)
    device.run(receivers.relight, sums, captured, ambient, captured_ambient, rows, gains)
    return gains


def part_of_mean(device: Device, sums: Any, share: float) -> F32:
    """Return a part of the mean light of receivers without shadows, shape (3,)."""
    count = max(1, sums.shape[0])
    mean = [device.run(receivers.total, sums, 3 + channel) / count for channel in range(3)]
    return np.array(mean, np.float32) * np.float32(share)
