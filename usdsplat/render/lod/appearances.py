"""The appearances of splats in one sample of a picture with splat trees, in drawing order."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from usdsplat.core.cloud import F64, I64
from usdsplat.render.draw_list import DrawList
from usdsplat.render.fields import Drawn, Field
from usdsplat.render.specs import InstanceSpec

Part = tuple[int, bool]
"""Node, and whether its proxies are meant; else its splats of the capture."""

PROXIES = ":proxies"
"""End of the name of proxies, which differs from that of the residents of the same node."""


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The k drawn parts of nodes of one tree, by node, each in some of the cut's instances."""

    is_inner: bool
    """Whether these are proxies of inner nodes; else splats of the capture."""
    nodes: I64
    """Shape (k,), ascending."""
    counts: I64
    """Number of instances with each part, shape (k,)."""
    instances: I64
    """These instances, part after part, shape (n,)."""
    errors: F64
    """Projected errors of the nodes there [pixel], shape (n,)."""
    above: F64
    """Errors of the nodes' parents, shape (n,)."""

    @property
    def urgency(self) -> F64:
        """The largest error that each part replaces, shape (k,)."""
        if not len(self.nodes):
            return np.empty(0)
        return np.maximum.reduceat(self.above, np.cumsum(self.counts) - self.counts)


@dataclass(frozen=True, slots=True, eq=False)
class Appearances:
    """Runs of consecutive appearances of one field, or of one part of a node."""

    names: list[tuple[str, Part | None]]
    """Path of each run's field or tree, and the part."""
    fields: list[Field]
    counts: I64
    """Appearances of each run."""
    instances: list[InstanceSpec]
    placed: I64
    """Row in `instances` of each appearance, shape (n,)."""
    errors: F64
    """Projected error of each appearance's node [pixel], shape (n,); minus infinity for splats of
    captures, which nothing replaces."""
    above: F64
    """Projected error of the node's parent [pixel], shape (n,); infinity without one."""

    def drawn(self) -> Iterator[Drawn]:
        """Yield each appearance."""
        at = 0
        for (path, part), field, count in zip(
            self.names, self.fields, self.counts.tolist(), strict=True
        ):
            name = path
            if part is not None:
                name = f"{path}:{part[0]}{PROXIES if part[1] else ''}"
            for row in self.placed[at : at + count].tolist():
                yield name, field, self.instances[row]
            at += count

    def is_laid_out_as(self, other: Appearances) -> bool:
        """Return whether both have the same fields and instances in the same order."""
        return self is other or (
            len(self.fields) == len(other.fields)
            and all(a is b for a, b in zip(self.fields, other.fields, strict=True))
            and self.instances == other.instances
            and np.array_equal(self.counts, other.counts)
            and np.array_equal(self.placed, other.placed)
        )


@dataclass(frozen=True, slots=True, eq=False)
class Laid:
    """The layout of the last picture with trees."""

    appearances: Appearances
    others: set[str]
    budget: int
    """See `draw_list`."""
    layout: DrawList

    def is_of(self, appearances: Appearances, others: set[str], budget: int) -> bool:
        """Return whether other arguments have the same layout."""
        return (
            self.budget == budget
            and self.others == others
            and appearances.is_laid_out_as(self.appearances)
        )


class Gatherer:
    """Collects the appearances of a sample.

    Args:
        drawn: Appearances of fields, sorted by path and index of their instances, and path.
    """

    def __init__(self, drawn: Sequence[Drawn]) -> None:
        self._drawn = drawn
        self._instances: list[InstanceSpec] = [each[2] for each in drawn]
        self._captured: list[tuple[tuple[str, int, str], _Block]] = []
        self._inner: list[_Block] = []

    def add_parts(
        self,
        path: str,
        parts: Parts,
        instances: Sequence[InstanceSpec | None],
        field_of: Callable[[Part], Field | None],
    ) -> None:
        """Add parts of nodes of a tree.

        Args:
            path: Path of the tree.
            instances: Instance of each of the cut's; None if this sample does not draw it.
            field_of: Returns the field of a part; None if it is not drawn.
        """
        numbers = np.full(len(instances), -1)
        for row, instance in enumerate(instances):
            if instance is not None:
                numbers[row] = len(self._instances)
                self._instances.append(instance)
        names: list[tuple[str, Part | None]] = [
            (path, (node, parts.is_inner)) for node in parts.nodes.tolist()
        ]
        fields = [field_of((node, parts.is_inner)) for node in parts.nodes.tolist()]
        placed = numbers[parts.instances]
        run = np.repeat(np.arange(len(names)), parts.counts)
        kept = (placed >= 0) & np.array([each is not None for each in fields], np.bool_)[run]
        counts = np.bincount(run[kept], minlength=len(names))
        if not kept.any():
            return
        block = _Block(
            names=[name for name, count in zip(names, counts, strict=True) if count],
            fields=[f for f, count in zip(fields, counts, strict=True) if f is not None and count],
            counts=counts[counts > 0],
            placed=placed[kept],
            errors=np.where(parts.is_inner, parts.errors, -np.inf)[kept],
            above=parts.above[kept],
        )
        if parts.is_inner:
            self._inner.append(block)
            return
        first = self._instances[block.placed[0]]
        self._captured.append(((first.path, first.index, path), block))

    def finish(self) -> Appearances:
        """Return the appearances in drawing order: splats of captures, in the order of their paths,
        then coarse levels."""
        blocks, first = [], 0
        for key, block in sorted(self._captured, key=lambda each: each[0]):
            end = bisect_left(self._drawn, key, key=lambda d: (d[2].path, d[2].index, d[0]))
            blocks += [self._fields(first, end), block]
            first = end
        blocks += [self._fields(first, len(self._drawn)), *self._inner]
        return Appearances(
            names=[name for block in blocks for name in block.names],
            fields=[field for block in blocks for field in block.fields],
            counts=np.concatenate([block.counts for block in blocks]),
            instances=self._instances,
            placed=np.concatenate([block.placed for block in blocks]),
            errors=np.concatenate([block.errors for block in blocks]),
            above=np.concatenate([block.above for block in blocks]),
        )

    def _fields(self, first: int, end: int) -> _Block:
        """Return some of the appearances of fields."""
        some, count = self._drawn[first:end], end - first
        return _Block(
            names=[(path, None) for path, _, _ in some],
            fields=[field for _, field, _ in some],
            counts=np.ones(count, np.int64),
            placed=np.arange(first, end),
            errors=np.full(count, -np.inf),
            above=np.full(count, np.inf),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """Appearances that follow each other, see `Appearances`."""

    names: list[tuple[str, Part | None]]
    fields: list[Field]
    counts: I64
    placed: I64
    errors: F64
    above: F64
