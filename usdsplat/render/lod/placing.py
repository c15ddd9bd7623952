"""Where the instances of a splat tree are in the samples of a picture."""

from __future__ import annotations

import operator
from dataclasses import dataclass, field

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.render.specs import InstanceSpec


@dataclass(frozen=True, slots=True, eq=False)
class Placing:
    """Where the instances of a tree are, as all views of them need it."""

    transforms: F64
    """Local to world, shape (m, 4, 4)."""
    scales: F64 = field(init=False)
    """Largest and smallest singular value, shape (m, 2)."""
    inverses: F64 = field(init=False)
    """World to local, without the offset, shape (m, 3, 3)."""

    def __post_init__(self) -> None:
        linear = np.nan_to_num(self.transforms[:, :3, :3])
        sizes = np.linalg.svd(linear, compute_uv=False)[:, [0, 2]]
        object.__setattr__(self, "scales", np.ascontiguousarray(sizes, np.float64))
        object.__setattr__(self, "inverses", np.asarray(np.linalg.pinv(linear), np.float64))

    def eyes(self, eye: F64) -> F64:
        """Return a point of the world, shape (3,), in the local space of each instance."""
        offset = eye - np.nan_to_num(self.transforms[:, :3, 3])
        return np.einsum("mij,mj->mi", self.inverses, offset)


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """The instances of a tree in the samples of a picture, kept for the next one."""

    instances: tuple[tuple[InstanceSpec, ...], ...]
    """In each of k samples."""
    rows: dict[tuple[str, int], int]
    """(path, index) of an instance -> its row."""
    placings: tuple[Placing, ...]
    """In each of k samples; transforms of instances that a sample lacks are not numbers."""

    @classmethod
    def of(cls, instances: tuple[tuple[InstanceSpec, ...], ...]) -> Placed:
        """Give every instance of any sample a row."""
        names = dict.fromkeys((each.path, each.index) for some in instances for each in some)
        rows = {name: row for row, name in enumerate(names)}
        made: dict[int, Placing] = {}  # samples through other points of a lens share theirs
        for some in instances:
            if id(some) not in made:
                matrices = np.full((len(rows), 4, 4), np.nan)
                matrices[[rows[each.path, each.index] for each in some]] = np.reshape(
                    [each.transform for each in some], (-1, 4, 4)
                )
                made[id(some)] = Placing(matrices)
        return cls(instances, rows, tuple(made[id(some)] for some in instances))

    def is_of(self, instances: tuple[tuple[InstanceSpec, ...], ...]) -> bool:
        """Return whether these are the same objects."""
        same = len(instances) == len(self.instances)
        return same and all(map(operator.is_, instances, self.instances))
