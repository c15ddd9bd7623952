"""Expand placements of rprims through point instancers, nested to any depth.

A placement is a chain of levels. The first level is in the world, each further one in a prototype
of the instancer before it, and the last level is the field itself. A field that no instancer
carries has one level. Native instances of USD are separate placements.
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
    """The arrays of a point instancer; row i of every array is instance i."""

    transforms: F64
    """Instance to instancer [scene unit], shape (n, 4, 4), column-vector convention."""
    prototypes: I64
    """Index of the prototype, shape (n,)."""
    shown: npt.NDArray[np.bool_]
    """False if `invisibleIds` or `inactiveIds` hide the instance, shape (n,)."""


NO_INSTANCES = InstancerSpec(
    transforms=np.empty((0, 4, 4)), prototypes=np.empty(0, np.int64), shown=np.empty(0, np.bool_)
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """A step of a placement: through a prototype of an instancer."""

    instancer: str
    prototype: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """A placement of a field."""

    path: str
    """Path of the prim, inside its native instance if it has one."""
    links: tuple[Link, ...] = ()
    """Outermost first."""
    asset: str = ""
    """See `InstanceSpec.asset`."""
    material: str = ""
    """See `InstanceSpec.material`."""


class Scatter(Protocol):
    """An instancer, as needed by `expand`."""

    spec: InstancerSpec


def expand(
    placements: Sequence[Placement],
    transforms: Sequence[Sequence[F64]],
    visible: Sequence[bool],
    instancers: Mapping[str, Scatter],
) -> tuple[InstanceSpec, ...]:
    """Return every visible instance of a field in the world.

    Args:
        placements: In order of their paths.
        transforms: Matrices of the levels of each placement, shape (4, 4) each: of the first to the
            world, of the others to the space of their prototype.
        visible: Whether each placement is visible.
        instancers: Instancers by path, all that the placements name.

    Returns:
        Instances in order of path, then index, without those whose transform is not finite. An
        index is the instance's number in its instancer; for nested instancers, their numbers are
        its digits, outermost first. If several placements have the same prim, later ones continue
        the count of the earlier.
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
            seen.append(
                InstanceSpec(
                    path=placement.path,
                    index=index,
                    transform=tuple(row),
                    asset=placement.asset,
                    material=placement.material,
                )
            )
    return tuple(seen)


def _scattered(
    links: Sequence[Link], levels: Sequence[F64], instancers: Mapping[str, Scatter]
) -> tuple[I64, F64]:
    """Return flat indices, shape (m,), and world matrices, shape (m, 4, 4), of a placement."""
    indices = np.zeros(1, np.int64)
    worlds = levels[0][None]
    with np.errstate(
        invalid="ignore", over="ignore"
    ):  # transforms that are not finite are dropped later
        for link, inner in zip(links, levels[1:], strict=True):
            spec = instancers[link.instancer].spec
            rows = np.flatnonzero(spec.shown & (spec.prototypes == link.prototype))
            steps = spec.transforms[rows] @ inner
            indices = (indices[:, None] * len(spec.shown) + rows).ravel()
            worlds = (worlds[:, None] @ steps).reshape(-1, 4, 4)
    return indices, worlds
