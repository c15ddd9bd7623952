"""How far an affector reaches: 1 inside, fading out with the distance from its surface."""

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
    """What an affector of a role other than collide weighs at points, before its amount.

    Its solids are joined by its blend; of their distance d, w = 1 - smoothstep(0, falloff, d), and
    a step at the surface where falloff is 0.

    Args:
        positions: [unit], shape (n, 3).
        fields: Keeps the fields of this affector's meshes until the next call; one for each
            affector.

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
