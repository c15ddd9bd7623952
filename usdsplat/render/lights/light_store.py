"""What lighting keeps between pictures."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

from usdsplat.core.cloud import F32, I32
from usdsplat.render.group_gains import GroupGains
from usdsplat.render.lights.last_light import LastLights
from usdsplat.render.lights.light_maps import Maps
from usdsplat.render.surface_cache import SurfaceCache


@dataclass(slots=True, eq=False)
class LightStore:
    """What lighting keeps between pictures."""

    maps: Maps = field(default_factory=OrderedDict)
    sums: dict[tuple[int, str], tuple[Any, Any]] = field(default_factory=dict)
    """First slot of a group and path of a light -> what the sums depend on, and the sums."""
    estimates: dict[int, tuple[Any, Any]] = field(default_factory=dict)
    """First slot of a group -> what the estimated light of its photographs depends on, and its
    sums."""
    gains: dict[tuple[int, str], tuple[Any, GroupGains]] = field(default_factory=dict)
    """First slot of a group and mode -> what its gains depend on, and the gains."""
    rows: dict[int, tuple[F32, I32]] = field(default_factory=dict)
    """First slot of a group -> the centres of its field, and their order along a curve."""
    meshes: SurfaceCache = field(default_factory=SurfaceCache)
    last: LastLights = field(default_factory=LastLights)
