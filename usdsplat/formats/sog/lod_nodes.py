"""Read the tree of `lod-meta.json`: nested boxes, whose leaves have a range of splats per level."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from usdsplat.core.cloud import F64, I32, I64
from usdsplat.core.errors import FormatError
from usdsplat.formats.json_reader import TOO_LONG, JsonReader
from usdsplat.formats.json_values import an_object, number_list, show, whole

MOST_NODES = 1 << 18
"""Maximum number of nodes of the tree."""
MOST_DEPTH = 64
"""Maximum number of nodes on the way from the root to a leaf."""
MOST_LEVELS = 64
"""Maximum number of levels of detail."""

_MOST = 1 << 32
_LARGEST = 1e30
_NO_BOX = (math.nan,) * 6
_LEVELS = {str(level): level for level in range(MOST_LEVELS)}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LodNodes:
    """The n nodes of the tree, each after its parent, and their m ranges of splats."""

    parents: I32
    """Parent of each node, -1 for the root, shape (n,)."""
    low: F64
    """Lower corner of the box of a node with ranges, shape (n, 3); NaN if the file has none."""
    high: F64
    """Upper corner, shape (n, 3)."""
    range_node: I32
    """Node of each range, ascending, shape (m,)."""
    range_level: I32
    """Level of detail, 0 is the finest, shape (m,)."""
    range_file: I64
    """Number of the SOG, shape (m,)."""
    range_first: I64
    """Index of the first splat, shape (m,)."""
    range_count: I64
    """Number of splats, above 0, shape (m,)."""


class NodeReader:
    """Reader of the tree of one `lod-meta.json`; `where` names it in errors.

    A short node is decoded as a whole with all nodes below it, which is ten times as fast as piece
    by piece.
    """

    def __init__(self, where: str, reader: JsonReader) -> None:
        self._where, self._reader = f"{where}: tree", reader
        bound = f"{self._where}: bound"
        self._of_bound = bound, f"{bound}: min", f"{bound}: max"
        self._parents = array("i")
        self._boxes = array("d")
        self._ranges = array("q")

    def read(self) -> LodNodes:
        """Read the value of the key `tree`, with all nodes.

        Raises:
            FormatError: If it is not a tree of nodes, a value is invalid, or there are more than
                MOST_NODES nodes, or MOST_DEPTH levels of them.
        """
        waiting = [iter((-1,))]  # of parents of the nodes that follow
        while waiting:
            parent = next(waiting[-1], None)
            if parent is None:
                waiting.pop()
            elif (short := self._reader.value_if_short()) is not TOO_LONG:
                self._add_all(short, parent, len(waiting))
            else:
                self._check_depth(len(waiting))
                waiting.append(self._node(parent))
        corners = np.array(self._boxes, np.float64).reshape(-1, 2, 3)
        ranges = np.frombuffer(self._ranges, np.int64).reshape(-1, 5)
        if (ranges[1:, 0] < ranges[:-1, 0]).any():
            ranges = ranges[np.argsort(ranges[:, 0], kind="stable")]
        return LodNodes(
            parents=np.array(self._parents, np.int32),
            low=corners[:, 0],
            high=corners[:, 1],
            range_node=ranges[:, 0].astype(np.int32),
            range_level=ranges[:, 1].astype(np.int32),
            range_file=ranges[:, 2],
            range_first=ranges[:, 3],
            range_count=ranges[:, 4],
        )

    def _add_all(self, value: Any, parent: int, depth: int) -> None:
        """Add a decoded node and all nodes below it, each after its parent."""
        waiting = [(value, parent, depth)]
        while waiting:
            value, parent, depth = waiting.pop()
            if not isinstance(value, dict):
                raise self._no_node(value)
            self._check_depth(depth)
            number, before = self._add(parent), len(self._ranges)
            if "lods" in value:
                self._lods(number, value["lods"])
                self._bound(number, value.get("bound"), before)
            children = value.get("children", ())
            if not isinstance(children, list | tuple):
                raise self._no_node(children)
            waiting += [(child, number, depth + 1) for child in reversed(children)]

    def _node(self, parent: int) -> Iterator[int]:
        """Read a long node. The caller reads its children: before each of them, the number of
        the node is yielded."""
        reader, bound = self._reader, None
        if reader.next() != "{":
            raise self._no_node(reader.value())
        number, before = self._add(parent), len(self._ranges)
        for key in reader.items():
            if key == "children":
                if reader.next() != "[":
                    raise self._no_node(reader.value())
                for _ in reader.elements():
                    yield number
            elif key == "lods":
                self._lods(number, reader.value())
            elif key == "bound":
                bound = reader.value()
            else:
                reader.value()
        self._bound(number, bound, before)

    def _add(self, parent: int) -> int:
        """Add a node without ranges, and return its number."""
        number = len(self._parents)
        if number == MOST_NODES:
            raise FormatError(self._where, f"more than {MOST_NODES} nodes", "no more")
        self._parents.append(parent)
        self._boxes.extend(_NO_BOX)
        return number

    def _check_depth(self, depth: int) -> None:
        if depth > MOST_DEPTH:
            raise FormatError(self._where, f"more than {MOST_DEPTH} levels of nodes", "no more")

    def _lods(self, node: int, lods: Any) -> None:
        """Collect the ranges of a node."""
        if not isinstance(lods, dict):
            raise self._no_node(lods)
        file: Any
        first: Any
        count: Any
        for key, value in lods.items():
            if key not in _LEVELS or not isinstance(value, dict):
                at = f"{self._where}: level {key[:20]!r}"
                raise FormatError(at, show(value), f"a range of a level below {MOST_LEVELS}")
            file, first, count = value.get("file"), value.get("offset"), value.get("count")
            if not type(file) is type(first) is type(count) is int or not (
                0 <= file <= _MOST and 0 <= first <= _MOST and 0 <= count <= _MOST
            ):
                self._check_range(key, value)
            if count:
                self._ranges.extend((node, _LEVELS[key], file, first, count))

    def _check_range(self, key: str, value: dict[str, Any]) -> None:
        """Raise an error that names the wrong number of a range."""
        for name in ("file", "offset", "count"):
            whole(f"{self._where}: level {key!r}: {name}", value.get(name), 0, _MOST)

    def _bound(self, node: int, bound: Any, before: int) -> None:
        """Set the box of a node that has ranges besides the first `before` numbers of all."""
        if bound is None or len(self._ranges) <= before:
            return
        where, of_low, of_high = self._of_bound
        corners = an_object(where, bound)
        low = number_list(of_low, corners.get("min"), 3, largest=_LARGEST)
        high = number_list(of_high, corners.get("max"), 3, largest=_LARGEST)
        if low[0] > high[0] or low[1] > high[1] or low[2] > high[2]:
            raise FormatError(where, show(bound), "a minimum that is not above the maximum")
        self._boxes[6 * node : 6 * node + 6] = array("d", (*low, *high))

    def _no_node(self, value: Any) -> FormatError:
        return FormatError(self._where, show(value), "a node with lods or children")
