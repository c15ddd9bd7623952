"""Support radius of each splat: count the neighbours within it, and adapt it to a target number.

The count is smooth: each neighbour counts as K(q) = (1 - q^2)^3, q = distance / radius, times a
factor, see FACTOR. For points of even density, the count then is their number within the radius.

Source: Hernquist & Katz 1989, "TreeSPH"; Price 2012, "Smoothed particle hydrodynamics and
magnetohydrodynamics".
"""

from __future__ import annotations

import numpy as np

from usdsplat.kernels.jit import scalar
from usdsplat.kernels.launch import kernel

from .grid import squared_distance

FACTOR = {2: 4.0, 3: 105 / 16}
"""Dimension -> area or volume of the unit ball divided by the integral of K."""

# --- 1. mathematics ---------------------------------------------------------------------


@scalar
def falloff(q2):
    """Return K of a squared relative distance, float32: 1 at 0, 0 from 1 on."""
    t = max(np.float32(1) - q2, np.float32(0))
    return t * t * t


@scalar
def corrected(h, count, target, power, least, most):
    """Return the next radius, a step towards the target number of neighbours, by a factor of 0.5 to
    2."""
    factor = (target / max(count, np.float32(0.5))) ** power
    return min(max(h * min(max(factor, np.float32(0.5)), np.float32(2)), least), most)


# --- 2. CPU -----------------------------------------------------------------------------


@kernel(over="positions", writes=("out",))
def crowding(s, positions, support, order, rows, neighbors, factor, out):
    """Compute the smooth number of neighbours.

    Args:
        positions, support, order, rows, neighbors: Those of a graph.
        factor: FACTOR of the dimension, f32.
        out: Receives the number of each row, (n,) f32.
    """
    x, y, z = positions[s, 0], positions[s, 1], positions[s, 2]
    total = np.float32(0)
    if support[s] > 0:
        inverse = np.float32(1) / (support[s] * support[s])
        for e in range(rows[s], rows[s + 1]):
            j = neighbors[e]
            d2 = squared_distance(x, y, z, positions[j, 0], positions[j, 1], positions[j, 2])
            total += falloff(d2 * inverse)
    out[order[s]] = factor * total


@kernel(over="support", writes=("out",))
def control(i, support, count, target, power, least, most, out):
    """Correct radii by the number of neighbours.

    Args:
        support: Radii, (n,) f32; 0 stays.
        count: Smooth number of neighbours, (n,) f32.
        target: Target number, f32.
        power: Gain over dimension, f32: stable below 2 / (d ln count / d ln h).
        least, most: Limits of the radius, f32.
        out: Receives radii, (n,) f32.
    """
    h = support[i]
    out[i] = corrected(h, count[i], target, power, least, most) if h > 0 else h
