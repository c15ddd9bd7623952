"""Evaluate garbage mattes: keep or remove splats by the volumes that contain their centres.

The canonical shapes are those of `CropSpec`. A matrix transforms a centre to a shape's own space,
in which the test takes a few comparisons.
"""

from __future__ import annotations

import numpy as np

from .jit import scalar

SPHERE, CUBE, CYLINDER, CONE, CAPSULE, PLANE = range(6)

CROP = np.dtype([("shape", "i4"), ("keeps", "i4"), ("length", "f8")])
"""One volume: its shape; 1 if it is an including one; half the height of a capsule's cylinder."""


@scalar
def is_inside(shape, length, x, y, z):
    """Return whether a point in a shape's own space is inside it; false if it is not finite."""
    if shape == PLANE:
        return z <= 0.0
    if shape == CUBE:
        return abs(x) <= 1.0 and abs(y) <= 1.0 and abs(z) <= 1.0
    across = x * x + y * y
    if shape == CYLINDER:
        return across <= 1.0 and abs(z) <= 1.0
    if shape == CONE:
        radius = 0.5 * (1.0 - z)
        return abs(z) <= 1.0 and across <= radius * radius
    if shape == CAPSULE:
        z = max(abs(z) - length, 0.0)
    return across + z * z <= 1.0


@scalar
def is_left(volumes, matrices, position):
    """Return whether the volumes keep a splat.

    A kept splat is inside at least one including volume, if there is any, and inside no excluding
    volume.

    Args:
        volumes: CROP records, shape (k,).
        matrices: From the splat's space to each shape's, shape (k, 3, 4) f64.
        position: The splat's centre, shape (3,).
    """
    px, py, pz = np.float64(position[0]), np.float64(position[1]), np.float64(position[2])
    wanted, kept = False, False
    for k in range(volumes.shape[0]):
        m = matrices[k]
        inside = is_inside(
            volumes[k].shape,
            volumes[k].length,
            m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3],
            m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3],
            m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3],
        )
        if volumes[k].keeps:
            wanted = True
            kept = kept or inside
        elif inside:
            return False
    return kept or not wanted
