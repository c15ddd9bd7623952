"""Lay out the splats of a render scene in drawing order for kernels.

The layout does not depend on the view. Consecutive instances of the same field form a group, which
is drawn in one launch.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from usdsplat.core.cloud import F32, F64, I32, I64, SplatCloud
from usdsplat.kernels import project
from usdsplat.kernels.fading import WHOLE
from usdsplat.render.fields import Drawn, Field
from usdsplat.render.specs import InstanceSpec
from usdsplat.render.splat_budget import SplatSubset, shares

ELEMENT_IDS = 1 << 31
"""Number of element ids, which pictures have as 32-bit integers."""


@dataclass(frozen=True, slots=True, eq=False)
class Placements:
    """Transforms of m instances."""

    transforms: F64
    """Local to world, shape (m, 4, 4)."""
    turns: F64
    """Orthogonal factors Q of the transforms' 3x3 parts, reflections included, shape (m, 3, 3)."""
    stretches: F64
    """Symmetric factors P, shape (m, 3, 3): the transforms' 3x3 parts are Q P."""

    def __len__(self) -> int:
        """Return the number of instances."""
        return len(self.transforms)

    def __getitem__(self, rows: slice | I64) -> Placements:
        """Return some of the instances."""
        return Placements(self.transforms[rows], self.turns[rows], self.stretches[rows])


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Consecutive instances of one field in drawing order."""

    field: Field
    cloud: SplatCloud
    """The field's splats, or the subset that a budget selects."""
    rows: I32 | None
    """Rows of the subset in the field's arrays; None without a subset."""
    distinct: Placements
    """The distinct instances of the draw list."""
    placed: I64
    """Row in `distinct` of each instance, shape (m,)."""
    first: int
    """First appearance of the group."""
    block: int
    """Slots per block."""
    blocks: int
    """Blocks per instance."""
    slot: int
    """First slot of the group."""

    @property
    def instances(self) -> int:
        """Number of instances."""
        return len(self.placed)

    @property
    def placements(self) -> Placements:
        """The instances."""
        return self.distinct[self.placed]

    @property
    def appearances(self) -> slice:
        """Rows of the group in arrays of all appearances."""
        return slice(self.first, self.first + self.instances)

    @property
    def all_blocks(self) -> int:
        """Blocks of all instances."""
        return self.instances * self.blocks

    @property
    def slots(self) -> int:
        """Slots of all instances."""
        return self.all_blocks * self.block


@dataclass(frozen=True, slots=True, eq=False)
class DrawList:
    """All groups, and the slots of each appearance."""

    groups: tuple[Group, ...]
    placements: Placements
    """The distinct instances."""
    placed: I64
    """Row of each appearance in `placements`, shape (n,)."""
    sizes: I64
    """Number of splats of each appearance, shape (n,)."""
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
    weights: F32 | None = None
    """Weight that fades each appearance, see `kernels.fading`, in [0, 1], shape (n,); 0 hides it.
    None if all are 1."""

    @property
    def slots(self) -> int:
        """Slots of all groups."""
        return self.groups[-1].slot + self.groups[-1].slots if self.groups else 0

    def fading(self, weights: F64) -> DrawList:
        """Return the layout with weights, which are rounded; it may have none before."""
        rounded = (np.rint(weights * WHOLE) / WHOLE).astype(np.float32)
        if (rounded == 1).all():
            return self
        return replace(self, weights=rounded, splats=int(self.sizes[rounded > 0].sum()))


def draw_list(drawn: Sequence[Drawn], others: Iterable[str] = (), *, budget: int = 0) -> DrawList:
    """Lay out appearances of splats.

    Args:
        drawn: The appearances in drawing order.
        others: Paths of the drawn prims that are not splats.
        budget: Maximum number of splats; each instance counts. 0 for all.
    """
    numbers: dict[int, int] = {}
    instances: list[InstanceSpec] = []
    for _, _, each in drawn:
        if numbers.setdefault(id(each), len(instances)) == len(instances):
            instances.append(each)
    return laid_out(
        [field for _, field, _ in drawn],
        np.ones(len(drawn), np.int64),
        instances,
        np.array([numbers[id(each)] for _, _, each in drawn], np.int64),
        others,
        budget=budget,
    )


def laid_out(
    fields: Sequence[Field],
    counts: I64,
    instances: Sequence[InstanceSpec],
    placed: I64,
    others: Iterable[str] = (),
    *,
    budget: int = 0,
) -> DrawList:
    """Lay out appearances of splats, see `draw_list`.

    Args:
        fields: The field of each run of appearances.
        counts: Number of appearances of each run.
        instances: The distinct instances.
        placed: Row in `instances` of each appearance, shape (n,).
        others, budget: See `draw_list`.
    """
    fields, counts = _joined(fields, counts)
    parts = _parts(fields, counts, budget)
    transforms = np.array([each.transform for each in instances]).reshape(-1, 4, 4)
    u, s, vt = np.linalg.svd(transforms[:, :3, :3])
    placements = Placements(transforms, u @ vt, vt.transpose(0, 2, 1) @ (s[:, :, None] * vt))
    groups: list[Group] = []
    shapes: list[tuple[int, int, int, int]] = []
    first, slot = 0, 0
    for field, count in zip(fields, counts.tolist(), strict=True):
        part = parts.get(id(field))
        cloud = field.spec.cloud if part is None else part.cloud
        size = len(cloud)
        block = max(1, min(size, project.BLOCK))
        blocks = -(-size // block)
        groups.append(
            Group(
                field=field,
                cloud=cloud,
                rows=None if part is None else part.rows,
                distinct=placements,
                placed=placed[first : first + count],
                first=first,
                block=block,
                blocks=blocks,
                slot=slot,
            )
        )
        shapes.append((size, block, blocks, slot))
        first, slot = first + count, slot + count * blocks * block
    paths = sorted({*others, *(each.path for each in instances)})
    prims = {path: number for number, path in enumerate(paths)}
    labels = [(prims[each.path], each.index) for each in instances]
    sizes, sides, along, slots = np.array(shapes, np.int64).reshape(-1, 4).T
    # ids of trees with more splats repeat, but are never negative, which is nothing
    elements = np.array(
        [field.first_element % (ELEMENT_IDS + 1 - len(field.spec.cloud)) for field in fields],
        np.int32,
    )
    return DrawList(
        groups=tuple(groups),
        placements=placements,
        placed=placed,
        sizes=np.repeat(sizes, counts),
        first_slots=stepping(slots, sides * along, counts),
        labels=np.array(labels, np.int32).reshape(-1, 2)[placed],
        block_starts=stepping(slots, sides, counts * along),
        prims=tuple(prims),
        first_elements=np.repeat(elements, counts) if elements.any() else elements[:0],
        splats=int(counts @ sizes),
        total=int(counts @ [len(each.spec.cloud) for each in fields] if parts else counts @ sizes),
    )


def _joined(fields: Sequence[Field], counts: I64) -> tuple[list[Field], I64]:
    """Join consecutive runs of one field."""
    starts = [i for i, field in enumerate(fields) if i == 0 or field is not fields[i - 1]]
    if len(starts) == len(fields):
        return list(fields), counts
    return [fields[i] for i in starts], np.add.reduceat(counts, starts)


def stepping(starts: I64, steps: I64 | int, counts: I64) -> I64:
    """Return, one after another, `counts` numbers from each start in steps."""
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    found: I64 = (
        np.repeat(starts, counts) + np.repeat(np.broadcast_to(steps, counts.shape), counts) * within
    )
    return found


def _parts(fields: Sequence[Field], counts: I64, budget: int) -> dict[int, SplatSubset]:
    """Return the subset of each field by its id; empty if all splats are drawn."""
    if budget == 0:
        return {}
    found: dict[int, tuple[Field, int]] = {}
    for field, count in zip(fields, counts.tolist(), strict=True):
        if not field.is_node:
            found[id(field)] = field, found.get(id(field), (field, 0))[1] + count
    sizes = [(len(field.spec.cloud), times) for field, times in found.values()]
    if sum(count * times for count, times in sizes) <= budget:
        return {}
    kept = shares(sizes, budget)
    return {
        key: field.subset(count)
        for (key, (field, _)), count in zip(found.items(), kept, strict=True)
    }
