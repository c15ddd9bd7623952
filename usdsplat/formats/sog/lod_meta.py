"""Parse `lod-meta.json` of a streamed SOG: the files and ranges of splats of each level.

The file holds a tree of boxes. Each leaf names, for each level of detail, one range of splats of
one SOG. The ranges of a level together are the capture at that level.

Source: splat-transform's writer. Files before version 1 lack `version` and `counts`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from usdsplat.core.errors import FormatError
from usdsplat.formats.json_values import a_list, parse_object, show, whole
from usdsplat.formats.sog.decoding import Range
from usdsplat.formats.sog.meta import META

LOD_META = "lod-meta.json"
LOD_META_LIMIT = 1 << 23
"""Maximum size of the file [byte]: some 50,000 leaves."""

_MOST = 1 << 32


@dataclass(frozen=True, slots=True)
class LodMeta:
    """The contents of `lod-meta.json`."""

    counts: tuple[int, ...]
    """Number of splats of each level, the finest first."""
    files: tuple[tuple[str, ...], ...]
    """SOGs of each level: paths relative to the folder of `lod-meta.json`."""
    ranges: tuple[tuple[tuple[Range, ...], ...], ...]
    """Ranges of splats of each of these files, ascending and disjoint."""
    environment: str | None
    """SOG of the distant environment, if there is one."""


def parse_lod_meta(where: str, text: bytes) -> LodMeta:
    """Parse and check `lod-meta.json`; `where` names it in errors.

    Raises:
        FormatError: If it is not JSON, or a value is missing or invalid: a name outside the folder,
            or a splat that occurs twice in a level.
    """
    meta = parse_object(where, text)
    whole(f"{where}: version", meta.get("version", 1), 1, 1)
    levels = whole(f"{where}: lodLevels", meta.get("lodLevels"), 1, 64)
    names = _names(where, meta.get("filenames"))
    found: list[dict[int, list[Range]]] = [{} for _ in range(levels)]
    for level, file, first, last in _references(where, meta.get("tree"), levels, len(names)):
        found[level].setdefault(file, []).append((first, last))
    ranges = [{file: _joined(where, names[file], level[file]) for file in level} for level in found]
    counts = [sum(b - a for file in level.values() for a, b in file) for level in ranges]
    if meta.get("counts", counts) != counts:
        expected = f"{counts}, which is what its tree holds"
        raise FormatError(f"{where}: counts", show(meta["counts"]), expected)
    environment = meta.get("environment")
    return LodMeta(
        counts=tuple(counts),
        files=tuple(tuple(names[file] for file in sorted(level)) for level in ranges),
        ranges=tuple(tuple(level[file] for file in sorted(level)) for level in ranges),
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


def _references(
    where: str, tree: Any, levels: int, files: int
) -> Iterator[tuple[int, int, int, int]]:
    """Yield (level, file, first splat, last splat + 1) of every leaf, in the tree's order."""
    waiting = [tree]
    while waiting:  # no recursion: trees may be deeper than Python's stack
        node = waiting.pop()
        lods, children = (
            (node.get("lods", {}), node.get("children", []))
            if isinstance(node, dict)
            else (None, None)
        )
        if not isinstance(lods, dict) or not isinstance(children, list):
            raise FormatError(f"{where}: tree", show(node), "a node with lods or children")
        waiting += reversed(children)
        for key, value in lods.items():
            at = f"{where}: tree: level {key[:20]!r}"
            if key not in map(str, range(levels)) or not isinstance(value, dict):
                raise FormatError(at, show(value), f"a range of a level below {levels}")
            file = whole(f"{at}: file", value.get("file"), 0, files - 1)
            first = whole(f"{at}: offset", value.get("offset"), 0, _MOST)
            count = whole(f"{at}: count", value.get("count"), 0, _MOST)
            if count:
                yield int(key), file, first, first + count


def _joined(where: str, name: str, ranges: list[Range]) -> tuple[Range, ...]:
    """Return the ranges in order, with adjacent ones joined."""
    joined: list[Range] = []
    for first, last in sorted(ranges):
        if joined and first < joined[-1][1]:
            raise FormatError(f"{where}: tree", f"splat {first} of {name} twice", "each once")
        if joined and first == joined[-1][1]:
            joined[-1] = (joined[-1][0], last)
        else:
            joined.append((first, last))
    return tuple(joined)
