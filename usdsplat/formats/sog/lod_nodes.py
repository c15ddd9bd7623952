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
from usdsplat.formats.json_reader import JsonReader
from usdsplat.formats.json_values import an_object, numbers, show, whole

MOST_NODES = 1 << 19
"""Maximum number of nodes of the tree."""
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
    """Reader of the tree of one `lod-meta.json`; `where` names it in errors."""

    def __init__(self, where: str, reader: JsonReader) -> None:
        self._where, self._reader = f"{where}: tree", reader
        self._parents = array("i")
        self._boxes = array("d")
        self._ranges = array("q")

    def read(self) -> LodNodes:
        """Read the value of the key `tree`, with all nodes.

        Raises:
            FormatError: If it is not a tree of nodes, a value is invalid, or there are more than
                MOST_NODES nodes.
        """
        waiting = [self._node(-1)]  # no recursion: trees may be deeper than Python's stack
        while waiting:
            parent = next(waiting[-1], None)
            if parent is None:
                waiting.pop()
            else:
                waiting.append(self._node(parent))
        corners = np.array(self._boxes, np.float64).reshape(-1, 2, 3)
        ranges = np.array(self._ranges, np.int64).reshape(-1, 5)
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

    def _node(self, parent: int) -> Iterator[int]:
        """Read a node; yield its number before each of its children, which the caller reads."""
        reader, bound = self._reader, None
        if reader.next() != "{":
            raise self._no_node(reader.value())
        number, before = len(self._parents), len(self._ranges)
        if number == MOST_NODES:
            raise FormatError(self._where, f"more than {MOST_NODES} nodes", "no more")
        self._parents.append(parent)
        self._boxes.extend(_NO_BOX)
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
        if bound is not None and len(self._ranges) > before:
            self._boxes[6 * number : 6 * number + 6] = array("d", self._box(bound))

    def _lods(self, node: int, lods: Any) -> None:
        """Collect the ranges of a node."""
        if not isinstance(lods, dict):
            raise self._no_node(lods)
        for key, value in lods.items():
            at = f"{self._where}: level {key[:20]!r}"
            if key not in _LEVELS or not isinstance(value, dict):
                raise FormatError(at, show(value), f"a range of a level below {MOST_LEVELS}")
            file = whole(f"{at}: file", value.get("file"), 0, _MOST)
            first = whole(f"{at}: offset", value.get("offset"), 0, _MOST)
            count = whole(f"{at}: count", value.get("count"), 0, _MOST)
            if count:
                self._ranges.extend((node, _LEVELS[key], file, first, count))

    def _box(self, bound: Any) -> list[float]:
        """Return the lower and the upper corner of a box."""
        where = f"{self._where}: bound"
        corners = an_object(where, bound)
        low, high = (
            numbers(f"{where}: {key}", corners.get(key), 3, largest=_LARGEST)
            for key in ("min", "max")
        )
        if (low > high).any():
            raise FormatError(where, show(bound), "a minimum that is not above the maximum")
        return [*low.tolist(), *high.tolist()]

    def _no_node(self, value: Any) -> FormatError:
        return FormatError(self._where, show(value), "a node with lods or children")
