"""Make the nodes of a tree from sorted splats, from the leaves to the root."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usdsplat.core.cloud import F64, I64, SplatCloud
from usdsplat.core.errors import UsageError
from usdsplat.core.part import Part
from usdsplat.interchange.decimating import level
from usdsplat.interchange.lod import chunks, levels
from usdsplat.interchange.lod.chunks import ChunkForm, ChunkNodes, chunk_name, joined, taken
from usdsplat.interchange.lod.partition import Branch
from usdsplat.interchange.lod.runs import Runs
from usdsplat.kernels.device import Device

SHARES = 4
"""Least number of subtrees of a part of a building."""
TOP_SPLATS = 4096
"""Largest number of proxies of the root: a chain of nodes above the first one ends there."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Node:
    """The splats of a node, while its parent is made."""

    proxies: SplatCloud
    residents: SplatCloud
    strays: SplatCloud
    """Splats that are too large for the node."""
    low: F64
    """Lower corner of the box around all splats below, shape (3,); inf for a leaf."""
    high: F64
    size: float
    """Typical size of the proxies [unit]; 0 for a leaf."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NodeBuilder:
    """Maker of the nodes of a tree. Chunks that are finished are not made again.

    The splats of all children of a node are a chunk. The root, and the nodes of the chain above it,
    are the chunk 0.
    """

    runs: Runs
    root: Branch
    folder: Path
    """Folder of the chunks."""
    form: ChunkForm
    pixel: float
    """Size of the pixel of the baked low-pass [unit]; 0 for none."""
    most: int
    """Largest number of proxies of a node."""
    device: Device
    told: Callable[[int], None]
    """Called with the number of splats of leaves that have got into chunks."""

    def build(self) -> None:
        """Make all chunks.

        Raises:
            OutputError: If a file cannot be written.
        """
        if chunks.is_finished(self._path(0)):
            return
        numbers = chunk_numbers(self.root)
        top = self._node(self.root, numbers)
        residents = joined([top.residents, top.strays])
        is_leaf = not self.root.children
        chain = [Node(
            proxies=joined([top.proxies, residents]) if is_leaf else top.proxies,
            residents=chunks.rows(residents, 0, 0) if is_leaf else residents,
            strays=chunks.rows(top.strays, 0, 0),
            low=top.low, high=top.high, size=top.size,
        )]  # fmt: skip
        while len(chain[0].proxies) > TOP_SPLATS:
            below = chain[0]
            whole = joined([below.proxies, below.residents])
            is_baked = len(chain) > 1 or not is_leaf
            chain.insert(0, self._merged(whole if is_baked else self._baked(whole), below))
        self._write(0, chain, has_leaves=is_leaf, strays=chain[0].strays)

    def build_part(self, part: TreePart) -> None:
        """Make the chunks of a part, which other processes do not make.

        Raises:
            OutputError: If a file cannot be written.
        """
        numbers = chunk_numbers(self.root)
        for branch in part.branches(self.root):
            if not chunks.is_finished(self._path(numbers[id(branch)])):
                self._chunk(branch, numbers)

    def _node(self, branch: Branch, numbers: dict[int, int]) -> Node:
        """Make a node, after all below it."""
        if not branch.children:
            cloud = self.runs.gather(branch.span.first, branch.span.last)
            size, most = levels.node_size(cloud.positions), len(cloud) // levels.FEW
            own, large = taken(cloud, levels.strays(cloud, size, most=most))
            return Node(
                proxies=own,
                residents=chunks.rows(own, 0, 0),
                strays=large,
                low=np.full(3, np.inf),
                high=np.full(3, -np.inf),
                size=0.0,
            )
        path = self._path(numbers[id(branch)])
        if chunks.is_finished(path):
            drawn, nodes = chunks.read_chunk(path), chunks.read_nodes(path)
            self.told(branch.span.count)
        else:
            drawn, nodes = self._chunk(branch, numbers)
        counts = nodes.proxies + nodes.residents
        parts = [
            part if child.children else self._baked(part)
            for child, part in zip(branch.children, _groups(drawn, counts), strict=True)
        ]
        whole = joined(parts)
        merged = self._merged(whole, None)
        too_large = levels.strays(nodes.strays, levels.node_size(whole.positions))
        residents, passing = taken(nodes.strays, too_large)
        return Node(
            proxies=merged.proxies,
            residents=residents,
            strays=passing,
            low=nodes.low.min(axis=0),
            high=nodes.high.max(axis=0),
            size=merged.size,
        )

    def _chunk(self, branch: Branch, numbers: dict[int, int]) -> tuple[SplatCloud, ChunkNodes]:
        """Make the chunk of the children of a node, after all chunks below it."""
        below = [self._node(child, numbers) for child in branch.children]
        strays = joined([node.strays for node in below])
        has_leaves = any(not child.children for child in branch.children)
        written = self._write(numbers[id(branch)], below, has_leaves=has_leaves, strays=strays)
        self.told(sum(each.span.count for each in branch.children if not each.children))
        return written

    def _merged(self, whole: SplatCloud, below: Node | None) -> Node:
        """Return the node whose proxies stand for splats; `below` is its only child, if any."""
        proxies = level(whole, levels.proxy_count(len(whole), self.most), device=self.device)
        nothing = chunks.rows(whole, 0, 0)
        return Node(
            proxies=proxies,
            residents=nothing,
            strays=nothing,
            low=np.full(3, np.inf) if below is None else below.low,
            high=np.full(3, -np.inf) if below is None else below.high,
            size=levels.typical_size(proxies),
        )

    def _write(
        self, number: int, nodes: list[Node], *, has_leaves: bool, strays: SplatCloud
    ) -> tuple[SplatCloud, ChunkNodes]:
        """Write a chunk and what is known of its nodes, and return both."""
        path = self._path(number)
        proxies = np.array([len(node.proxies) for node in nodes], np.int64)
        residents = np.array([len(node.residents) for node in nodes], np.int64)
        own = joined([part for node in nodes for part in (node.proxies, node.residents)])
        drawn, digest = chunks.write_chunk(path, own, self.form, has_leaves=has_leaves)
        low, high = chunks.boxes_of(drawn, proxies + residents)
        if number == 0:  # each node of the chain is above the next one
            low = np.minimum.accumulate(low[::-1], axis=0)[::-1]
            high = np.maximum.accumulate(high[::-1], axis=0)[::-1]
        found = ChunkNodes(
            proxies=proxies,
            residents=residents,
            low=np.minimum(low, [node.low for node in nodes]),
            high=np.maximum(high, [node.high for node in nodes]),
            sizes=np.array([node.size for node in nodes]),
            strays=strays,
            digest=digest,
        )
        chunks.write_nodes(path, found)
        return drawn, found

    def _baked(self, cloud: SplatCloud) -> SplatCloud:
        """Return splats of the capture with the low-pass that merged ones have."""
        return levels.baked(cloud, self.pixel)

    def _path(self, number: int) -> Path:
        """Return the path of a chunk."""
        return self.folder / chunk_name(number)


class TreePart(Part):
    """A share of a building."""

    __slots__ = ()

    def takes(self, index: int) -> bool:
        """Return whether this part does the work with this number, from 0."""
        return index % self.count == self.number - 1

    def branches(self, root: Branch) -> list[Branch]:
        """Return the inner nodes whose chunks, and those below, are made by this part.

        They do not overlap. Each has at most a `SHARES`th of a part's splats, so that parts are
        alike in size; chunks above them are left.
        """
        most = root.span.count / (self.count * SHARES)
        found, open_nodes = [], [root]
        while open_nodes:
            branch = open_nodes.pop()
            if branch.span.count <= most and branch.children:
                found.append(branch)
            else:
                open_nodes.extend(reversed(branch.children))
        return [branch for index, branch in enumerate(found) if self.takes(index)]


STEPS = ("begin", "sort", "build")


@dataclass(frozen=True, slots=True)
class TreeStep:
    """A step of a building that is done in parts: to begin, to sort or to build."""

    name: str
    """One of `STEPS`."""
    part: TreePart
    """What is sorted or built; all of it to begin."""

    @classmethod
    def parse(cls, name: str, part: str | None) -> TreeStep:
        """Return the value of `--step` and `--part`.

        Raises:
            UsageError: If there is no such step or part.
        """
        if name not in STEPS:
            raise UsageError("--step", repr(name), f"one of {', '.join(STEPS)}")
        if (name == "begin") != (part is None):
            found = f"{part or 'none'} with --step {name}"
            raise UsageError("--part", found, "K/N with --step sort or build")
        return cls(name, TreePart(1, 1) if part is None else TreePart.parse(part))


def chunk_numbers(root: Branch) -> dict[int, int]:
    """Return the number of the chunk with the children of each inner node, by the node's id():
    breadth first, from 1."""
    inner = [branch for branch in root.breadth_first() if branch.children]
    return {id(branch): number for number, branch in enumerate(inner, 1)}


def _groups(cloud: SplatCloud, counts: I64) -> list[SplatCloud]:
    """Return consecutive groups of splats."""
    ends = np.cumsum(counts)
    return [
        chunks.rows(cloud, int(end - count), int(end))
        for count, end in zip(counts, ends, strict=True)
    ]
