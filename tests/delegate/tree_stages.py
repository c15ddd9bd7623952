"""Stages with a splat tree whose chunks are layers."""

from __future__ import annotations

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.render.lod.trees import Made, made
from usdsplat import schema
from usdsplat.schema.tree import CHUNKS, COLUMNS, TREE

TYPES = {
    "low": Sdf.ValueTypeNames.Float3Array,
    "high": Sdf.ValueTypeNames.Float3Array,
    "errors": Sdf.ValueTypeNames.FloatArray,
    "first_row": Sdf.ValueTypeNames.Int64Array,
    "proxies": Sdf.ValueTypeNames.Int64Array,
    "residents": Sdf.ValueTypeNames.Int64Array,
}


def write_chunk(path, cloud):
    """A layer whose default prim is a field."""
    stage = Usd.Stage.CreateNew(str(path)) if not path.exists() else Usd.Stage.Open(str(path))
    stage.SetDefaultPrim(schema.author(stage, "/splats", cloud))
    stage.Save()


def author(stage, path, tree, folder):
    """Author a `Made` tree with a chunk for each node, as layers in a folder."""
    folder.mkdir(exist_ok=True)
    for number, cloud in enumerate(tree.clouds):
        write_chunk(folder / f"{number:04}.usdc", cloud)
    prim = stage.DefinePrim(path, TREE)
    for column, (name, _) in COLUMNS.items():
        array = np.ascontiguousarray(getattr(tree.table, column))
        kind = TYPES.get(column, Sdf.ValueTypeNames.IntArray)
        vt = {"low": Vt.Vec3fArray, "high": Vt.Vec3fArray, "errors": Vt.FloatArray}.get(column)
        vt = vt or (Vt.Int64Array if kind == Sdf.ValueTypeNames.Int64Array else Vt.IntArray)
        prim.CreateAttribute(name, kind).Set(vt.FromNumpy(array))
    assets = [Sdf.AssetPath(f"./{folder.name}/{i:04}.usdc") for i in range(len(tree.clouds))]
    prim.CreateAttribute(CHUNKS, Sdf.ValueTypeNames.AssetArray).Set(assets)
    prim.CreateAttribute(schema.tokens.SH_DEGREE, Sdf.ValueTypeNames.Int).Set(3)
    return prim


def tree_stage(folder, tree: Made | None = None):
    """A stage with a tree at /World/Tree, written to a folder; and the tree."""
    tree = tree or made(1, leaf=60)
    stage = Usd.Stage.CreateNew(str(folder / "tree.usda"))
    UsdGeom.Xform.Define(stage, "/World")
    author(stage, "/World/Tree", tree, folder / "tree_chunks")
    stage.Save()
    return stage, tree


def field_stage(tree):
    """The leaves of the tree as a field at the same path."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Xform.Define(stage, "/World")
    schema.author(stage, "/World/Tree", tree.leaves())
    return stage
