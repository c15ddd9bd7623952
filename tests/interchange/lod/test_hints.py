"""Tests of the drawing hints that a tree gets from its inputs."""

from __future__ import annotations

from dataclasses import replace

from pxr import Usd

from tests.interchange.lod.worlds import ground
from usdsplat import schema
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.lod import build_tree


def test_hints_reach_the_tree_its_chunks_and_the_renderer(tmp_path):
    """Oracle: the hints of the two fields, which agree; proxies are antialiased."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    drawing = schema.DrawingHints(
        rasterize_mode="classic",
        projection_mode="tangential",
        sorting_mode="cameraDistance",
        footprint=0.25,
    )
    for name in "ab":
        schema.author(stage, f"/{name}", ground(3000), drawing=drawing)
    stage.Save()
    assert build_tree(tmp_path / "s.usda", tmp_path / "t.usda").notes == ()
    built = Usd.Stage.Open(str(tmp_path / "t.usda"))
    tree = schema.read_tree(built.GetPrimAtPath("/t/splats"))
    assert tree.drawing == drawing
    with Engine(built) as engine:
        ((_, drawn),) = engine.render_scene.drawn_trees()
        spec = drawn.spec
        assert (spec.rasterize_mode, spec.footprint) == ("footprint", 0.25)
        assert (spec.projection_mode, spec.sorting_mode) == ("tangential", "cameraDistance")
    chunk = Usd.Stage.Open(tree.chunks[0])
    assert schema.footprint(chunk.GetDefaultPrim()) == 0.25
    item = built.GetPrimAtPath("/t/coarse/levels/lod0")
    assert schema.sorting_mode(item) == "cameraDistance"
    assert (schema.rasterize_mode(item), schema.footprint(item)) == ("antialiased", None)


def test_fields_that_differ_are_a_note(tmp_path):
    """Oracle: the sentences; the tree has USD's defaults."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    drawing = schema.DrawingHints(sorting_mode="cameraDistance", footprint=0.25)
    schema.author(stage, "/a", ground(300), drawing=drawing)
    schema.author(stage, "/b", ground(300), drawing=replace(drawing, footprint=0.5))
    schema.author(stage, "/c", ground(300))
    stage.Save()
    assert build_tree(tmp_path / "s.usda", tmp_path / "t.usda").notes == (
        "inputs have different sorting modes; the tree has the default of USD",
        "inputs have different footprints, or some have none; the tree has none",
    )
    built = Usd.Stage.Open(str(tmp_path / "t.usda"))
    read = schema.read_tree(built.GetPrimAtPath("/t/splats")).drawing
    assert (read.sorting_mode, read.footprint) == ("zDepth", None)
