"""A small splat tree made from a cloud: a root, branches and leaves, in packed chunks."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from usdsplat import schema
from usdsplat.core.cloud import SplatCloud
from usdsplat.core.edit import merge
from usdsplat.core.extent import extent
from usdsplat.core.node_table import NodeTable
from usdsplat.schema.chunk_layers import state_digest
from usdsplat.schema.hints import DrawingHints
from usdsplat.schema.tree import Tree, author_digests, author_tree, read_tree

Form = schema.Form


def rows_of(cloud: SplatCloud, rows: Any) -> SplatCloud:
    """Some splats of a cloud."""
    arrays = {f.name: getattr(cloud, f.name) for f in fields(cloud)}
    return SplatCloud(**{name: None if a is None else a[rows] for name, a in arrays.items()})


def proxies_of(cloud: SplatCloud) -> SplatCloud:
    """Every fourth splat of a cloud, enlarged to cover for the others."""
    kept = rows_of(cloud, slice(None, None, 4))
    return replace(kept, scales=(kept.scales * 4 ** (1 / 2)).astype(np.float32))


def little_table(splats: list[int] | None = None) -> NodeTable:
    """A valid table of seven nodes: the root, two branches with two leaves each.

    Chunk 0 has the root, chunk 1 the branches and chunk 2 the leaves, which have `splats` splats.
    """
    leaves = splats or [40, 40, 40, 40]
    halves = [-(-(leaves[0] + leaves[1]) // 4), -(-(leaves[2] + leaves[3]) // 4)]
    proxies = [-(-sum(halves) // 4), *halves, *leaves]
    ends = np.cumsum(leaves) - leaves
    low = [[0, 0, 0], [0, 0, 0], [2, 0, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]
    high = [[4, 1, 1], [2, 1, 1], [4, 1, 1], [1, 1, 1], [2, 1, 1], [3, 1, 1], [4, 1, 1]]
    return NodeTable(
        low=np.float32(low),
        high=np.float32(high),
        errors=np.float32([0.2, 0.1, 0.1, 0, 0, 0, 0]),
        first_child=np.int32([1, 3, 5, 0, 0, 0, 0]),
        child_count=np.int32([2, 2, 2, 0, 0, 0, 0]),
        chunk=np.int32([0, 1, 1, 2, 2, 2, 2]),
        first_row=np.int64([0, 0, halves[0], *ends]),
        proxies=np.int64(proxies),
        residents=np.int64([0] * 7),
    )


def little_tree(
    folder: Path,
    cloud: SplatCloud,
    *,
    form: Form = "packed",
    with_digests: bool = False,
    **options: Any,
) -> Path:
    """Write `tree.usda` with the tree /tree/splats of a cloud of at least 16 splats.

    The largest splat is the resident of the root; the others are split into four leaves along x.

    Args:
        folder: An existing folder; the chunks are in `tree_chunks` in it.
        cloud: The splats.
        form: Storage form of the chunks.
        with_digests: Whether the tree has the digests of its chunks.
        options: `drawing`, `pixel` and `color_space` of the tree.
    """
    largest = int(np.argmax(cloud.scales.max(axis=1)))
    order = [row for row in np.argsort(cloud.positions[:, 0]) if row != largest]
    leaves = [rows_of(cloud, part) for part in np.array_split(order, 4)]
    branches = [proxies_of(merge(leaves[:2])), proxies_of(merge(leaves[2:]))]
    resident = rows_of(cloud, [largest])
    root = proxies_of(merge(branches))
    table = little_table([len(leaf) for leaf in leaves])
    boxes = [_box(each) for each in (root, *branches, *leaves)]
    boxes[0] = _around(boxes[0], _box(resident))
    for parent, children in ((1, (3, 4)), (2, (5, 6)), (0, (1, 2))):
        for child in children:
            boxes[parent] = _around(boxes[parent], boxes[child])
    residents = np.int64([1, 0, 0, 0, 0, 0, 0])
    low, high = np.float32([box[0] for box in boxes]), np.float32([box[1] for box in boxes])
    table = replace(table, low=low, high=high, residents=residents)
    contents = (merge([root, resident]), merge(branches), merge(leaves))
    names, digests = [], []
    (folder / "tree_chunks").mkdir()
    for number, part in enumerate(contents):
        names.append(f"./tree_chunks/{number:04}.usdc")
        digests.append(write_chunk(folder / "tree_chunks" / f"{number:04}.usdc", part, form=form))
    path = folder / "tree.usda"
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetMetadata("upAxis", "Y")
    stage.SetMetadata("metersPerUnit", 1.0)
    stage.SetDefaultPrim(stage.DefinePrim("/tree", "Xform"))
    hints = options.pop("drawing", DrawingHints())
    prim = author_tree(
        stage, "/tree/splats", table, names, degree=cloud.sh_degree, drawing=hints, **options
    )
    if with_digests:
        author_digests(prim, digests)
    stage.Save()
    return path


def write_chunk(path: Path, cloud: SplatCloud, *, form: Form = "packed") -> str:
    """Write a layer whose default prim is a field, and return its digest."""
    stage = Usd.Stage.CreateNew(str(path))
    schema.author(stage, "/chunk", cloud, form=form)
    stage.SetDefaultPrim(stage.GetPrimAtPath("/chunk"))
    digest = state_digest(stage.GetRootLayer())
    stage.Save()
    return digest


def tree_of(path: Path) -> Tree:
    """The tree of a stage of `little_tree`."""
    stage = Usd.Stage.Open(str(path))
    return read_tree(stage.GetPrimAtPath("/tree/splats"))


def authored(path: Path, prim: str, name: str, value: Any) -> None:
    """Replace an attribute of a layer by one with the type of a value."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    spec = layer.GetPrimAtPath(prim)
    if name in spec.properties:
        spec.RemoveProperty(spec.properties[name])
    Sdf.AttributeSpec(spec, name, Sdf.GetValueTypeNameForValue(value)).default = value
    layer.Save()


def changed(path: Path, attribute: str, value: Any) -> None:
    """Author another value for an attribute of the tree."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.GetAttributeAtPath(f"/tree/splats.{attribute}").default = value
    layer.Save()


def _box(cloud: SplatCloud) -> np.ndarray:
    found = extent(cloud)
    assert found is not None
    return found


def _around(box: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The box around two."""
    return np.stack([np.minimum(box[0], other[0]), np.maximum(box[1], other[1])])
