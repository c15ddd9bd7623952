"""Lay out the splats of a render scene in drawing order for kernels.

The layout does not depend on the view. Consecutive instances of the same field form a group, which
is drawn in one launch.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F64, I32, I64, SplatCloud
from usdsplat.kernels import project
from usdsplat.render.fields import Drawn, Field
from usdsplat.render.splat_budget import SplatSubset, shares

ELEMENT_IDS = 1 << 31
"""Number of element ids, which pictures have as 32-bit integers."""


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Consecutive instances of one field in drawing order."""

    field: Field
    cloud: SplatCloud
    """The field's splats, or the subset that a budget selects."""
    rows: I32 | None
    """Rows of the subset in the field's arrays; None without a subset."""
    transforms: F64
    """Local to world, shape (m, 4, 4)."""
    turns: F64
    """Orthogonal factors Q of the transforms' 3x3 parts, reflections included, shape (m, 3, 3)."""
    stretches: F64
    """Symmetric factors P, shape (m, 3, 3): the transforms' 3x3 parts are Q P."""
    block: int
    """Slots per block."""
    blocks: int
    """Blocks per instance."""
    slot: int
    """First slot of the group."""
    hidden: npt.NDArray[np.bool_] | None = None
    """Whether each instance is hidden, shape (m,); None if none is."""

    @property
    def all_blocks(self) -> int:
        """Blocks of all instances."""
        return len(self.transforms) * self.blocks

    @property
    def slots(self) -> int:
        """Slots of all instances."""
        return self.all_blocks * self.block


@dataclass(frozen=True, slots=True, eq=False)
class DrawList:
    """All groups, and the slots of each appearance."""

    groups: tuple[Group, ...]
    first_slots: I64
    """First slot of each appearance, ascending, shape (n,)."""
    labels: npt.NDArray[np.int32]
    """(prim number, instance index) of each appearance, shape (n, 2)."""
    block_starts: I64
    """First slot of each block."""
    prims: tuple[str, ...]
    """Paths of all drawn prims, surfaces included, sorted. The number of a prim is its index
    here."""
    first_elements: I32
    """Element id of the first splat of each appearance, shape (n,); empty if all are 0."""
    splats: int
    """Number of drawn splats; each instance counts."""
    total: int
    """Number of splats that would be drawn without a budget."""

    @property
    def slots(self) -> int:
        """Slots of all groups."""
        return self.groups[-1].slot + self.groups[-1].slots if self.groups else 0

    def hiding(self, appearances: npt.NDArray[np.bool_]) -> DrawList:
        """Return the same layout with some of the appearances hidden."""
        if not appearances.any():
            return self
        groups, begin, hidden = [], 0, 0
        for group in self.groups:
            end = begin + len(group.transforms)
            some = appearances[begin:end]
            groups.append(replace(group, hidden=some) if some.any() else group)
            hidden += int(some.sum()) * len(group.cloud)
            begin = end
        return replace(self, groups=tuple(groups), splats=self.splats - hidden)


def draw_list(drawn: Sequence[Drawn], others: Iterable[str] = (), *, budget: int = 0) -> DrawList:
    """Lay out appearances of splats.

    Args:
        drawn: The appearances in drawing order.
        others: Paths of the drawn prims that are not splats.
        budget: Maximum number of splats; each instance counts. 0 for all.
    """
    parts = _parts(drawn, budget)
    groups: list[Group] = []
    labels: list[tuple[int, int]] = []
    first_slots: list[I64] = []
    paths = sorted({*others, *(instance.path for _, _, instance in drawn)})
    prims = {path: number for number, path in enumerate(paths)}
    slot, begin = 0, 0
    for i, (_, field, instance) in enumerate(drawn):
        labels.append((prims[instance.path], instance.index))
        if i + 1 == len(drawn) or drawn[i + 1][1] is not field:
            transforms = np.array([each[2].transform for each in drawn[begin : i + 1]])
            groups.append(_group(field, parts.get(id(field)), transforms.reshape(-1, 4, 4), slot))
            span = groups[-1].blocks * groups[-1].block
            first_slots.append(slot + span * np.arange(i + 1 - begin, dtype=np.int64))
            slot += groups[-1].slots
            begin = i + 1
    # ids of trees with more splats repeat, but are never negative, which is nothing
    elements = [
        field.first_element % (ELEMENT_IDS + 1 - len(field.spec.cloud)) for _, field, _ in drawn
    ]
    starts = [g.slot + g.block * np.arange(g.all_blocks, dtype=np.int64) for g in groups]
    nothing = np.empty(0, np.int64)
    return DrawList(
        groups=tuple(groups),
        first_slots=np.concatenate([*first_slots, nothing]),
        labels=np.array(labels, np.int32).reshape(-1, 2),
        block_starts=np.concatenate([*starts, nothing]),
        prims=tuple(prims),
        first_elements=np.array(elements if any(elements) else [], np.int32),
        splats=sum(len(g.transforms) * len(g.cloud) for g in groups),
        total=sum(len(g.transforms) * len(g.field.spec.cloud) for g in groups),
    )


def _parts(drawn: Sequence[Drawn], budget: int) -> dict[int, SplatSubset]:
    """Return the subset of each field by its id; empty if all splats are drawn."""
    fields = {id(field): field for _, field, _ in drawn if not field.is_node}
    instances = Counter(id(field) for _, field, _ in drawn)
    sizes = [(len(field.spec.cloud), instances[key]) for key, field in fields.items()]
    if budget == 0 or sum(count * times for count, times in sizes) <= budget:
        return {}
    kept = shares(sizes, budget)
    return {
        key: field.subset(count) for (key, field), count in zip(fields.items(), kept, strict=True)
    }


def _group(field: Field, part: SplatSubset | None, transforms: F64, slot: int) -> Group:
    cloud = field.spec.cloud if part is None else part.cloud
    n = len(cloud)
    block = max(1, min(n, project.BLOCK))
    u, s, vt = np.linalg.svd(transforms[:, :3, :3])
    return Group(
        field=field,
        cloud=cloud,
        rows=None if part is None else part.rows,
        transforms=transforms,
        turns=u @ vt,
        stretches=vt.transpose(0, 2, 1) @ (s[:, :, None] * vt),
        block=block,
        blocks=-(-n // block),
        slot=slot,
    )
