"""Stages with a splat tree whose chunks are layers."""

from __future__ import annotations

from pxr import Usd, UsdGeom

from tests.render.lod.trees import Made, made
from usdsplat import schema
from usdsplat.schema.tree import author_tree


def write_chunk(path, cloud, *, form="float"):
    """A layer whose default prim is a field."""
    stage = Usd.Stage.CreateNew(str(path)) if not path.exists() else Usd.Stage.Open(str(path))
    stage.SetDefaultPrim(schema.author(stage, "/splats", cloud, form=form))
    stage.Save()


def author(stage, path, tree, folder, *, form="float"):
    """Author a `Made` tree with a chunk for each node, as layers in a folder."""
    folder.mkdir(exist_ok=True)
    for number, cloud in enumerate(tree.clouds):
        write_chunk(folder / f"{number:04}.usdc", cloud, form=form)
    return author_tree(
        stage,
        path,
        tree.table,
        [f"./{folder.name}/{i:04}.usdc" for i in range(len(tree.clouds))],
        degree=tree.clouds[0].sh_degree,
        color_space="srgb_rec709_scene",
        drawing=schema.DrawingHints(),
        pixel=0.0,
    )


def tree_stage(folder, tree: Made | None = None, *, form="float"):
    """A stage with a tree at /World/Tree, written to a folder; and the tree."""
    tree = tree or made(1, leaf=60)
    stage = Usd.Stage.CreateNew(str(folder / "tree.usda"))
    UsdGeom.Xform.Define(stage, "/World")
    author(stage, "/World/Tree", tree, folder / "tree_chunks", form=form)
    stage.Save()
    return stage, tree


def field_stage(tree):
    """The leaves of the tree as a field at the same path."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Xform.Define(stage, "/World")
    schema.author(stage, "/World/Tree", tree.leaves())
    return stage
