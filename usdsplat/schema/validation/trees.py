"""Check splat trees: their table, their chunks, and what they share with fields."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence

import numpy as np
from pxr import Usd

from usdsplat.core.errors import StageError, UsdSplatError
from usdsplat.core.findings import Finding, finding, from_error
from usdsplat.core.wording import counted
from usdsplat.schema import attributes, tokens
from usdsplat.schema.chunks import check_chunk, chunk_digest
from usdsplat.schema.tree import Tree, is_tree, read_tree
from usdsplat.schema.validation import radiance
from usdsplat.schema.validation.finding import Sample
from usdsplat.schema.validation.value_types import fits

_EXTENT_CURE = "author the tree again with usdsplat.schema.author_tree, which computes it"
_TOLERANCE = 1e-4  # of the diagonal


def splat_trees(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Yield the splat trees of a stage, one of each set of equal instances."""
    seen = set()
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if is_tree(prim):
            own = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
            if own.GetPath() not in seen:
                seen.add(own.GetPath())
                yield prim


def check_tree(prim: Usd.Prim) -> list[Finding]:
    """Return what is wrong with a splat tree. Every chunk is opened; splats are read only for the
    digest that the tree has of a chunk."""
    found = [
        each
        for check in (radiance.color_space, radiance.modes, radiance.grade)
        for each in check(Sample(prim, Usd.TimeCode.Default()))
    ]
    try:
        tree = read_tree(prim)
    except UsdSplatError as error:
        return [*found, from_error("broken-tree", error)]
    found += _extent(prim, tree)
    found += missing_chunks(prim, tree)
    return [*found, *_broken_chunks(prim, tree)]


def tree_findings(stage: Usd.Stage) -> Iterator[Finding]:
    """Yield what the splat trees of a stage ask for and do not get, as far as it takes no chunk to
    be opened: broken tables, and missing chunks."""
    for prim in splat_trees(stage):
        try:
            yield from missing_chunks(prim, read_tree(prim))
        except UsdSplatError as error:
            yield from_error("broken-tree", error)


def missing_chunks(prim: Usd.Prim, tree: Tree) -> list[Finding]:
    """Return a finding if chunks of a tree do not exist, which names the folder of the first."""
    needed = set(tree.table.chunk.tolist()) - {-1}
    missing = [row for row, path in enumerate(tree.chunks) if not path and row in needed]
    if not missing:
        return []
    name = tree.chunk_names[missing[0]]
    folder, file = os.path.split(name)
    where = f"{file} in {folder}" if folder else name or "an empty asset path"
    all_of = "none" if len(missing) == len(needed) else f"{len(needed) - len(missing)}"
    found = f"{all_of} of {counted(len(needed), 'chunk')}, without {where}"
    expected = "the layers that splat:chunks names"
    return [finding("missing-chunk", str(prim.GetPath()), found, expected)]


def _broken_chunks(prim: Usd.Prim, tree: Tree) -> Iterator[Finding]:
    """Yield a finding for the first chunk that cannot be read as the table states, and for the
    first with other splats than the tree was built with."""
    table, wrong, edited = tree.table, [], []
    for row, path in enumerate(tree.chunks):
        mine = table.chunk == row
        if not path or not mine.any():
            continue
        ends = (table.first_row + table.proxies + table.residents)[mine]
        try:
            node = int(np.flatnonzero(mine)[int(ends.argmax())])
            digest = tree.digest(row)
            check_chunk(path, int(ends.max()), tree.degree, f"for node {node}", digest)
            if digest and chunk_digest(path) not in ("", digest):
                edited.append(path)
        except StageError as error:
            wrong.append(error)
    yield from broken_chunks(prim, wrong)
    if edited:
        found = f"splats of {edited[0]} that were changed{_and_more(len(edited))}"
        expected = "those with which the tree was built"
        yield finding("edited-chunk", str(prim.GetPath()), found, expected)


def broken_chunks(prim: Usd.Prim, wrong: Sequence[UsdSplatError]) -> Iterator[Finding]:
    """Yield a finding for the first of the errors of a tree's chunks, if there are any."""
    if wrong:
        first = wrong[0]
        found = f"in {first.where}: {first.found}{_and_more(len(wrong))}"
        yield finding("broken-chunk", str(prim.GetPath()), found, first.expected)


def _and_more(chunks: int) -> str:
    """Return the end of a sentence on the first of some chunks."""
    return f" (and {counted(chunks - 1, 'more chunk')})" if chunks > 1 else ""


def _extent(prim: Usd.Prim, tree: Tree) -> Iterator[Finding]:
    """Yield a finding if the extent is missing or does not hold the box of the root."""
    where = f"{prim.GetPath()}.{tokens.EXTENT}"
    value = prim.GetAttribute(tokens.EXTENT).Get()
    box = attributes.as_array(value) if fits(tokens.EXTENT, value) else None
    if box is None:
        yield finding("no-extent", where, "no value", "two corners", cure=_EXTENT_CURE)
        return
    if len(box) != 2:
        found = counted(len(box), "value")
        yield finding("extent-size", where, found, "two corners", cure=_EXTENT_CURE)
        return
    low, high = tree.table.low[0], tree.table.high[0]
    slack = _TOLERANCE * float(np.linalg.norm(high.astype(np.float64) - low))
    if not ((box[0] <= low + slack).all() and (box[1] >= high - slack).all()):
        found, expected = f"{box.tolist()}", f"at least {[low.tolist(), high.tolist()]}"
        yield finding("extent-too-small", where, found, expected, cure=_EXTENT_CURE)
