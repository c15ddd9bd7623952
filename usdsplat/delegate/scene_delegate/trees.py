"""Read splat trees in the renderer's form, and notice changes of their chunks.

Chunks are layers that no stage composes. Their edits and their files are therefore watched here.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Collection, Hashable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from pxr import Sdf, Tf, Usd

from usdsplat import schema
from usdsplat.core.cloud import F64, SplatCloud
from usdsplat.core.errors import StageError, UsageError, UsdSplatError
from usdsplat.core.extent import extent
from usdsplat.core.findings import Finding
from usdsplat.core.node_cuts import fixed_at
from usdsplat.core.node_table import NodeTable
from usdsplat.delegate.dirty_bits import DirtyBits
from usdsplat.delegate.scene_delegate.population import RprimEntry
from usdsplat.images.color import color_space
from usdsplat.images.grade import grade_matrix
from usdsplat.render.lod.tree import TreeSpec
from usdsplat.render.specs import LightingMode, ProjectionMode, RasterizeMode, SortingMode
from usdsplat.schema.chunks import ChunkReader, chunk_stamp
from usdsplat.schema.lod_roots import tree_level
from usdsplat.schema.tree import Tree, chunk_files, chunk_shape, read_tree
from usdsplat.schema.validation.trees import broken_chunks, missing_chunks

PROPERTIES = ("splat:node", "splat:chunk", "splat:lod:")
"""Beginnings of the names of properties that a tree is read from, besides those of fields."""

POLL = 1.0
"""Least time between two looks at the files of chunks [s]."""


class Chunks:
    """The chunks of a stage's trees, and the edits of their layers.

    Layers are watched until `close`. The callback only records paths.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._changed: set[str] = set()
        self._edits: Counter[str] = Counter()
        self._of_trees: dict[str, Tree] = {}
        self._readers: dict[str, ChunkReader] = {}
        self._live: dict[str, dict[int, _Live]] = {}
        self._prims: dict[str, Usd.Prim] = {}
        self._known: dict[str, dict[str, tuple[Any, ...]]] = {}
        """Tokens of each tree's chunks at the time at which its table was read."""
        self._tokens: dict[str, tuple[Any, ...]] = {}
        self._levels: dict[str, int | str | None] = {}
        """Path of a tree -> its level, see `_level`."""
        self._looked = 0.0
        """When the files were looked at [s]."""
        self._key: Any = None

    def read(self, path: str, prim: Usd.Prim, bits: DirtyBits, at: float | None) -> TreeSpec:
        """Read the tree at `path`; its chunks are read when they are drawn.

        Args:
            path: Path of the tree.
            prim: Its prim.
            bits: What may have changed; TOPOLOGY stands for the table and the chunks' paths.
            at: Time code of the grade.

        Raises:
            UsdSplatError: If the tree cannot be drawn.
        """
        if self._key is None:
            kind = Sdf.Notice.LayersDidChange
            self._key = Tf.Notice.RegisterGlobally(kind, self._collect)
        code = Usd.TimeCode.Default() if at is None else Usd.TimeCode(at)
        self._levels[path] = _level(prim, code)
        level = tree_level(prim, code)
        if bits & DirtyBits.TOPOLOGY:
            self._of_trees.pop(path, None)
        tree = self._tree(path, prim)
        tokens = {each: self._token(each) for each in tree.chunks}
        self._tokens |= tokens
        space = schema.color_space(prim)
        color_space(space, where=f"{prim.GetPath()} color space")
        mode, footprint = cast(RasterizeMode, schema.rasterize_mode(prim)), schema.footprint(prim)
        live = self._live.get(path, {})
        return TreeSpec(
            table=_grown(tree.table if level is None else fixed_at(tree.table, level), live),
            live={node: (each.token, each.cloud) for node, each in live.items()},
            chunks=tuple((tokens[each], tree.digest(i)) for i, each in enumerate(tree.chunks)),
            load=_Loader(
                str(prim.GetPath()), tree, self._readers[path], self._changed_since(path, tokens)
            ),
            degree=tree.degree,
            color_space=space,
            rasterize_mode="footprint" if footprint and mode == "classic" else mode,
            footprint=footprint or 0.0,
            projection_mode=cast(ProjectionMode, schema.projection_mode(prim)),
            sorting_mode=cast(SortingMode, schema.sorting_mode(prim)),
            grade=grade_matrix(schema.grade(prim, at), space),
            lighting=cast(LightingMode, schema.lighting_mode(prim)),
            captured_lights=schema.captured_lights(prim),
            is_catcher=schema.is_shadow_catcher(prim),
        )

    def update(
        self, path: str, entry: RprimEntry | None, node: int, cloud: SplatCloud | None
    ) -> None:
        """Set the live splats of a node of the tree at `path`, or remove them if `cloud` is None.

        Raises:
            UsageError: If there is no such node, or the cloud has another number of splats or
                another degree than the node.
            UsdSplatError: If there is no tree that can be drawn.
        """
        if entry is None or not entry.is_tree:
            raise StageError(path, "no splat tree", "the path of one")
        tree = self._tree(path, entry.prim)
        if not 0 <= node < len(tree.table):
            raise UsageError(f"node of {path}", str(node), f"0 to {len(tree.table) - 1}")
        live = self._live.setdefault(path, {})
        if cloud is None:
            live.pop(node, None)
            return
        found = f"{len(cloud)} splats of degree {cloud.sh_degree}"
        expected = f"{tree.table.sizes[node]} splats of degree {tree.degree}"
        if found != expected:
            raise UsageError(f"node {node} of {path}", found, expected)
        live[node] = _Live(object(), cloud, extent(cloud))

    def changed_trees(
        self, fields: Mapping[str, RprimEntry], code: Usd.TimeCode, *, edited: bool
    ) -> set[str]:
        """Return the paths of the trees of which a chunk, or the override of their level, has
        changed since they were read.

        Files are looked at once in POLL seconds.

        Args:
            fields: The trees by path, and other fields.
            code: Time of the overrides.
            edited: Whether the stage or the time may have changed: overrides are looked at.
        """
        with self._lock:
            changed, self._changed = self._changed, set()
        chunks = {chunk for tree in self._of_trees.values() for chunk in tree.chunks if chunk}
        self._edits.update(changed & chunks)
        completed: set[str] = set()
        now = time.monotonic()
        if now - self._looked >= POLL:
            self._looked = now
            changed |= {each for each in chunks if self._tokens.get(each) != self._token(each)}
            completed = self._completed()
        changed.discard("")  # a chunk without a file
        found = {path for path, tree in self._of_trees.items() if changed.intersection(tree.chunks)}
        for path in completed:
            del self._of_trees[path]  # its chunks have other paths now
        levels = self._levels.items() if edited else ()
        forced = {path for path, level in levels if _level(fields[path].prim, code) != level}
        return found | completed | forced

    def keep(self, paths: Collection[str]) -> None:
        """Forget all trees but those at `paths`."""
        self._of_trees = {path: each for path, each in self._of_trees.items() if path in paths}
        self._levels = {path: each for path, each in self._levels.items() if path in paths}
        self._readers = {path: each for path, each in self._readers.items() if path in paths}
        self._live = {path: each for path, each in self._live.items() if path in paths}
        self._prims = {path: each for path, each in self._prims.items() if path in paths}
        self._known = {path: each for path, each in self._known.items() if path in paths}

    def findings(
        self, path: str, prim: Usd.Prim, problems: Mapping[int, UsdSplatError]
    ) -> Iterator[Finding]:
        """Yield what is wrong with the chunks of the tree at `path`.

        Args:
            path: Path of the tree.
            prim: Its prim.
            problems: Chunk -> why it could not be read.
        """
        tree = self._of_trees.get(path)
        if tree is None:  # it cannot be read any more, which is a problem of its own
            return
        yield from missing_chunks(prim, tree)
        there = [number for number in sorted(problems) if tree.chunks[number]]
        yield from broken_chunks(prim, [problems[number] for number in there])

    def close(self) -> None:
        """Stop watching."""
        if self._key is not None:
            self._key.Revoke()
            self._key = None

    # --- private ---------------------------------------------------------------------------

    def _changed_since(self, path: str, tokens: Mapping[str, tuple[Any, ...]]) -> frozenset[int]:
        """Return the chunks of the tree at `path` that have changed since its table was read."""
        known, chunks = self._known[path], self._of_trees[path].chunks
        return frozenset(i for i, each in enumerate(chunks) if tokens[each] != known[each])

    def _completed(self) -> set[str]:
        """Return the paths of the trees of which a missing chunk is there now."""
        incomplete = [path for path, tree in self._of_trees.items() if "" in tree.chunks]
        found = set()
        for path in incomplete:
            prim = self._prims[path]
            try:
                is_same = not prim or chunk_files(prim) == self._of_trees[path].chunks
            except StageError:  # reading the tree again reports it
                is_same = False
            if not is_same:
                found.add(path)
        return found

    def _tree(self, path: str, prim: Usd.Prim) -> Tree:
        """Return the tree at `path`; live splats that do not fit its table are removed."""
        if path not in self._of_trees:
            tree = self._of_trees[path] = read_tree(prim)
            self._readers[path] = tree.reader()
            self._prims[path] = prim
            self._known[path] = {each: self._token(each) for each in tree.chunks}
            self._live[path] = {
                node: each
                for node, each in self._live.get(path, {}).items()
                if node < len(tree.table)
                and len(each.cloud) == tree.table.sizes[node]
                and each.cloud.sh_degree == tree.degree
            }
        return self._of_trees[path]

    def _token(self, path: str) -> tuple[Any, ...]:
        """Return a token of a chunk's content: its path, file and number of edits."""
        return path, chunk_stamp(path), self._edits[path]

    def _collect(self, notice: Any, sender: Any) -> None:
        with self._lock:
            self._changed.update(layer.realPath or layer.identifier for layer in notice.GetLayers())


def _level(prim: Usd.Prim, code: Usd.TimeCode) -> int | str | None:
    """Return the level that an override sets for a tree; None without an override, or the text of
    the error if the override is invalid."""
    try:
        return tree_level(prim, code)
    except StageError as error:
        return str(error)


@dataclass(frozen=True, slots=True, eq=False)
class _Live:
    """Splats in memory that take the place of those of a node."""

    token: Hashable
    """Identifies this content: each update has another token."""
    cloud: SplatCloud
    box: F64 | None
    """Their extent, shape (2, 3); None without a finite splat."""


def _grown(table: NodeTable, live: Mapping[int, _Live]) -> NodeTable:
    """Return the table with boxes that contain the live splats; the same one if its boxes do."""
    if not live:
        return table
    low, high, parents = table.low.copy(), table.high.copy(), table.parents()
    for node, each in live.items():
        at = node
        while at >= 0 and each.box is not None:
            low[at] = np.minimum(low[at], np.nextafter(np.float32(each.box[0]), -np.inf))
            high[at] = np.maximum(high[at], np.nextafter(np.float32(each.box[1]), np.inf))
            at = int(parents[at])
    if np.array_equal(low, table.low) and np.array_equal(high, table.high):
        return table
    return replace(table, low=low, high=high)


class _Loader:
    """Reader of the rows of a tree's chunks."""

    def __init__(
        self, where: str, tree: Tree, reader: ChunkReader, changed: frozenset[int]
    ) -> None:
        self._where, self._tree, self._reader, self._changed = where, tree, reader, changed

    def __call__(self, chunk: int, first: int, count: int) -> SplatCloud:
        path = self._tree.chunks[chunk]
        if not path:
            raise StageError(self._where, f"no file for chunk {chunk}", "a layer")
        try:
            if chunk in self._changed:
                self._check_rows(chunk)
            found = self._reader.read(chunk, first, count)
        except Tf.ErrorException:
            raise StageError(path, "a file that USD cannot read", "a layer") from None
        if found.sh_degree != self._tree.degree:
            wrong = f"harmonics of degree {found.sh_degree}"
            raise StageError(path, wrong, f"{self._tree.degree}, as in the tree")
        return found

    def _check_rows(self, chunk: int) -> None:
        """Raise an error if the chunk has another number of rows than before: it may be one of a
        tree that was built anew, whose table has not been read. One that states the digest in the
        table is not."""
        path, before = self._tree.chunks[chunk], self._reader.counts.get(chunk)
        if before is None or self._tree.digest(chunk):
            return
        if (rows := chunk_shape(path)[0]) != before:
            found = f"{rows} splats after a change of the file"
            raise StageError(path, found, f"{before} as before; reload the stage")
