"""Parse `lod-meta.json` of a streamed SOG: the files and ranges of splats of each level.

The file holds a tree of boxes. Each leaf names, for each level of detail, one range of splats of
one SOG. The ranges of a level together are the capture at that level.

Source: splat-transform's writer. Files before version 1 lack `version` and `counts`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from usdsplat.core.errors import FormatError
from usdsplat.core.wording import counted
from usdsplat.formats.json_reader import JsonReader
from usdsplat.formats.json_values import a_list, show, whole
from usdsplat.formats.sog.decoding import Range
from usdsplat.formats.sog.lod_nodes import MOST_LEVELS, LodNodes, NodeReader
from usdsplat.formats.sog.meta import META

LOD_META = "lod-meta.json"
LOD_META_LIMIT = 1 << 25
"""Maximum size of the file [byte]: some 80,000 leaves with seven levels each."""

_KEYS = ("version", "lodLevels", "filenames", "counts", "environment")
_NAMES = 1 << 22
"""Maximum length of the list of files [character]: some 200,000 names."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LodMeta:
    """The contents of `lod-meta.json`."""

    names: tuple[str, ...]
    """All SOGs: paths relative to the folder of `lod-meta.json`."""
    nodes: LodNodes
    counts: tuple[int, ...]
    """Number of splats of each level, the finest first."""
    environment: str | None
    """SOG of the distant environment, if there is one."""

    def files(self, level: int) -> dict[str, tuple[Range, ...]]:
        """Return the SOGs of a level, and for each the ranges of its splats, ascending and
        disjoint; adjacent ones are joined."""
        nodes = self.nodes
        mine = np.flatnonzero(nodes.range_level == level)
        order = mine[np.lexsort((nodes.range_first[mine], nodes.range_file[mine]))]
        found: dict[str, list[Range]] = {}
        columns = (nodes.range_file[order], nodes.range_first[order], nodes.range_count[order])
        for file, first, count in zip(*(each.tolist() for each in columns), strict=True):
            ranges = found.setdefault(self.names[file], [])
            if ranges and first == ranges[-1][1]:
                ranges[-1] = (ranges[-1][0], first + count)
            else:
                ranges.append((first, first + count))
        return {name: tuple(ranges) for name, ranges in found.items()}


def parse_lod_meta(where: str, text: bytes) -> LodMeta:
    """Parse and check `lod-meta.json`; `where` names it in errors.

    Raises:
        FormatError: If it is not JSON, or a value is missing or invalid: a name outside the folder,
            or a splat that occurs twice.
    """
    reader = JsonReader(where, text)
    del text  # the reader has a copy
    meta: dict[str, Any] = {}
    nodes = None
    if reader.next() != "{":
        raise FormatError(where, show(reader.value(_NAMES)), "a JSON object")
    for key in reader.items():
        if key == "tree":
            nodes = NodeReader(where, reader).read()
        elif key in _KEYS:
            meta[key] = reader.value(_NAMES)
        else:
            reader.value(_NAMES)
    reader.end()
    whole(f"{where}: version", meta.get("version", 1), 1, 1)
    levels = whole(f"{where}: lodLevels", meta.get("lodLevels"), 1, MOST_LEVELS)
    names = _names(where, meta.get("filenames"))
    if nodes is None:
        raise FormatError(f"{where}: tree", show(None), "a node with lods or children")
    _check_ranges(where, nodes, levels, names)
    counts = [int(nodes.range_count[nodes.range_level == k].sum()) for k in range(levels)]
    if meta.get("counts", counts) != counts:
        expected = f"{counts}, which is what its tree holds"
        raise FormatError(f"{where}: counts", show(meta["counts"]), expected)
    environment = meta.get("environment")
    return LodMeta(
        names=tuple(names),
        nodes=nodes,
        counts=tuple(counts),
        environment=None if environment is None else _name(f"{where}: environment", environment),
    )


def _names(where: str, value: Any) -> list[str]:
    """Return the paths of the files, without duplicates."""
    names = [_name(f"{where}: filenames", name) for name in a_list(f"{where}: filenames", value)]
    if len(set(names)) < len(names):
        raise FormatError(f"{where}: filenames", "a name twice", "each once")
    return names


def _name(where: str, name: Any) -> str:
    """Return the path of a SOG in the folder or below it."""
    parts = name.split("/") if isinstance(name, str) else [""]
    harmless = not any(part in ("", ".", "..") or set(part) & set("\\:\0") for part in parts)
    if not harmless or not (parts[-1] == META or parts[-1].lower().endswith(".sog")):
        raise FormatError(where, show(name), f"a .sog or {META} in or below the same folder")
    return "/".join(parts)


def _check_ranges(where: str, nodes: LodNodes, levels: int, names: list[str]) -> None:
    """Raise an error for a range of no level or file, and for splats that are in two ranges, of one
    level or of two."""
    at = f"{where}: tree"
    if (beyond := nodes.range_level[nodes.range_level >= levels]).size:
        expected = f"a range of a level below {levels}"
        raise FormatError(f"{at}: level '{beyond[0]}'", counted(levels, "level"), expected)
    if (unknown := nodes.range_file[nodes.range_file >= len(names)]).size:
        expected = f"a whole number from 0 to {len(names) - 1}"
        raise FormatError(f"{at}: file", str(unknown[0]), expected)
    order = np.lexsort((nodes.range_first, nodes.range_file))
    file, first = nodes.range_file[order], nodes.range_first[order]
    ends, same = first + nodes.range_count[order], file[1:] == file[:-1]
    if (twice := np.flatnonzero(same & (first[1:] < ends[:-1]))).size:
        row = twice[0] + 1
        raise FormatError(at, f"splat {first[row]} of {names[file[row]]} twice", "each once")
