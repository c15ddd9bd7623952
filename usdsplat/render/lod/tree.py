"""Splat trees of a render scene."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from usdsplat.core.cloud import F64, I64, SplatCloud
from usdsplat.core.edit import take
from usdsplat.core.errors import UsdSplatError
from usdsplat.core.node_cuts import level_cut
from usdsplat.core.node_table import MOST_LEVELS, NodeTable
from usdsplat.core.sh import coefficient_count
from usdsplat.render.fields import Field
from usdsplat.render.lod.cache import Request
from usdsplat.render.lod.placing import Placed
from usdsplat.render.specs import (
    NO_GRADE,
    CropSpec,
    InstanceSpec,
    LightingMode,
    ProjectionMode,
    RasterizeMode,
    SortingMode,
    drawn_mode,
)

_TOPMOST = 64
"""Number of nodes that are read at most to find where the splats of a tree are."""

Load = Callable[[int, int, int], SplatCloud]
"""Return the splats of a chunk by its number, first row and number of rows. It raises a
UsdSplatError if they cannot be read, and is called by several threads."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TreeSpec:
    """A splat tree of one prim in local space, and the prim's rendering hints."""

    table: NodeTable
    """A valid table, see `check_nodes`."""
    chunks: tuple[Hashable, ...]
    """Token of each chunk, which is replaced when the chunk's content changes. Trees with equal
    tokens share the splats in memory."""
    load: Load
    live: Mapping[int, tuple[Hashable, SplatCloud]] = field(default_factory=dict)
    """Node -> (token, splats): splats in memory that are drawn instead of the node's rows in its
    chunk. Their number is the same. The token is another one whenever the splats are replaced."""
    degree: int = 0
    """Degree of the harmonics."""
    color_space: str = "srgb_rec709_scene"
    rasterize_mode: RasterizeMode = "classic"
    """Of leaves and residents, which are splats of the capture."""
    projection_mode: ProjectionMode = "perspective"
    sorting_mode: SortingMode = "zDepth"
    footprint: float = 0.0
    grade: tuple[float, ...] = NO_GRADE
    lighting: LightingMode = "auto"
    captured_lights: tuple[str, ...] = ()
    is_catcher: bool = False
    """See `FieldSpec`, as the two above."""

    def drawn_mode(self, mode: str) -> RasterizeMode:
        """Return how the low-pass changes the opacity of leaves, as for fields."""
        return drawn_mode(mode, self.rasterize_mode, self.footprint)

    @property
    def tokens(self) -> frozenset[Hashable]:
        """The tokens of all chunks and live splats."""
        return frozenset([*self.chunks, *(token for token, _ in self.live.values())])

    def token(self, node: int) -> Hashable:
        """Return the token of the content of a node with splats."""
        return self.live[node][0] if node in self.live else self.chunks[self.table.chunk[node]]

    def key(self, node: int, first: int, count: int) -> tuple[Hashable, int, int]:
        """Return a key of the content of rows of a node's chunk, which begins with its token."""
        return self.token(node), first, count

    def read(self, node: int, first: int, count: int) -> SplatCloud:
        """Return rows of a node's chunk, or the live splats in their place; see `Load`."""
        if node not in self.live:
            return self.load(int(self.table.chunk[node]), first, count)
        start = first - int(self.table.first_row[node])
        return take(self.live[node][1], np.arange(start, start + count))

    def draws_alike(self, other: TreeSpec) -> bool:
        """Return whether equal splats of a node are the same field of a draw list, but for the
        grade, which each picture compares."""
        names = (
            "degree", "color_space", "rasterize_mode", "projection_mode", "sorting_mode",
            "footprint", "lighting", "captured_lights",
        )  # fmt: skip
        same = all(getattr(self, name) == getattr(other, name) for name in names)
        return same and np.array_equal(self.first_elements(), other.first_elements())

    @property
    def splat_bytes(self) -> int:
        """Bytes of one splat in memory."""
        return 4 * (3 + 3 + 4 + 1 + 3 * coefficient_count(self.degree))

    @property
    def captured(self) -> int:
        """Number of splats of the capture: those of the leaves, and the residents."""
        return self.table.captured

    def first_elements(self) -> I64:
        """Return the element ids of the first captured splat and of the first proxy of each node,
        shape (2, n).

        Splats of the capture are numbered first, by node; then the proxies, by node. A cut of
        leaves therefore has the ids of a field with the same splats.
        """
        table = self.table
        leaf = table.child_count == 0
        captured = table.residents + np.where(leaf, table.proxies, 0)
        proxies = np.where(leaf, 0, table.proxies)
        return np.stack(
            [
                np.cumsum(captured) - captured,
                captured.sum() + np.cumsum(proxies) - proxies,
            ]
        )


@dataclass(slots=True, eq=False)
class Tree:
    """A splat tree of a scene, its instances, and what is kept between pictures."""

    spec: TreeSpec
    instances: tuple[InstanceSpec, ...] = ()
    visible: bool = True
    crops: tuple[CropSpec, ...] = ()
    elements: I64 = field(init=False)
    """See `TreeSpec.first_elements`."""
    problems: dict[int, UsdSplatError] = field(default_factory=dict)
    """Chunk -> why its splats could not be read."""
    closed: set[int] = field(default_factory=set)
    """Nodes that are not refined because a child cannot be read."""
    lost: set[int] = field(default_factory=set)
    """Nodes whose own splats cannot be read."""
    subject: tuple[F64, F64] | None = None
    """Bounds of the centres without outliers, in local space; computed on first use."""
    placed: Placed | None = None
    """The instances in the last picture."""
    fields: dict[tuple[int, bool], Field] = field(default_factory=dict)
    """(node, is inner) -> the splats as a field of the draw list, for what was drawn last."""
    requests: dict[tuple[int, bool], tuple[Hashable, Request]] = field(default_factory=dict)
    """(node, is inner) -> key of the splats in the cache, and how to read them; made on first
    use."""

    def __post_init__(self) -> None:
        self.elements = self.spec.first_elements()

    @property
    def is_drawn(self) -> bool:
        """Whether the tree is visible, and has instances and splats."""
        return self.visible and bool(self.instances) and self.spec.captured > 0

    @property
    def box(self) -> tuple[F64, F64]:
        """Bounds of all splats in local space."""
        table = self.spec.table
        return table.low[0].astype(np.float64), table.high[0].astype(np.float64)

    def coarsest(self) -> list[SplatCloud]:
        """Return the splats of the root; those of some of the topmost nodes with proxies if it has
        none. What cannot be read is left out."""
        table = self.spec.table
        nodes = level_cut(table, MOST_LEVELS).nodes.tolist()
        found = []
        for node in nodes[:: -(-len(nodes) // _TOPMOST)] if nodes else ():
            count = int(table.proxies[node] + table.residents[node])
            with suppress(UsdSplatError):  # drawing reports it
                found.append(self.spec.read(node, int(table.first_row[node]), count))
        return found

    def replace(self, spec: TreeSpec) -> None:
        """Replace the tree. Splats of unchanged chunks stay prepared."""
        before = self.spec
        is_same = spec.draws_alike(before)
        self.fields = {
            part: each
            for part, each in self.fields.items()
            if is_same and spec.token(part[0]) == before.token(part[0])
        }
        if (spec.table, spec.chunks, spec.live) != (before.table, before.chunks, before.live):
            self.subject = None
        self.spec, self.elements = spec, spec.first_elements()
        self.problems, self.closed, self.lost = {}, set(), set()
        self.requests = {}
