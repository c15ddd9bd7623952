"""How one field is seen many times: point instancers, nested to any depth.

A placement is a chain of levels. The first level stands in the world; each further one stands in a
prototype of the instancer before it; the last level is the field itself. A field that no instancer
carries has one level. Native instances of USD are simply several placements.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64, I64
from usdsplat.render.specs import InstanceSpec


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class InstancerSpec:
    """What one point instancer scatters; row i of every array is instance i."""

    transforms: F64
    """Instance to instancer [scene unit], shape (n, 4, 4), column-vector convention."""
    prototypes: I64
    """Number of the prototype, shape (n,)."""
    shown: npt.NDArray[np.bool_]
    """False where `invisibleIds` or `inactiveIds` hide it, shape (n,)."""


NO_INSTANCES = InstancerSpec(
    transforms=np.empty((0, 4, 4)), prototypes=np.empty(0, np.int64), shown=np.empty(0, np.bool_)
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """One step of a placement: through a prototype of an instancer."""

    instancer: str
    prototype: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """One way by which a field is seen."""

    path: str
    """Path of the prim that is seen, inside an instance where it is in one."""
    links: tuple[Link, ...] = ()
    """Outermost first."""


class Scatter(Protocol):
    """What `expand` asks of an instancer."""

    spec: InstancerSpec


def expand(
    placements: Sequence[Placement],
    transforms: Sequence[Sequence[F64]],
    visible: Sequence[bool],
    instancers: Mapping[str, Scatter],
) -> tuple[InstanceSpec, ...]:
    """Return every visible appearance of one field in the world.

    Args:
        placements: In order of their paths.
        transforms: For each placement its levels' matrices, shape (4, 4) each: of the first to the
            world, of the others to the frame of the prototype they are in.
        visible: For each placement whether to show it.
        instancers: By path; holds all those that the placements name.

    Returns:
        In order of path, then index; those that are not finite are nowhere. An index is the
        instance's number in its instancer; through nested ones, their numbers are its digits,
        outermost first. Where the same prim is seen by more than one placement, the later ones
        count on from the earlier.
    """
    seen = []
    offsets: dict[str, int] = {}
    for placement, levels, shown in zip(placements, transforms, visible, strict=True):
        spans = [len(instancers[link.instancer].spec.shown) for link in placement.links]
        offset = offsets.get(placement.path, 0)
        offsets[placement.path] = offset + int(np.prod(spans, dtype=np.int64))
        if not shown:
            continue
        indices, matrices = _scattered(placement.links, levels, instancers)
        finite = np.isfinite(matrices).all(axis=(1, 2))
        numbers = matrices[finite].reshape(-1, 16).tolist()
        for index, row in zip((indices[finite] + offset).tolist(), numbers, strict=True):
            seen.append(InstanceSpec(path=placement.path, index=index, transform=tuple(row)))
    return tuple(seen)


def _scattered(
    links: Sequence[Link], levels: Sequence[F64], instancers: Mapping[str, Scatter]
) -> tuple[I64, F64]:
    """Flat indices, shape (m,), and world matrices, shape (m, 4, 4), of one placement."""
    indices = np.zeros(1, np.int64)
    worlds = levels[0][None]
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is left out later
        for link, inner in zip(links, levels[1:], strict=True):
            spec = instancers[link.instancer].spec
            rows = np.flatnonzero(spec.shown & (spec.prototypes == link.prototype))
            steps = spec.transforms[rows] @ inner
            indices = (indices[:, None] * len(spec.shown) + rows).ravel()
            worlds = (worlds[:, None] @ steps).reshape(-1, 4, 4)
    return indices, worlds
