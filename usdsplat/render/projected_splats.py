"""The visible splats of a view, projected, shaded and sorted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from usdsplat.core.cloud import F32, I32
from usdsplat.render.draw_list import DrawList


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedSplats:
    """Visible splats of a view, nearest first; row k of every array is rank k.

    Arrays belong to the device; fetch them to read them on the host.
    """

    records: F32
    """Shape (n, project.RECORD)."""
    order: I32
    """Slot of each splat, shape (n,)."""
    sources: I32
    """Row of each slot in its field."""
    layout: DrawList
    ray_hits: F32
    """Shape (n, ray_hit.RAY_HIT), or empty if ray hits are not needed."""
    features: F32
    """Shape (n, feature.FEATURES), or empty if not needed."""
    keeps: F32
    """0 for splats of mattes, shape (n,); empty without mattes."""
    labels: I32
    """Number of each splat's prim, shape (n,), or empty if not needed."""
    is_parallel: bool
    """Whether all rays are parallel."""
    near: float
    """Planar depth in front of which nothing is visible [scene unit]."""
    stamp: object
    """Token that is replaced whenever a footprint or the order changes: tile lists depend on it."""


@dataclass(slots=True, eq=False)
class HeldInputs:
    """Inputs of the last picture, by the first slot of each group, for reuse of its results."""

    shapes: dict[int, Any] = field(default_factory=dict)
    """Everything that the footprints depend on; None if they cannot be reused."""
    radiance: dict[int, Any] = field(default_factory=dict)
    """Everything else that the colours depend on."""
    order: Any = None
    stamp: object = None
