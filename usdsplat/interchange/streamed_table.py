"""Make the table of a splat tree from the metadata of a streamed SOG.

Each leaf of `lod-meta.json` becomes a chain of nodes, one for each of its levels of detail. The
nodes above are empty and always refined.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from usdsplat.core.cloud import F64, I32, I64
from usdsplat.core.errors import FormatError
from usdsplat.core.extent import REACH
from usdsplat.core.node_table import MOST_LEVELS, NodeTable, nested, rounded
from usdsplat.formats.sog.lod_nodes import LodNodes

ERROR = 2.8
"""Error of a level relative to the typical size of its splats: the geometric mean of the six coarse
levels of one leaf of a capture, by the measure of `interchange.lod.pictures`."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RangeSizes:
    """What is known of the splats of m ranges, besides the boxes of their nodes."""

    low: F64
    """Lower corner of a box that contains the centres, shape (m, 3)."""
    high: F64
    """Upper corner, shape (m, 3)."""
    largest: F64
    """Largest scale, or more [unit], shape (m,)."""
    typical: F64
    """Typical size, 0 for the finest level [unit], shape (m,)."""


def table_of(where: str, nodes: LodNodes, sizes: RangeSizes) -> NodeTable:
    """Return the table of a tree; each file is a chunk.

    A level that a leaf lacks is left out of its chain, but the finest: without it, the chain ends
    in a leaf without splats.

    Args:
        where: The file, for errors.
        nodes: Its nodes, at least one.
        sizes: Sizes of the splats of each range.

    Raises:
        FormatError: If the tree has too many levels.
    """
    made = _Made.of(nodes)
    found = [0]
    for parent in made.parents[1:].tolist():  # a parent comes before its children
        found.append(found[parent] + 1)
    depths = np.array(found, np.int32)
    if (levels := int(depths.max()) + 1) > MOST_LEVELS:
        raise FormatError(f"{where}: tree", f"{levels} levels", f"at most {MOST_LEVELS}")
    order = _breadth_first(made.parents, depths)
    ranges = made.ranges[order]
    counts = np.bincount(made.parents[1:], minlength=len(order))[order].astype(np.int32)
    full = np.flatnonzero(ranges >= 0)
    mine = ranges[full]
    chunk = np.full(len(order), -1, np.int32)
    first, proxies = np.zeros(len(order), np.int64), np.zeros(len(order), np.int64)
    errors = np.where(counts > 0, np.inf, 0.0)
    chunk[full] = nodes.range_file[mine]
    first[full], proxies[full] = nodes.range_first[mine], nodes.range_count[mine]
    refined = full[counts[full] > 0]
    errors[refined] = ERROR * sizes.typical[ranges[refined]]
    table = NodeTable(
        low=np.zeros((len(order), 3), np.float32),
        high=np.zeros((len(order), 3), np.float32),
        errors=errors.astype(np.float32),
        first_child=np.where(counts > 0, 1 + np.cumsum(counts) - counts, 0).astype(np.int32),
        child_count=counts,
        chunk=chunk,
        first_row=first,
        proxies=proxies,
        residents=np.zeros(len(order), np.int64),
    )
    low, high = _boxes(nodes, sizes, ranges, table.parents(), depths[order])
    table.low[:], table.high[:] = rounded(low, -np.inf), rounded(high, np.inf)
    table.errors[:] = nested(errors, table)
    return table


@dataclass(frozen=True, slots=True, eq=False)
class _Made:
    """Nodes of the tree to be, each after its parent."""

    parents: I32
    """-1 for the root."""
    ranges: I64
    """Range of splats of each node, -1 for none."""

    @classmethod
    def of(cls, nodes: LodNodes) -> _Made:
        """Return the nodes of the file, and the chains of their levels.

        The nodes keep their numbers; that of a leaf is the coarsest of its chain.
        """
        is_leaf = np.bincount(nodes.parents[1:], minlength=len(nodes.parents)) == 0
        parents = nodes.parents.tolist()
        ranges = [-1] * len(parents)
        order = np.lexsort((-nodes.range_level, nodes.range_node))  # the coarsest first
        chain_node, last = -1, -1
        levels, owners = nodes.range_level.tolist(), nodes.range_node.tolist()
        for place, row in enumerate(order.tolist()):
            owner = owners[row]
            if owner != chain_node and is_leaf[owner]:
                last = owner
                ranges[owner] = row
            else:
                parents.append(owner if owner != chain_node else last)
                ranges.append(row)
                last = len(parents) - 1
            chain_node = owner
            ends = place + 1 == len(order) or owners[order[place + 1]] != owner
            if ends and levels[row]:
                parents.append(last)
                ranges.append(-1)
        return cls(np.array(parents, np.int32), np.array(ranges, np.int64))


def _breadth_first(parents: I32, depths: I32) -> I64:
    """Return the nodes breadth first, children of one parent together."""
    place = np.zeros(len(parents), np.int64)
    found = [np.array([0])]
    by_depth = np.argsort(depths, kind="stable")
    starts = np.searchsorted(depths[by_depth], np.arange(1, depths.max() + 2))
    total = 1
    for begin, end in pairwise(starts.tolist()):
        level = by_depth[begin:end]
        level = level[np.argsort(place[parents[level]], kind="stable")]
        place[level] = total + np.arange(len(level))
        total += len(level)
        found.append(level)
    return np.concatenate(found)


def _boxes(
    nodes: LodNodes, sizes: RangeSizes, ranges: I64, parents: I32, depths: I32
) -> tuple[F64, F64]:
    """Return boxes around the splats of each node and of all below it.

    The box of a node of the file is around the ellipsoids of one standard deviation. So none of
    them reaches further, along an axis, than half its width. Without a box, that of the file's
    centres is used.
    """
    low, high = np.full((len(ranges), 3), np.inf), np.full((len(ranges), 3), -np.inf)
    full = np.flatnonzero(ranges >= 0)
    mine = ranges[full]
    owner = nodes.range_node[mine]
    is_given = np.isfinite(nodes.low[owner])
    near = np.where(is_given, nodes.low[owner], sizes.low[mine])
    far = np.where(is_given, nodes.high[owner], sizes.high[mine])
    half = np.where(is_given, 0.5 * (far - near), np.inf)
    margin = REACH * np.minimum(sizes.largest[mine][:, None], half)
    low[full], high[full] = near - margin, far + margin
    for depth in range(int(depths.max()), 0, -1):
        level = np.flatnonzero(depths == depth)
        np.minimum.at(low, parents[level], low[level])
        np.maximum.at(high, parents[level], high[level])
    for node in np.flatnonzero(~np.isfinite(low[:, 0])).tolist():  # nothing below
        inside = low[parents[node]] if parents[node] >= 0 else np.zeros(3)
        low[node] = high[node] = inside
    return low, high
