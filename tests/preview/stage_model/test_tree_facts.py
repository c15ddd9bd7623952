"""Tests of the facts about a splat tree that a panel shows."""

from __future__ import annotations

from dataclasses import replace

from pxr import Usd, UsdGeom

from tests.preview.documents import STATE, drawn_by
from tests.render.rendering import random_cloud
from tests.trees import little_tree
from usdsplat.preview.document import Document
from usdsplat.preview.stage_model.prims import children
from usdsplat.preview.stage_model.properties import properties
from usdsplat.preview.stage_model.tree_facts import tree_facts
from usdsplat.preview.values import Look
from usdsplat.products.tree_summary import of_tree
from usdsplat.render.settings import RenderSettings

TREE = "/tree/splats"
ROW = 4 * (3 + 3 + 4 + 1 + 3)
"""Bytes of a splat of degree 0 in memory."""


def state(error):
    return replace(STATE, camera=None, look=Look(settings=RenderSettings(lod_error=error)))


def shown(document):
    return dict(tree_facts(document.engine.render_scene, TREE))


def test_a_tree_says_what_it_has_and_what_is_loaded(tmp_path):
    """Oracle: `usdsplat info`, and by hand: the root with 25 proxies and its resident; then four
    leaves with 399 splats beside that resident."""
    stage = Usd.Stage.Open(str(little_tree(tmp_path, random_cloud(3, 400, 0))))
    document = Document(stage)
    about = of_tree(stage.GetPrimAtPath(TREE), None)
    facts = shown(document)
    names = ("Splats", "SH degree", "Colour space", "Levels", "Nodes", "Chunks")
    values = ("splats", "sh_degree", "color_space", "levels", "nodes", "chunks")
    expected = {**about, "levels": len(about["levels"])}
    assert [facts[name] for name in names] == [str(expected[value]) for value in values]
    assert facts["Drawn now"] == "0 nodes, 0 splats"
    drawn_by(document, state(1000.0))
    proxies = int(document.engine.render_scene.tree(TREE).spec.table.proxies[0])
    assert shown(document)["Drawn now"] == f"1 nodes, {proxies + 1} splats"
    document.still(state(0.0))
    facts = shown(document)
    assert facts["Drawn now"] == "5 nodes, 400 splats"
    there = 400 + proxies
    assert facts["In memory"] == f"5 nodes, {there} splats, {there * ROW / 1e6:.1f} MB"
    document.close()


def test_the_rows_of_a_tree_are_those_of_its_prim_and_its_facts(tmp_path):
    """Oracle: the stage. A prim that is no tree has no facts, nor a tree that was never read."""
    stage = Usd.Stage.Open(str(little_tree(tmp_path, random_cloud(3, 400, 0))))
    (row,) = children(stage, "/tree")
    assert (row.type_name, row.is_splats) == ("ParticleFieldSplatTree", True)
    document = Document(stage)
    scene = document.engine.render_scene
    found = {r.name: r for r in properties(stage, TREE, facts=tree_facts(scene, TREE))}
    assert (found["Nodes"].text, found["Nodes"].kind) == ("7", "computed")
    assert found["Visibility, inherited"].text == "inherited" and "splat:chunks" in found
    assert not list(tree_facts(scene, "/tree"))
    document.close()
    UsdGeom.Imageable(stage.GetPrimAtPath(TREE)).MakeInvisible()
    document = Document(stage)
    assert not list(tree_facts(document.engine.render_scene, TREE))
    document.close()
