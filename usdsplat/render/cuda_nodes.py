"""Runs of nodes of splat trees that a GPU draws in one launch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from usdsplat.core.cloud import F32, I32, I64, SplatCloud
from usdsplat.kernels.cuda.frame.groups import FrameNodes
from usdsplat.kernels.cuda.frame.picture import size_of
from usdsplat.kernels.cuda.frame.project import PART
from usdsplat.kernels.fading import WHOLE
from usdsplat.render.draw_list import DrawList, Group, Placements, stepping

INSTANCES = 64
"""The number of matrices of a run is a multiple of this."""
MOST = 8
"""Tables keep their sizes up to this multiple of what is needed; new ones have 1 / MOST more."""

PagesOf = Callable[[int, Sequence[SplatCloud]], Sequence[I32]]
"""Return the pages of clouds, see `NodePool.pages_of`; first the number of coefficients of their
harmonics."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NodeRun:
    """Consecutive groups of nodes that differ in nothing but splats and instances.

    It does not refer to the splats of the host.
    """

    head: int
    """Number of the first group in the layout."""
    coefficients: int
    """Number of coefficients of the harmonics."""
    placements: Placements
    """The distinct instances, and others that are not used."""
    table: I32
    """See `FrameView.parts`; rows without splats follow."""
    owners: I64
    """Appearance of each part in the layout; shape (parts,)."""

    def frame_nodes(self, arrays: tuple[Any, ...], degree: int) -> FrameNodes:
        """Return the run for a `FramePicture`, with the arrays of its pool."""
        return FrameNodes(
            splats=arrays, instances=len(self.placements), all_parts=len(self.table), degree=degree
        )

    def drawn(self, weights: F32 | None) -> I32:
        """Return the table with the weights of a sample; hidden appearances have no splats."""
        if weights is None:
            return self.table
        table = self.table.copy()
        of_parts = weights[self.owners]
        table[: len(self.owners), 1][of_parts == 0] = 0
        table[: len(self.owners), 3] = of_parts * WHOLE
        return table


def planned(
    layout: DrawList, pages_of: PagesOf, before: Sequence[NodeRun] = ()
) -> list[int | NodeRun]:
    """Return what a picture draws, in order: numbers of groups of fields, and runs of nodes.

    Args:
        before: The runs of the last picture. Tables that are not much too large keep their sizes,
            so that recorded launches can be used again.
    """
    plan: list[int | list[int]] = []
    alike: Any = None
    for number, group in enumerate(layout.groups):
        form = _form(group) if group.field.is_node else None
        if form is None:
            plan.append(number)
        elif form == alike:
            assert isinstance(plan[-1], list)
            plan[-1].append(number)
        else:
            plan.append([number])
        alike = form
    pages = _pages(layout, [each for each in plan if isinstance(each, list)], pages_of)
    sizes = ((len(each.table), len(each.placements)) for each in before)
    return [
        _run(layout, each, pages, next(sizes, (0, 0))) if isinstance(each, list) else each
        for each in plan
    ]


def _form(group: Group) -> Any:
    """Return what all groups of a run have in common."""
    field, spec = group.field, group.field.spec
    return (
        field.is_inner, spec.color_space, spec.projection_mode, spec.rasterize_mode, spec.footprint,
        spec.grade, group.cloud.sh.shape[1],
    )  # fmt: skip


def _pages(layout: DrawList, runs: Sequence[Sequence[int]], pages_of: PagesOf) -> dict[int, I32]:
    """Return the pages of each group of the runs."""
    found: dict[int, I32] = {}
    by_pool: dict[int, list[int]] = {}
    for run in runs:
        by_pool.setdefault(layout.groups[run[0]].cloud.sh.shape[1], []).extend(run)
    for coefficients, numbers in by_pool.items():
        clouds = [layout.groups[number].cloud for number in numbers]
        found.update(zip(numbers, pages_of(coefficients, clouds), strict=True))
    return found


def _run(
    layout: DrawList, numbers: Sequence[int], pages: dict[int, I32], before: tuple[int, int]
) -> NodeRun:
    groups = [layout.groups[number] for number in numbers]
    first, end = groups[0].appearances.start, groups[-1].appearances.stop
    lengths = np.array([len(pages[number]) for number in numbers], np.int64)
    group = np.repeat(np.arange(len(groups)), [each.instances for each in groups])  # of appearances
    along = lengths[group]
    places = stepping((np.cumsum(lengths) - lengths)[group], 1, along)
    within = stepping(np.zeros_like(along), 1, along)
    owner = np.repeat(np.arange(len(group)), along)
    used, placed = np.unique(layout.placed[first:end], return_inverse=True)
    rows, matrices = (
        size if count <= size <= MOST * count else count + count // MOST
        for count, size in zip((len(owner), len(used)), before, strict=True)
    )
    matrices = -(-matrices // INSTANCES) * INSTANCES
    used = np.pad(used, (0, matrices - len(used)), mode="edge")
    table = np.zeros((size_of(rows), 4), np.int32)
    parts = table[: len(owner)]
    parts[:, 0] = PART * np.concatenate([pages[number] for number in numbers])[places]
    parts[:, 1] = np.minimum(PART, layout.sizes[first + owner] - PART * within)
    parts[:, 2] = placed[owner]
    parts[:, 3] = WHOLE
    return NodeRun(
        head=numbers[0],
        coefficients=groups[0].cloud.sh.shape[1],
        placements=layout.placements[used],
        table=table,
        owners=first + owner,
    )
