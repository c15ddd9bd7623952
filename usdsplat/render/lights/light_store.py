"""What lighting keeps between pictures, with what it depends on."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from typing import Any

from usdsplat.core.cloud import F32, I32
from usdsplat.render.group_gains import GroupGains
from usdsplat.render.lights.captured import CapturedLight
from usdsplat.render.lights.last_light import LastLights
from usdsplat.render.lights.light_maps import Maps
from usdsplat.render.lights.targets import Key
from usdsplat.render.lights.trees import TreeStore
from usdsplat.render.surface_cache import SurfaceCache


@dataclass(slots=True, eq=False)
class LightStore:
    """What lighting keeps between pictures."""

    version: Any = None
    """What light depended on in the last picture, besides lights and receivers."""
    maps: Maps = field(default_factory=OrderedDict)
    sums: dict[tuple[Key, str], tuple[Any, Any]] = field(default_factory=dict)
    """Receivers and path of a light -> what the sums depend on, and the sums."""
    captured: dict[Key, tuple[Any, CapturedLight]] = field(default_factory=dict)
    """Receivers -> what the estimated light of their photographs depends on, and this light."""
    estimates: dict[Key, tuple[Any, Any]] = field(default_factory=dict)
    """Receivers -> what the sums of this light depend on, and the sums."""
    gains: dict[tuple[Key, str], tuple[Any, GroupGains]] = field(default_factory=dict)
    """Receivers and mode -> what their gains depend on, and the gains."""
    means: dict[tuple[Key, str], tuple[Any, F32]] = field(default_factory=dict)
    """(Receivers, "present" or "captured" light) -> what its ambient part depends on, and this
    part, shape (3,)."""
    shares: dict[Key, tuple[Any, dict[str, Any]]] = field(default_factory=dict)
    """Receivers -> what their shares depend on, and those of each part of their light."""
    arrivals: dict[Key, tuple[Any, Any]] = field(default_factory=dict)
    """Receivers -> what the light that arrives depends on, and the light."""
    rows: dict[Key, tuple[F32, I32]] = field(default_factory=dict)
    """Receivers -> the centres of their field, and their order along a curve."""
    trees: TreeStore = field(default_factory=TreeStore)
    meshes: SurfaceCache = field(default_factory=SurfaceCache)
    last: LastLights = field(default_factory=LastLights)

    def drop_others(self, keys: AbstractSet[Key]) -> None:
        """Keep only these receivers; their sums are dropped by the caller."""
        self.rows = {k: each for k, each in self.rows.items() if k in keys}
        self.captured = {k: each for k, each in self.captured.items() if k in keys}
        self.estimates = {k: each for k, each in self.estimates.items() if k in keys}
        self.gains = {k: each for k, each in self.gains.items() if k[0] in keys}
        self.means = {k: each for k, each in self.means.items() if k[0] in keys}
        self.shares = {k: each for k, each in self.shares.items() if k in keys}
        self.arrivals = {k: each for k, each in self.arrivals.items() if k in keys}
