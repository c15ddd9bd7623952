"""Read splat trees in the renderer's form, and notice changes of their chunks.

Chunks are layers that no stage composes. Their edits and their files are therefore watched here.
"""

from __future__ import annotations

import os
import threading
import time
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from typing import Any, cast

from pxr import Sdf, Tf, Usd

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.core.findings import Finding
from usdsplat.core.node_cuts import fixed_at
from usdsplat.delegate.scene_delegate.population import RprimEntry
from usdsplat.images.color import color_space
from usdsplat.images.grade import grade_matrix
from usdsplat.render.lod.tree import TreeSpec
from usdsplat.render.specs import ProjectionMode, RasterizeMode, SortingMode
from usdsplat.schema.chunks import ChunkReader
from usdsplat.schema.lod_roots import tree_level
from usdsplat.schema.tree import Tree, read_tree
from usdsplat.schema.validation.trees import broken_chunks, missing_chunks

CHUNKS = "splat:chunks"
PROPERTIES = ("splat:node", CHUNKS, "splat:lod:")
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
        self._tokens: dict[str, tuple[Any, ...]] = {}
        self._levels: dict[str, int | str | None] = {}
        """Tree -> level that an override demands, or why it has none."""
        self._looked = 0.0
        """When the files were looked at [s]."""
        self._key: Any = None

    def read(self, path: str, prim: Usd.Prim, at: float | None) -> TreeSpec:
        """Read the tree at `path`; its chunks are read when they are drawn.

        Raises:
            UsdSplatError: If the tree cannot be drawn.
        """
        if self._key is None:
            kind = Sdf.Notice.LayersDidChange
            self._key = Tf.Notice.RegisterGlobally(kind, self._collect)
        code = Usd.TimeCode.Default() if at is None else Usd.TimeCode(at)
        self._levels[path] = _level(prim, code)
        tree, level = read_tree(prim), tree_level(prim, code)
        self._of_trees[path] = tree
        tokens = {each: self._token(each) for each in tree.chunks}
        self._tokens |= tokens
        space = tree.color_space
        color_space(space, where=f"{prim.GetPath()} color space")
        mode, footprint = cast(RasterizeMode, schema.rasterize_mode(prim)), schema.footprint(prim)
        return TreeSpec(
            table=tree.table if level is None else fixed_at(tree.table, level),
            chunks=tuple(tokens[each] for each in tree.chunks),
            load=_Loader(str(prim.GetPath()), tree),
            degree=tree.degree,
            color_space=space,
            rasterize_mode="footprint" if footprint and mode == "classic" else mode,
            footprint=footprint or 0.0,
            projection_mode=cast(ProjectionMode, schema.projection_mode(prim)),
            sorting_mode=cast(SortingMode, schema.sorting_mode(prim)),
            grade=grade_matrix(schema.grade(prim, at), space),
        )

    def changed_trees(self) -> set[str]:
        """Return the paths of the trees of which a chunk has changed since they were read.

        Files are looked at once in POLL seconds.
        """
        with self._lock:
            changed, self._changed = self._changed, set()
        chunks = {chunk for tree in self._of_trees.values() for chunk in tree.chunks if chunk}
        self._edits.update(changed & chunks)
        now = time.monotonic()
        if now - self._looked >= POLL:
            self._looked = now
            changed |= {each for each in chunks if self._tokens.get(each) != self._token(each)}
        changed.discard("")  # a chunk without a file
        return {path for path, tree in self._of_trees.items() if changed.intersection(tree.chunks)}

    def changed_levels(self, fields: Mapping[str, RprimEntry], code: Usd.TimeCode) -> list[str]:
        """Return the paths of the trees that were read with another override of their level.

        Args:
            fields: The trees by path, and other fields.
            code: Time of the override.
        """
        known = self._levels.items()
        return [path for path, level in known if _level(fields[path].prim, code) != level]

    def keep(self, paths: Collection[str]) -> None:
        """Forget all trees but those at `paths`."""
        self._of_trees = {path: each for path, each in self._of_trees.items() if path in paths}
        self._levels = {path: each for path, each in self._levels.items() if path in paths}

    def findings(
        self, path: str, prim: Usd.Prim, problems: Mapping[int, UsdSplatError]
    ) -> Iterator[Finding]:
        """Yield what is wrong with the chunks of the tree at `path`.

        Args:
            path: Path of the tree.
            prim: Its prim.
            problems: Chunk -> why it could not be read.
        """
        tree = self._of_trees[path]
        yield from missing_chunks(prim, tree)
        there = [number for number in sorted(problems) if tree.chunks[number]]
        yield from broken_chunks(prim, [problems[number] for number in there])

    def close(self) -> None:
        """Stop watching."""
        if self._key is not None:
            self._key.Revoke()
            self._key = None

    # --- private ---------------------------------------------------------------------------

    def _token(self, path: str) -> tuple[Any, ...]:
        """Return a token of a chunk's content: its path, file and number of edits."""
        try:
            state = os.stat(path)
        except OSError:
            return path, None, None, self._edits[path]
        return path, state.st_mtime_ns, state.st_size, self._edits[path]

    def _collect(self, notice: Any, sender: Any) -> None:
        with self._lock:
            self._changed.update(layer.realPath or layer.identifier for layer in notice.GetLayers())


def _level(prim: Usd.Prim, code: Usd.TimeCode) -> int | str | None:
    """Return the level that an override demands of a tree, or the error of the override."""
    try:
        return tree_level(prim, code)
    except StageError as error:
        return str(error)


class _Loader:
    """Reader of the rows of a tree's chunks."""

    def __init__(self, where: str, tree: Tree) -> None:
        self._where, self._chunks = where, tree.chunks
        self._reader = ChunkReader(tree.chunks, tree.degree)

    def __call__(self, chunk: int, first: int, count: int) -> SplatCloud:
        path = self._chunks[chunk]
        if not path:
            raise StageError(self._where, f"no file for chunk {chunk}", "a layer")
        try:
            return self._reader.read(chunk, first, count)
        except Tf.ErrorException:
            raise StageError(path, "a file that USD cannot read", "a layer") from None
