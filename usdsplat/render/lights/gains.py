"""Turn the light of receivers into gains: factors on the linear colours of splats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.images.aovs import CAPTURED
from usdsplat.kernels import light_parts, receivers, total
from usdsplat.kernels.device import Device
from usdsplat.render.lights.light_maps import NO_SUMS, by_pixel


def summed(device: Device, parts: Sequence[Any]) -> Any:
    """Return the sum of the light of several lights; that of one is returned as it is."""
    if len(parts) == 1:
        return parts[0]
    sums = device.resident(parts[0].shape, np.float32)
    device.run(total.clear, by_pixel(sums))
    for each in parts:
        device.run(total.add, by_pixel(sums), by_pixel(each))
    return sums


def shadow_gains(device: Device, sums: Any, ambient: float, rows: Any) -> Any:
    """Return the ratios of light with to that without shadows.

    Args:
        sums: Light of receivers, shape (n, SUMS) f32.
        ambient: Light that no light explains, as a part of the mean.
        rows: See `receivers.ratios`.
    """
    gains = device.resident((sums.shape[0], 3), np.float32)
    device.run(receivers.ratios, sums, _ambient(device, sums, ambient), np.float32(0), rows, gains)
    return gains


def relit_gains(device: Device, sums: Any, captured: Any, ambient: float, rows: Any) -> Any:
    """Return the ratios of light to that in which the splats were photographed.

    Args:
        sums, ambient, rows: See `shadow_gains`.
        captured: As `sums`, in the light of the photographs.
    """
    gains = device.resident((sums.shape[0], 3), np.float32)
    device.run(
        receivers.relight, sums, captured, _ambient(device, sums, ambient),
        _ambient(device, captured, ambient), rows, gains,
    )  # fmt: skip
    return gains


def shares_of(
    device: Device, parts: Mapping[str, Sequence[Any]], ambient: float, rows: Any
) -> dict[str, Any]:
    """Return the shares of parts of the light in the colours of splats, and that of the rest,
    `CAPTURED`, see `light_parts.shares`.

    Args:
        parts: Light of receivers by each light of each part; all lights are in one of them.
        ambient, rows: See `shadow_gains`.
    """
    sums = summed(device, [each for part in parts.values() for each in part])
    rest = _ambient(device, sums, ambient)
    found = {}
    for name, part in [*parts.items(), (CAPTURED, [NO_SUMS])]:
        found[name] = out = device.resident((sums.shape[0], 3), np.float32)
        device.run(light_parts.shares, sums, summed(device, part), rest, rows, out)
    return found


def arrivals_of(device: Device, parts: Sequence[Any], rows: Any) -> Any:
    """Return the light of several lights that arrives at splats, shape (n, 3)."""
    sums = summed(device, parts)
    out = device.resident((sums.shape[0], 3), np.float32)
    device.run(light_parts.arrivals, sums, rows, out)
    return out


def _ambient(device: Device, sums: Any, ambient: float) -> F32:
    """Return a part of the mean light without shadows, shape (3,)."""
    count = max(1, sums.shape[0])
    mean = [device.run(receivers.total, sums, 3 + channel) / count for channel in range(3)]
    return np.array(mean, np.float32) * np.float32(ambient)
