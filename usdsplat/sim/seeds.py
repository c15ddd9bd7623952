"""Nuclei: where a pattern begins."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F32, I64
from usdsplat.kernels.device import CpuDevice
from usdsplat.kernels.sim import reaction
from usdsplat.kernels.sim import seeds as kernels
from usdsplat.sim.nearest import nearest
from usdsplat.sim.parameters import RdParameters

SEED_UV = (0.5, 0.25)
"""What u and v are in a nucleus."""

SEED_RADIUS = 5.0
"""Of a nucleus, in lattice units; smaller ones die."""


def nuclei(
    device: CpuDevice,
    positions: F32,
    parameters: RdParameters,
    scale: float,
    *,
    seed: int = 0,
    ids: I64 | None = None,
    selection: F32 | None = None,
) -> F32:
    """How much of a nucleus each point is, 0 or 1, shape (n,).

    Args:
        device: Where to.
        positions: [unit], shape (n, 3).
        parameters: `rd:seedMode` and `rd:seedDensity`. Of the mode noise, patches cover as large a
            part of the points as balls would.
        scale: Length of a lattice unit [unit].
        seed: Of the random numbers.
        ids: By which points are chosen, shape (n,); rows by default.
        selection: Weight of each point, shape (n,); None selects all.
    """
    n, density = len(positions), parameters.seed_density
    result = np.zeros(n, np.float32)
    if parameters.seed_mode == "selection":
        return result + 1 if selection is None else (selection > 0.5).astype(np.float32)
    if n == 0 or density <= 0:
        return result
    drawn: F32 = device.empty(n, np.float32)
    if parameters.seed_mode == "noise":
        device.run(kernels.noise, positions, seed, 2 * SEED_RADIUS * scale, drawn)
        part = min(1.0, density * math.pi * SEED_RADIUS**2)
        result[np.argsort(-drawn, kind="stable")[: math.ceil(part * n)]] = 1
        return result
    every = np.arange(n, dtype=np.int64) if ids is None else ids
    device.run(kernels.draw, every, seed, drawn)
    chosen = drawn < density
    if not chosen.any():  # a small capture still has a pattern
        chosen[np.argmin(drawn)] = True
    _, distances = nearest(device, positions[chosen], positions, 1)
    result[distances[:, 0] <= SEED_RADIUS * scale] = 1
    return result


def plant(device: CpuDevice, uv: F32, weight: F32) -> None:
    """Take u and v to those of a nucleus, in place.

    Args:
        device: Where to.
        uv: Shape (n, 2).
        weight: How far, 0 to 1, shape (n,).
    """
    u, v = (np.float32(each) for each in SEED_UV)
    device.run(reaction.seed, uv, weight, u, v)


def untouched(count: int) -> F32:
    """u and v before anything has begun, shape (count, 2)."""
    return np.tile(np.array([1, 0], np.float32), (count, 1))
