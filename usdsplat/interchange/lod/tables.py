"""Assemble the table of a tree from what is known of the nodes of its chunks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from usdsplat.core.cloud import F64
from usdsplat.core.node_table import NodeTable, rounded
from usdsplat.interchange.lod.chunks import ChunkNodes, chunk_name, read_nodes
from usdsplat.interchange.lod.nodes import chunk_numbers
from usdsplat.interchange.lod.partition import Branch


def assemble(root: Branch, folder: Path) -> tuple[NodeTable, F64, tuple[str, ...]]:
    """Return the table with the errors 0 for leaves and 1 for inner nodes, typical sizes, and
    digests.

    Args:
        root: The tree.
        folder: Folder of its chunks.

    Returns:
        The table; the typical size of the proxies of each node [unit], 0 for a leaf, shape (n,);
        and the digest of each chunk.
    """
    branches, numbers = root.breadth_first(), chunk_numbers(root)
    top = read_nodes(folder / chunk_name(0))
    above = len(top.proxies) - 1  # nodes of the chain above the root of the branches
    found: list[ChunkNodes] = [top]
    chunk = [0] * (above + 1)
    children = [1] * above + [len(branch.children) for branch in branches]
    for branch in branches:
        if branch.children:
            found.append(read_nodes(folder / chunk_name(numbers[id(branch)])))
            chunk += [numbers[id(branch)]] * len(branch.children)
    counts = np.array(children, np.int32)
    first = np.where(counts > 0, 1 + np.cumsum(counts) - counts, 0).astype(np.int32)
    sizes = np.concatenate([each.sizes for each in found])
    table = NodeTable(
        low=rounded(np.concatenate([each.low for each in found]), -np.inf),
        high=rounded(np.concatenate([each.high for each in found]), np.inf),
        errors=np.where(counts > 0, 1, 0).astype(np.float32),
        first_child=first,
        child_count=counts,
        chunk=np.array(chunk, np.int32),
        first_row=np.concatenate([each.first_rows for each in found]),
        proxies=np.concatenate([each.proxies for each in found]),
        residents=np.concatenate([each.residents for each in found]),
    )
    return table, sizes, tuple(each.digest for each in found)  # chunks are numbered in this order
