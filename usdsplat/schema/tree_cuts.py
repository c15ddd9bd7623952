"""Read the splats of a cut of a splat tree."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pxr import Usd

from usdsplat.core.cloud import SplatCloud
from usdsplat.core.errors import StageError
from usdsplat.core.node_cuts import NodeCut, budget_cut
from usdsplat.core.sh import coefficient_count
from usdsplat.schema.chunks import ChunkReader, check_chunk
from usdsplat.schema.tree import Tree
from usdsplat.schema.validation.trees import missing_chunks


def cut_within(prim: Usd.Prim, tree: Tree, most: int) -> NodeCut:
    """Return the cut of at most `most` splats that refines the nodes of the largest errors first.

    Args:
        prim: Prim of the tree, for the error.
        tree: Result of `read_tree`.
        most: Number of splats.

    Raises:
        StageError: If there is no cut with so few splats.
    """
    cut = budget_cut(tree.table, most)
    if (found := cut.splats(tree.table)) > most:
        said = f"{found} splats at its coarsest level"
        raise StageError(str(prim.GetPath()), said, f"at most {most}")
    return cut


def cut_rasterize_mode(tree: Tree, cut: NodeCut) -> str:
    """Return the mode of most of the splats: that of the leaves, or "antialiased" for proxies."""
    table, nodes = tree.table, cut.nodes
    proxies = int(table.proxies[nodes[table.child_count[nodes] > 0]].sum())
    mode = tree.drawing.rasterize_mode or "classic"
    return "antialiased" if 2 * proxies > cut.splats(table) else mode


def read_cut(prim: Usd.Prim, tree: Tree, cut: NodeCut) -> SplatCloud:
    """Read the splats of a cut, in the local space of the tree.

    Args:
        prim: Prim of the tree, for errors.
        tree: Result of `read_tree`.
        cut: A cut of its table.

    Raises:
        StageError: If a chunk is missing, cannot be read, or does not have these rows.
    """
    check_chunks(prim, tree, cut)
    return read_rows(tree.reader(), cut.rows(tree.table), tree.degree)


def read_rows(reader: ChunkReader, rows: Sequence[tuple[int, int, int]], degree: int) -> SplatCloud:
    """Read rows of chunks as one cloud.

    Args:
        reader: Reader of the chunks.
        rows: What to read, as (chunk, first row, number of rows); see `NodeCut.rows`.
        degree: Degree of the harmonics of the chunks.

    Raises:
        StageError: If a chunk cannot be read, or does not have these rows.
    """
    n = sum(count for _, _, count in rows)
    cloud = SplatCloud(
        positions=np.empty((n, 3), np.float32),
        scales=np.empty((n, 3), np.float32),
        rotations=np.empty((n, 4), np.float32),
        opacities=np.empty(n, np.float32),
        sh=np.empty((n, coefficient_count(degree), 3), np.float32),
    )
    start = 0
    for chunk, first, count in rows:
        part = reader.read(chunk, first, count)
        for name in ("positions", "scales", "rotations", "opacities", "sh"):
            getattr(cloud, name)[start : start + count] = getattr(part, name)
        start += count
    return cloud


def check_chunks(prim: Usd.Prim, tree: Tree, cut: NodeCut) -> None:
    """Check that the chunks have the splats of a cut, before memory for all of them is allocated.

    Args and errors are those of `read_cut`.
    """
    needed: dict[int, int] = {}
    for chunk, first, count in cut.rows(tree.table):
        needed[chunk] = max(needed.get(chunk, 0), first + count)
    for chunk, count in needed.items():
        path = tree.chunks[chunk]
        if not path:
            (found,) = missing_chunks(prim, tree)
            raise StageError(found.path, found.found, found.expected)
        check_chunk(path, count, tree.degree, "as in the tree", tree.digest(chunk))
