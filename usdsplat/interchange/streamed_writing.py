"""Write splat trees as a streamed SOG, with the levels of detail cut per leaf."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd

from usdsplat import schema
from usdsplat.core import edit, morton
from usdsplat.core.axes import change as change_axes
from usdsplat.core.cloud import F32, F64, I64, SplatCloud
from usdsplat.core.errors import OutputError, StageError
from usdsplat.core.extent import deviations
from usdsplat.core.node_cuts import heights, level_cut
from usdsplat.core.output import is_private, output_group, write_output
from usdsplat.core.progress import Progress, silent
from usdsplat.formats.sog import ERROR_BOUNDS, FRAME, MAX_DEGREE
from usdsplat.formats.sog.encoding import encode
from usdsplat.formats.sog.meta import META
from usdsplat.formats.sog.target import write_folder
from usdsplat.interchange import files
from usdsplat.interchange.appearances import Appearance, appearances
from usdsplat.interchange.options import StageReading
from usdsplat.interchange.placement import stage_frame
from usdsplat.interchange.reports import ExportReport
from usdsplat.interchange.unapplied import unapplied
from usdsplat.schema.composition import composition_findings
from usdsplat.schema.tree import Tree
from usdsplat.schema.tree_cuts import TreeReading

UNIT = 1 << 19
"""Number of splats from which on a SOG file is full; splat-transform's, too."""


def write_streamed(
    source: Path | Usd.Stage,
    target: Path,
    reading: StageReading,
    *,
    axes: str | None = None,
    progress: Progress = silent,
) -> ExportReport:
    """Write the visible splat trees of a stage as a streamed SOG, in world space.

    Each leaf of a tree is a leaf of the file. Level k has the topmost nodes with at most k levels
    below them. Their splats, and the residents above, belong to the nearest leaf below their node.

    Args:
        source: A USD file, or a stage, with splat trees and no fields.
        target: `lod-meta.json` in a folder without other files, which exists.
        reading: What is read of the stage.
        axes: Axes of the file; None is "rdf", as is customary.
        progress: Receives the progress of writing.

    Raises:
        StageError: If the stage cannot be opened, or has visible fields, or a tree cannot be read.
        UsageError: If the axes are invalid.
        OutputError: If the folder has files, or a file cannot be written.
    """
    if not target.parent.is_dir():
        raise OutputError(str(target), "no such folder", "an empty folder")
    if not all(is_private(each.name) for each in target.parent.iterdir()):
        raise OutputError(str(target), "a folder with other files", "a new or an empty folder")
    stage = source if isinstance(source, Usd.Stage) else files.open_stage(source)
    found, notes = appearances(stage, reading)
    frame = axes or FRAME
    turn = np.eye(4)
    turn[:3, :3] = change_axes(stage_frame(stage), frame)
    places = [_Place(item, turn @ matrix) for item in found for matrix in item.to_world]
    with output_group():
        writer, done = _Writer(target), 0
        total = sum(each.levels * each.leaves for each in places)
        for place in places:
            for level in range(place.levels):
                for leaf, cloud in place.splats(level):
                    writer.add(place, level, leaf, cloud)
                    done += 1
                    progress.step(f"writing {target}", done, total)
        writer.finish(places)
    prims = [item.prim for item in found]
    return ExportReport(
        source=str(source),
        target=str(target),
        prim_paths=tuple(str(prim.GetPath()) for prim in prims),
        splats=writer.counts.get(0, 0),
        degree=max(place.degree for place in places),
        frame=frame,
        error_bounds=ERROR_BOUNDS,
        notes=tuple(notes),
        findings=(*composition_findings(stage), *unapplied(prims, reading.time)),
    )


@dataclass(slots=True, eq=False)
class _Place:
    """A tree at one of the places where it appears.

    Raises:
        StageError: If it is a field, or a chunk is missing or does not fit the tree.
    """

    item: Appearance
    to_file: F64
    """Matrix from the tree to the coordinates of the file, shape (4, 4)."""
    tree: Tree = field(init=False)
    degree: int = field(init=False)
    levels: int = field(init=False)
    """Number of levels of detail."""
    lods: dict[int, dict[str, dict[str, int]]] = field(default_factory=dict)
    """Leaf -> level -> range of splats, of what is written."""
    boxes: dict[int, F64] = field(default_factory=dict)
    """Leaf -> box around the splats of all levels, to one standard deviation, shape (2, 3)."""

    def __post_init__(self) -> None:
        if not self.item.trees:
            where = str(self.item.prim.GetPath())
            raise StageError(where, "a splat field", "splat trees only; usdsplat lod makes one")
        self.tree = self.item.trees[0].tree
        self.degree = min(self.tree.degree, MAX_DEGREE)
        table = self.tree.table
        self.levels = 1 + int(heights(table)[np.isfinite(table.errors)].max(initial=0))
        for level in range(self.levels):
            cut = level_cut(table, level)
            TreeReading(self.item.prim, self.tree, cut).check_chunks()

    @property
    def leaves(self) -> int:
        """Number of leaves of the tree."""
        return int((self.tree.table.child_count == 0).sum())

    def splats(self, level: int) -> Iterator[tuple[int, SplatCloud]]:
        """Yield the leaves with splats of a level, and these, in the coordinates of the file."""
        table, reader = self.tree.table, self.tree.reader()
        cut = level_cut(table, level)
        above: dict[int, list[SplatCloud]] = {}
        for node in cut.above.tolist():
            if count := int(table.residents[node]):
                first = int(table.first_row[node] + table.proxies[node])
                cloud = reader.read(int(table.chunk[node]), first, count)
                for leaf, part in self._by_leaf(node, cloud):
                    above.setdefault(leaf, []).append(part)
        for node in cut.nodes.tolist():
            count = int(table.proxies[node] + table.residents[node])
            own: dict[int, list[SplatCloud]] = {}
            if count:
                cloud = reader.read(int(table.chunk[node]), int(table.first_row[node]), count)
                own = {leaf: [part] for leaf, part in self._by_leaf(node, cloud)}
            for leaf in self._leaves(node).tolist():
                if parts := [*own.get(leaf, ()), *above.get(leaf, ())]:
                    cloud = edit.with_sh_degree(edit.merge(parts), self.degree)
                    yield leaf, edit.prune(self.item.placed(cloud, self.to_file))

    def _leaves(self, node: int) -> I64:
        """Return the leaves below a node, or the node itself if it is one."""
        table = self.tree.table
        first, last = node, node + 1
        found = []
        while first < last:  # the nodes of a level below follow each other
            here = np.arange(first, last)
            found.append(here[table.child_count[here] == 0])
            inner = here[table.child_count[here] > 0]
            if not len(inner):
                break
            first = int(table.first_child[inner[0]])
            last = int(table.first_child[inner[-1]] + table.child_count[inner[-1]])
        return np.concatenate(found)

    def _by_leaf(self, node: int, cloud: SplatCloud) -> Iterator[tuple[int, SplatCloud]]:
        """Yield each leaf below a node that is the nearest to some splats, and these."""
        leaves = self._leaves(node)
        owner = np.full(len(cloud), leaves[0])
        if len(leaves) > 1:
            nearest = np.full(len(cloud), np.inf)
            for leaf in leaves.tolist():
                distance = self._distances(leaf, cloud.positions)
                closer = distance < nearest
                owner[closer], nearest[closer] = leaf, distance[closer]
        order = np.argsort(owner, kind="stable")
        starts = np.flatnonzero(np.diff(owner[order], prepend=-1))
        for rows in np.split(order, starts[1:]):
            yield int(owner[rows[0]]), edit.take(cloud, rows)

    def _distances(self, leaf: int, positions: F32) -> F32:
        """Return the distance of points from the middle of the box of a leaf, in its half edges."""
        low, high = self.tree.table.low[leaf], self.tree.table.high[leaf]
        half = np.maximum(0.5 * (high - low), np.finfo(np.float32).tiny)
        return np.asarray(np.abs((positions - 0.5 * (low + high)) / half).max(axis=1))


class _Writer:
    """The SOG files of a streamed SOG, of which one for each level is being filled."""

    def __init__(self, target: Path) -> None:
        self._target = target
        self._names: list[str] = []
        self._filled: dict[tuple[int, bool], tuple[int, list[SplatCloud]]] = {}
        """(level, whether it is antialiased) -> number of the file, splats."""
        self._units: dict[int, int] = {}
        self.counts: dict[int, int] = {}
        """Number of splats of each level."""

    def add(self, place: _Place, level: int, leaf: int, cloud: SplatCloud) -> None:
        """Add the splats of a level of a leaf."""
        if not len(cloud):
            return
        antialiased = level > 0 or schema.rasterize_mode(place.item.prim) == "antialiased"
        key = level, antialiased
        if key not in self._filled:
            number = self._units.get(level, 0)
            self._units[level] = number + 1
            self._names.append(f"{level}_{number}/{META}")
            self._filled[key] = len(self._names) - 1, []
        file, clouds = self._filled[key]
        first = sum(map(len, clouds))
        place.lods.setdefault(leaf, {})[str(level)] = {
            "file": file,
            "offset": first,
            "count": len(cloud),
        }
        clouds.append(edit.take(cloud, morton.order(cloud.positions)))
        size = deviations(cloud.scales, cloud.rotations).T
        box = np.stack([(cloud.positions - size).min(axis=0), (cloud.positions + size).max(axis=0)])
        place.boxes[leaf] = _around([box, *([place.boxes[leaf]] if leaf in place.boxes else [])])
        self.counts[level] = self.counts.get(level, 0) + len(cloud)
        if first + len(cloud) >= UNIT:
            self._flush(key)

    def finish(self, places: list[_Place]) -> None:
        """Write the files that are not full, and `lod-meta.json`."""
        for key in list(self._filled):
            self._flush(key)
        trees = [tree for tree in (_tree(each, 0) for each in places) if tree]
        if not trees:
            raise StageError(str(self._target), "no splats", "at least one")
        levels = max(self.counts) + 1
        counts = [self.counts.get(level, 0) for level in range(levels)]
        meta = {
            "version": 1,
            "asset": {"generator": "usdsplat"},
            "count": sum(counts),
            "counts": counts,
            "lodLevels": levels,
            "filenames": self._names,
            "tree": trees[0] if len(trees) == 1 else _joined(trees),
        }
        write_output(self._target, json.dumps(meta, separators=(",", ":")).encode())

    def _flush(self, key: tuple[int, bool]) -> None:
        """Write the file of a level that is being filled."""
        file, clouds = self._filled.pop(key)
        path = self._target.parent / self._names[file]
        cloud = edit.merge(clouds)
        sog = encode(str(path), cloud, antialiased=key[1], told=lambda _: None, sort=False)
        write_folder(path, sog)


def _tree(place: _Place, node: int) -> dict[str, Any] | None:
    """Return a node as in `lod-meta.json`; None if nothing is written below it."""
    table = place.tree.table
    if not table.child_count[node]:
        if node not in place.lods:
            return None
        return {"bound": _bound(place.boxes[node]), "lods": place.lods[node]}
    first, count = int(table.first_child[node]), int(table.child_count[node])
    children = [_tree(place, child) for child in range(first, first + count)]
    kept = [child for child in children if child]
    return _joined(kept) if kept else None


def _joined(children: list[dict[str, Any]]) -> dict[str, Any]:
    """Return a node with children."""
    boxes = [np.array([each["bound"]["min"], each["bound"]["max"]]) for each in children]
    return {"bound": _bound(_around(boxes)), "children": children}


def _bound(box: F64) -> dict[str, list[float]]:
    """Return a box as in `lod-meta.json`."""
    return {"min": box[0].tolist(), "max": box[1].tolist()}


def _around(boxes: list[F64]) -> F64:
    """Return the box around some, shape (2, 3)."""
    low, high = (np.stack([box[k] for box in boxes]) for k in (0, 1))
    return np.stack([low.min(axis=0), high.max(axis=0)]).astype(np.float64)
