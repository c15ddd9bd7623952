"""Measures of a pattern."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32, F64
from usdsplat.sim.reaction import Reaction

PRESENT = 0.2
"""v above which a point counts as part of the pattern."""


def laplacian(reaction: Reaction, values: F32 | F64) -> F64:
    """L of values by slot, in float64, shape (n,), with the weights that diffusion uses."""
    rows, neighbors, weights = reaction.weights
    own = np.repeat(np.arange(len(rows) - 1), np.diff(rows))
    values = values.astype(np.float64)
    flow = weights * (values[neighbors] - values[own])
    return np.bincount(own, flow, len(rows) - 1)


def wavelength(reaction: Reaction, v: F32) -> float:
    """Mean wavelength of v by slot, in mean spacings: 2 pi over the root of -<v, L v> / <v, v>."""
    v = v.astype(np.float64) - v.mean(dtype=np.float64)
    return 2 * np.pi / np.sqrt(-(v @ laplacian(reaction, v)) / (v @ v)) / reaction.spacing


def area(v: F32) -> float:
    """Part of the points where the pattern is."""
    return float((v > PRESENT).mean())
