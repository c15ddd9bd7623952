"""Evenly spaced points of the unit sphere."""

from __future__ import annotations

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.kernels.device import CpuDevice
from usdsplat.sim.neighbors import Graph, Neighbors
from usdsplat.sim.parameters import NeighborsParameters, Parameters
from usdsplat.sim.relaxing import relax
from usdsplat.sim.support import fitted


def on_sphere(points: F32) -> tuple[F32, F32]:
    """The nearest points of the unit sphere, and its normals there."""
    unit = (points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32)
    return unit, unit


def relaxed_sphere(device: CpuDevice, count: int, sweeps: int = 20) -> F32:
    """Random points after so many sweeps, shape (count, 3)."""
    points = np.random.default_rng(4).normal(size=(count, 3)).astype(np.float32)
    return relax(device, points, None, Parameters(), sweeps, on_sphere)[0]


def graph_of(device: CpuDevice, points: F32, target: float = 16.0) -> Graph:
    """Of points, each with `target` neighbours."""
    neighbors = Neighbors(device, NeighborsParameters(target=target, skin=0.0))
    return neighbors.update(points, fitted(neighbors, points, 2))
