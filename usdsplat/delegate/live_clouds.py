"""Splats that an engine draws in place of those on the stage, handed over as a value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from usdsplat.core.cloud import SplatCloud


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LiveClouds:
    """Clouds of splat fields at one time. Nothing changes their arrays afterwards."""

    time: float
    """Time code; at other times the engine draws what the stage has."""
    clouds: Mapping[str, SplatCloud]
    """By path of the field, in its local space, as `schema.fetch` would read them."""
    moving: frozenset[str] = frozenset()
    """Paths of fields whose splats move: authored normals that do not vary are not theirs."""
