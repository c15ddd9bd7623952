"""Effects of affectors on each splat, except collisions and masks: seed, feed, wind, growth,
opacity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from usdsplat.core.cloud import F32, I64
from usdsplat.kernels.device import Device
from usdsplat.sim.falloff import falloff
from usdsplat.sim.fields import Fields
from usdsplat.sim.specs import Affector


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Influence:
    """Combined effect of all affectors at one time, per splat; None where no affector has the
    role."""

    seed: F32 | None = None
    """Strength with which the pattern is seeded, 0 to 1, shape (n,)."""
    wind: F32 | None = None
    """Wind [unit/s], shape (n, 3)."""
    feed: F32 | None = None
    """Offset of the feed rate, shape (n,)."""
    growth: F32 | None = None
    """Factor of the growth, shape (n,)."""
    opacity: F32 | None = None
    """Factor of the opacity, shape (n,)."""

    def selected(self, rows: I64) -> Influence:
        """Return these rows only, in this order."""
        every = ((each.name, getattr(self, each.name)) for each in fields(self))
        return Influence(**{name: a if a is None else a[rows] for name, a in every})


class Influences:
    """Evaluates influences, and caches the fields of meshes."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._fields: dict[str, Fields] = {}

    def at(
        self,
        affectors: tuple[Affector, ...],
        positions: F32,
        masked: Callable[[Affector], F32 | None] = lambda affector: None,
    ) -> Influence:
        """Evaluate affectors at points.

        Seeds combine by maximum, feeds and winds by sum, factors by product.

        Args:
            affectors: All of one moment; those that collide, make masks or are disabled are
                skipped.
            positions: [unit], shape (n, 3).
            masked: Returns the factor of an affector's effect at the points, shape (n,); None
                where it has no mask.
        """
        found: dict[str, F32] = {}
        for each in affectors:
            role, amount = each.parameters.role, np.float32(each.parameters.amount)
            if role in ("collide", "mask", "region") or not each.parameters.enabled:
                continue
            meshes = self._fields.setdefault(each.path, Fields(self._device))
            weight = falloff(self._device, each, positions, fields=meshes)
            part_of = masked(each)
            weight = weight if part_of is None else weight * part_of
            before = found.get(role)
            if role == "seed":
                part = np.clip(amount * weight, 0, 1)
                found[role] = part if before is None else np.maximum(before, part)
            elif role in ("growth", "opacity"):
                factor = 1 + (amount - 1) * weight
                found[role] = factor if before is None else before * factor
            else:
                part = amount * weight
                if role == "wind":
                    part = part[:, None] * _along(each)
                found[role] = part if before is None else before + part
        return Influence(**found)


def _along(affector: Affector) -> F32:
    """Return the z axis of the affector."""
    axis = affector.solids[0].matrix[:3, 2] if affector.solids else np.zeros(3)
    return np.asarray(axis, np.float32)
