"""Falloff of affectors: 1 inside, fading with the distance from the surface."""

from __future__ import annotations

import math

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import Device
from usdsplat.kernels.sim.blend_solids import union_distances
from usdsplat.sim.bodies import pack_bodies
from usdsplat.sim.fields import Fields
from usdsplat.sim.specs import Affector


def falloff(
    device: Device, affector: Affector, positions: F32, *, fields: Fields | None = None
) -> F32:
    """Return the weight of an affector at points, without its amount; for all roles but collide.

    The solids are joined with the affector's blend radius. At distance d from them the weight is 1
    - smoothstep(0, falloff, d), or a step at the surface where falloff is 0.

    Args:
        positions: [unit], shape (n, 3).
        fields: Cache of this affector's mesh fields, one for each affector.

    Returns:
        0 to 1, shape (n,).
    """
    out = np.zeros(len(positions), np.float32)
    if not affector.solids:
        return out
    bodies = pack_bodies(
        Fields(device) if fields is None else fields, (affector,), (affector,), math.inf
    )
    rows = np.arange(len(bodies), dtype=np.int32)
    headers, voxels = bodies.fields.headers, bodies.fields.voxels
    device.run(union_distances, bodies.table, rows, headers, voxels, positions, out)
    if affector.parameters.falloff <= 0.0:
        return (out <= 0.0).astype(np.float32)
    part = np.clip(out / np.float32(affector.parameters.falloff), 0.0, 1.0)
    return np.asarray(1.0 - part * part * (3.0 - 2.0 * part), np.float32)
