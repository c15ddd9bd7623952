"""Tests of overrides of the level of detail on splat trees."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Sdf, UsdGeom

from tests.delegate.stages import add_camera, random_cloud
from tests.delegate.tree_stages import tree_stage
from usdsplat.core.node_cuts import level_cut
from usdsplat.delegate.engine import Engine
from usdsplat.interchange.exporting import export_stage
from usdsplat.interchange.options import StageReading
from usdsplat.products.tree_views import ViewRequest, choice_of
from usdsplat.render.lod.nodes import view_cut
from usdsplat.render.settings import RenderSettings
from usdsplat.schema.hints import DrawingHints
from usdsplat.schema.lod_root_authoring import author_lod_root

TREE, ROOT, WORLD = "/World/Tree", "/World/coarse", "/World"


@pytest.fixture
def staged(tmp_path):
    """A stage with a camera, and a tree that names a LOD root; and the tree."""
    stage, tree = tree_stage(tmp_path)
    add_camera(stage)
    author_lod_root(
        stage,
        ROOT,
        [random_cloud(1)],
        thresholds=(),
        drawing=DrawingHints(),
        tree=stage.GetPrimAtPath(TREE),
    )
    return stage, tree


def override(stage, path, mode, index=0.0):
    """Author an override by its names, which USD need not know."""
    prim = stage.GetPrimAtPath(path)
    prim.AddAppliedSchema("LODOverrideAPI")
    prim.CreateAttribute("lod:override:mode", Sdf.ValueTypeNames.Token).Set(mode)
    prim.CreateAttribute("lod:override:index", Sdf.ValueTypeNames.Float).Set(index)


def drawn(engine, error=1.0, budget=0):
    """Nodes that a picture draws, without those that are refined, and its splats."""
    settings = RenderSettings(lod_error=error, splat_budget=budget)
    cut = view_cut(engine.render_scene, engine.view("/Camera"), settings)
    (reached,) = cut.trees
    found = reached.above_error(cut.limit)
    return sorted(found.nodes[~found.refined].tolist()), cut.splats


@pytest.mark.parametrize("where", [TREE, ROOT, WORLD])
@pytest.mark.parametrize("level", [0, 1, 2, 99])
@pytest.mark.parametrize("error", [0.0, 1.0, 1000.0])
def test_an_index_is_a_level_whatever_the_view(staged, where, level, error):
    """Oracle: the cut of the level, which depends on no view; levels above the root's are it."""
    stage, tree = staged
    override(stage, where, "indexedLOD", level)
    cut = level_cut(tree.table, level)
    with Engine(stage, device="cpu") as engine:
        nodes, splats = drawn(engine, error)
        assert nodes == cut.nodes.tolist()
        assert (splats, drawn(engine, error, budget=1)[1]) == (cut.splats(tree.table),) * 2


@pytest.mark.parametrize("mode", ["allLOD", "noLOD"])
def test_other_overrides_are_the_leaves(staged, mode):
    """Oracle: a picture with the error 0, bit for bit."""
    stage, _ = staged

    def picture(error):
        with Engine(stage, device="cpu") as engine:
            view = engine.view("/Camera", resolution=(80, 60))
            return engine.picture(view, RenderSettings(lod_error=error))["color"].copy()

    expected, coarse = picture(0.0), picture(50.0)
    override(stage, ROOT, mode)
    np.testing.assert_array_equal(picture(50.0), expected)
    assert (coarse != expected).any()


def test_the_nearest_override_decides_and_edits_are_followed(staged):
    """Oracle: the cut of each level, and that of the view without an override; times are those
    that are authored."""
    stage, tree = staged
    with Engine(stage, device="cpu", time=1.0) as engine:
        free = drawn(engine)
        levels = [level_cut(tree.table, level).nodes.tolist() for level in range(4)]
        assert len({len(each) for each in levels}) == 4
        for path, level in ((WORLD, 3), (ROOT, 2), (TREE, 1)):
            override(stage, path, "indexedLOD", level)
            assert drawn(engine)[0] == levels[level]
        index = stage.GetPrimAtPath(TREE).GetAttribute("lod:override:index")
        index.Set(0.0)
        assert drawn(engine)[0] == levels[0]
        index.Set(2.0, 1.0)
        index.Set(3.0, 2.0)
        assert drawn(engine)[0] == levels[2]
        engine.set_time(2.0)
        assert drawn(engine)[0] == levels[3]
        stage.GetPrimAtPath(TREE).GetAttribute("lod:override:mode").Set("noOverride")
        assert drawn(engine) == free
        stage.GetPrimAtPath(TREE).RemoveAppliedSchema("LODOverrideAPI")
        assert drawn(engine)[0] == levels[2]


def test_an_index_of_a_wrong_type_is_one_finding(staged):
    """Oracle: the sentence; the tree is drawn again when it is mended."""
    stage, _ = staged
    override(stage, ROOT, "indexedLOD", 1.0)
    spec = stage.GetRootLayer().GetPrimAtPath(ROOT)
    spec.RemoveProperty(spec.properties["lod:override:index"])
    Sdf.AttributeSpec(spec, "lod:override:index", Sdf.ValueTypeNames.Token).default = "one"
    with Engine(stage, device="cpu") as engine:
        (found,) = [each for each in engine.findings if "override" in each.message]
        assert "lod:override:index: found 'one', expected a number" in found.message
        spec.RemoveProperty(spec.properties["lod:override:index"])
        assert not [each for each in engine.findings if "override" in each.message]
        assert drawn(engine)[1] > 0


def test_a_capture_of_a_camera_has_the_level(staged, tmp_path):
    """Oracle: the number of splats of the level; without a camera, all leaves."""
    stage, tree = staged
    override(stage, TREE, "indexedLOD", 2)
    UsdGeom.Xformable(stage.GetPrimAtPath(TREE)).AddTranslateOp().Set((0, 0, -99))
    choice, _ = choice_of(stage, ViewRequest(camera="Camera"), None)
    report = export_stage(stage, tmp_path / "a.ply", StageReading(trees=choice))
    assert report.splats == level_cut(tree.table, 2).splats(tree.table)
    assert export_stage(stage, tmp_path / "b.ply").splats == tree.spec().captured
