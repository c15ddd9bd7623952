"""Light receivers by domes: by harmonics of the sky, and by the part of it that they see.

Source: Ramamoorthi & Hanrahan 2001, "An Efficient Representation for Irradiance Environment Maps".
"""

from __future__ import annotations

import numpy as np

from .launch import kernel
from .radiance import harmonics

DEGREE = 4
"""Degree of the harmonics of the light of domes."""

# --- 2. CPU ----------------------------------------------------------------------------


@kernel(over="normals", writes=("sums",))
def add_dome(i, mean, ratios, normals, prims, lit, seen, sums):
    """Add the light of a dome without its peaks to a receiver.

    Its irradiance is that of the whole sky, by harmonics. Directions of the sky only say which part
    of it arrives, so that their number does not change the brightness.

    Args:
        mean: Mean of the light over all normals, r g b, shape (3,) f32.
        ratios: Harmonics of the ratio of the light to this mean, see `radiance.harmonics`, shape
            (25, 3) f32.
        normals, prims, lit: See `lighting.illuminate`.
        seen: Sums of `lighting.illuminate` over directions of the sky, shape (n, SUMS) f32; empty
            if all of it is visible.
        sums: Changed in place, shape (n, SUMS) f32.
    """
    prim = 0
    if prims.shape[0] > 0:
        prim = prims[i]
    if prim < 0 or lit[prim] == 0:
        return
    x, y, z, confidence = normals[i, 0], normals[i, 1], normals[i, 2], normals[i, 3]
    one = np.float32(1)
    for c in range(3):
        light = mean[c]
        if confidence > np.float32(0):
            ratio = harmonics(ratios, c, DEGREE, x, y, z)
            light *= confidence * ratio + (one - confidence)
        part = one
        if seen.shape[0] > 0 and seen[i, 3 + c] > np.float32(0):
            part = min(one, seen[i, c] / seen[i, 3 + c])
        sums[i, c] += light * part
        sums[i, 3 + c] += light
