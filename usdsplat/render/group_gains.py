"""Factors by which light changes the colours of the splats of a group."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32
from usdsplat.images.color import light_matrices


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GroupGains:
    """Gains of the instances of one field."""

    token: object
    """Changes with the factors."""
    factors: Any
    """Red, green and blue of each instance and splat, shape (m n, 3)."""
    is_light: bool
    """Whether they are ratios of two lights, so that they multiply linear Rec.709, in which lights
    are. Shadows multiply the primaries of the blend space."""

    def turns(self, space: str) -> F32:
        """Return the argument `turns` of `receivers.dim` for colours in a space."""
        found = light_matrices(space) if self.is_light else np.empty((0, 3, 3))
        return found.astype(np.float32)


Gains = Mapping[int, GroupGains]
"""Gains of groups by their first slots."""
NO_GAINS: Gains = MappingProxyType({})
