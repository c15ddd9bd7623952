"""Sun and sky: their radiance, and their visibility from each splat."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64

Floats = npt.NDArray[np.floating[Any]]

SUN = np.array([0.62, 0.60, 0.50]) / np.linalg.norm([0.62, 0.60, 0.50])
"""Unit vector toward the sun."""
SUN_COLOR = np.array([3.3, 2.75, 2.1])
ZENITH = np.array([0.40, 0.52, 0.76])
HORIZON = np.array([0.96, 0.84, 0.70])
GROUND = np.array([0.13, 0.11, 0.08])

_SKY_DIRECTIONS = 16
_GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


def environment(directions: Floats) -> F32:
    """Return the linear radiance of the surroundings without the sun's disc, shape (..., 3)."""
    height = directions[..., 1:2].astype(np.float32)
    above, below = np.sqrt(np.clip(height, 0, 1)), np.clip(height * -3, 0, 1)
    horizon, haze = HORIZON.astype(np.float32), (0.35 * HORIZON).astype(np.float32)
    sky = above * (ZENITH.astype(np.float32) - horizon) + horizon
    ground = below * (GROUND.astype(np.float32) - haze) + haze
    return np.where(height > 0, sky, ground)


def sun_share(positions: F32, normals: F32, sizes: F32) -> F32:
    """Return the visible fraction of the sun for each splat [0..1], shape (n,)."""
    return _visibility(positions, normals, sizes, SUN.astype(np.float32), cell=0.0055, taps=12)


def sky_light(positions: F32, normals: F32, sizes: F32, is_strand: Any) -> tuple[F32, F32]:
    """Compute sky light with occlusion.

    Returns:
        Irradiance over pi, including some light from the ground, shape (n, 3), and the visible
        fraction of the sky, weighted by the cosine [0..1], shape (n,).
    """
    directions = spread(2 * _SKY_DIRECTIONS)[:_SKY_DIRECTIONS].astype(np.float32)  # upper half
    light = np.maximum(0.0, 0.5 - 0.5 * normals[:, 1:2]) * GROUND.astype(np.float32)
    weight, opened = np.full((2, len(positions)), 1e-6, np.float32)
    for toward, radiance in zip(directions, environment(directions), strict=True):
        cosine = np.where(is_strand, np.float32(0.6), np.maximum(normals @ toward, 0))
        seen = cosine * _visibility(positions, normals, sizes, toward, cell=0.014, taps=4)
        light += seen[:, None] * (radiance / np.float32(0.5 * _SKY_DIRECTIONS))
        opened += seen
        weight += cosine
    return light, opened / weight


def spread(count: int) -> F64:
    """Return unit vectors spread evenly over the sphere, from the top down, shape (count, 3)."""
    i = np.arange(count) + 0.5
    y, angle = 1 - 2 * i / count, i * _GOLDEN_ANGLE
    radius = np.sqrt(1 - y * y)
    return np.stack([radius * np.cos(angle), y, radius * np.sin(angle)], axis=1)


def _visibility(
    positions: F32, normals: F32, sizes: F32, toward: F32, *, cell: float, taps: int
) -> F32:
    """Return the visible fraction of a distant light for each splat, by a shadow map.

    Args:
        cell: Width of a cell of the shadow map [m].
        taps: Number of lookups around each splat, for soft edges.
    """
    right = np.cross([1e-6, 1.0, 0.0], toward)
    right /= np.linalg.norm(right)
    depth = -(positions @ toward)
    x = positions @ (right / cell).astype(np.float32)
    y = positions @ (np.cross(toward, right) / cell).astype(np.float32)
    x, y = x - (x.min() - 4), y - (y.min() - 4)
    width, height = int(x.max()) + 5, int(y.max()) + 5
    nearest = np.full((width, height), np.inf, np.float32)
    np.minimum.at(nearest.reshape(-1), x.astype(int) * height + y.astype(int), depth)
    for axis in (0, 1):  # close the gaps between neighbours of one surface
        beside = np.minimum(np.roll(nearest, 1, axis), np.roll(nearest, -1, axis))
        nearest = np.minimum(nearest, beside)
    facing = np.abs(normals @ toward)
    slope = np.sqrt(1 - np.minimum(facing * facing, 1)) / np.maximum(facing, 0.2)
    front = depth - sizes - cell * (2.0 + 2.5 * slope)
    seen = np.zeros(len(positions), np.float32)
    for tap in range(taps):
        radius, angle = 2.6 * math.sqrt((tap + 0.5) / taps), _GOLDEN_ANGLE * tap
        i = (x + np.float32(radius * math.cos(angle))).astype(int)
        j = (y + np.float32(radius * math.sin(angle))).astype(int)
        seen += front <= nearest.reshape(-1)[i * height + j]
    return seen / np.float32(taps)
